//! The smallest disturbance that violates the requirement of a plan.

use mishandle_evaluation::Repeats;
use mishandle_falsification::{
    Margin, MarginSettings, Narrowed, Repeated, each_category, each_fault, margin, repeat, repeat_seeds,
};
use mishandle_random::Seed;
use mishandle_results::{Answer, Level};
use mishandle_rollout::{Request, Space};
use mishandle_store::TrialStatus;

use crate::error::MishandleError;
use crate::resolve::{depends_on_seed, space_depends_on_seed};
use crate::run::ask::{Found, Progress, Watch};
use crate::run::journal::{Journal, JournalSystem, Numbering};
use crate::run::result::margin_result;

/// Trials of the searches, and of the repeats of the witness.
pub(super) const SEARCH: u32 = 1;
const REPEATS: u32 = 2;

/// The smallest disturbance, with the repeats of its witness.
#[derive(Clone, Debug)]
pub(super) struct MarginOutcome {
    /// The search; with a search for each combination of categories, the one with the smallest
    /// disturbance.
    pub margin: Margin,
    /// The searches for each combination of categories, if the plan asks for them. The categories
    /// are the fixed values of the space.
    pub each_category: Vec<(Space, Margin)>,
    /// The claim that nothing is violated: the smallest one of all searches, which is exhaustive if
    /// all are; `None` if one of them claims nothing.
    pub passed: Option<Level>,
    /// Smallest amplitude of a simulation without a verdict, in all searches; `None` without one.
    pub smallest_without_verdict: Option<f64>,
    /// Number of simulations of all searches.
    pub simulations: u64,
    /// Simulations of the witness with other seeds; `None` without a witness, or if the seed has no
    /// effect.
    pub repeats: Option<Repeats>,
    /// Whether search and repeats are finished.
    pub is_complete: bool,
}

/// Searches for the smallest disturbance, and repeats it with other seeds.
pub(super) fn ask(journal: &Journal<'_>, watch: Watch<'_>) -> Result<Found, MishandleError> {
    let resolved = journal.resolved();
    let numbered = |trial| journal.system(Some(Numbering { trial, last: 0 }));
    let mut outcome = margins(journal, &mut numbered(SEARCH), &mut *watch)?;
    let mut ended = Vec::new();
    if outcome.is_complete {
        let has_witness = outcome.margin.witness.is_some();
        ended.push((SEARCH, if has_witness { TrialStatus::Falsified } else { TrialStatus::BudgetSpent }));
    }
    let max_simulations = outcome.simulations;
    let mut watch = |simulations| watch(&Progress { simulations, max_simulations, ..Progress::default() });
    let witness = outcome.margin.witness.as_ref().filter(|_| outcome.is_complete);
    if let Some(Request { scenario, seed, .. }) = witness.map(|witness| &witness.episode.request)
        && depends_on_seed(resolved, scenario)
    {
        let planned = Repeated::Counterexample.simulations();
        let seeds = repeat_seeds(*seed, planned);
        let done = outcome.simulations;
        let repeats = repeat(&mut numbered(REPEATS), scenario, seeds, |_| watch(done));
        let repeats = journal.result(repeats)?;
        outcome.is_complete = repeats.simulations == planned;
        outcome.repeats = Some(repeats);
        if outcome.is_complete {
            ended.push((REPEATS, TrialStatus::BudgetSpent));
        }
    }
    let answer = Answer::Margin(Box::new(margin_result(resolved, &outcome, &journal.path())));
    Ok(Found { answer, ended, is_checked: false })
}

/// Searches for the smallest disturbance, once for each kind of a fault, or for each combination of
/// categories if the plan asks for that.
fn margins(
    journal: &Journal<'_>,
    system: &mut JournalSystem<'_>,
    watch: Watch<'_>,
) -> Result<MarginOutcome, MishandleError> {
    let resolved = journal.resolved();
    let table = resolved.plan.margin.as_ref().ok_or(MishandleError::MissingPlanTable { table: "margin" })?;
    let settings = MarginSettings {
        seed: Seed(resolved.plan.seed),
        budget: table.budget,
        is_random: space_depends_on_seed(resolved),
    };
    let spaces =
        if table.each_category { each_category(&resolved.space)? } else { each_fault(&resolved.space)? };
    let max_simulations = table.budget.saturating_mul(spaces.len() as u64);
    let mut found = Vec::new();
    let mut simulations = 0;
    let mut is_complete = true;
    for space in &spaces {
        let mut part = Narrowed { system: &mut *system, space };
        let result = margin(&mut part, settings, |done| {
            watch(&Progress { simulations: simulations + done, max_simulations, ..Progress::default() })
        });
        let margin = journal.result(result)?;
        simulations += margin.simulations;
        is_complete = margin.is_complete;
        found.push(margin);
        if !is_complete {
            break;
        }
    }
    // Of equal amplitudes, the last one counts, as in a run file.
    let order = |margin: &Margin| {
        let witness = margin.witness.as_ref().map(|witness| witness.norms.amplitude);
        let passed = margin.largest_without_violation().map_or(0.0, |level| level.amplitude);
        (witness.unwrap_or(f64::INFINITY), passed)
    };
    let smallest = found.iter().rev().min_by(|a, b| {
        let (a, a_passed) = order(a);
        let (b, b_passed) = order(b);
        a.total_cmp(&b).then(a_passed.total_cmp(&b_passed))
    });
    let passed = if found.len() == spaces.len() { smallest_claim(&found) } else { None };
    let smallest_without_verdict =
        found.iter().filter_map(|margin| margin.smallest_without_verdict).min_by(f64::total_cmp);
    let smallest = smallest.cloned().ok_or(MishandleError::MissingPlanTable { table: "margin" })?;
    let margin = Margin { is_complete, ..smallest };
    let each_category = if table.each_category || spaces.len() > 1 {
        spaces.into_iter().zip(found).collect()
    } else {
        Vec::new()
    };
    Ok(MarginOutcome {
        margin,
        each_category,
        passed,
        smallest_without_verdict,
        simulations,
        repeats: None,
        is_complete,
    })
}

/// Returns what all searches claim: the amplitude up to which none of them found a violation, with
/// the fewest simulations of a search that stopped there.
fn smallest_claim(found: &[Margin]) -> Option<Level> {
    let levels: Option<Vec<Level>> = found.iter().map(Margin::largest_without_violation).collect();
    let levels = levels?;
    let is_exhaustive = levels.iter().all(|level| level.is_exhaustive);
    let smallest = levels
        .into_iter()
        .min_by(|a, b| a.amplitude.total_cmp(&b.amplitude).then(a.verdicts().cmp(&b.verdicts())));
    Some(Level { is_exhaustive, ..smallest? })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a finished search without a violation at some amplitudes.
    fn part(amplitudes: &[(f64, u64)], smallest_without_verdict: Option<f64>) -> Margin {
        let level = |(amplitude, simulations): &(f64, u64)| Level {
            simulations: *simulations,
            minimum_robustness: Some(1.0),
            is_complete: true,
            is_exhaustive: *simulations < 100,
            ..Level::new(*amplitude)
        };
        let levels = amplitudes.iter().map(level).collect();
        Margin {
            witness: None,
            levels,
            smallest_without_verdict,
            largest_with_verdict: 1.0,
            simulations: 0,
            is_complete: true,
        }
    }

    /// All searches together claim no more than each of them shows.
    #[test]
    fn the_claim_of_several_searches_is_the_smallest_one() {
        let safe = part(&[(1.0, 600)], None);
        let claim = |other: Margin| {
            let claims = [[safe.clone(), other.clone()], [other, safe.clone()]];
            let [first, second] = claims.map(|parts| smallest_claim(&parts));
            assert_eq!(first, second);
            first.map(|level| (level.amplitude, level.verdicts(), level.is_exhaustive))
        };
        assert_eq!(claim(part(&[(1.0, 500)], None)), Some((1.0, 500, false)));
        assert_eq!(claim(part(&[(1.0, 50)], None)), Some((1.0, 50, false)));
        assert_eq!(claim(part(&[(0.4, 500), (1.0, 500)], Some(0.7))), Some((0.4, 500, false)));
        assert_eq!(claim(part(&[(0.4, 500), (1.0, 500)], Some(0.3))), None);
        assert_eq!(smallest_claim(&[part(&[(1.0, 50)], None)]).map(|level| level.is_exhaustive), Some(true));
    }
}
