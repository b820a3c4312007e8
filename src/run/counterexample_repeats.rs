use std::collections::BTreeMap;
use std::ops::ControlFlow;

use mishandle_falsification::{CampaignOutcome, Minimum};
use mishandle_results::Repeats;

use crate::error::MishandleError;
use crate::resolve::{ResolvedPlan, depends_on_seed};
use crate::run::{repeat, repeat_seeds};

/// Fewest simulations of a counterexample with other seeds, unless fewer are requested. Fewer say little: of 20, none fails with a
/// probability of 36 % if 5 % do.
const FEWEST: u64 = 20;

/// Simulates the counterexample of each falsified trial `repeats` times with other seeds; in total at most as often as the run has
/// simulations, but each at least 20 times. Returns the results by trial, nothing for a target without randomness, whose
/// counterexamples always fail. `watch` gets the number of finished simulations and that of all; it can end the repeats.
///
/// # Errors
/// If a simulation cannot be run.
pub fn counterexample_repeats(
    resolved: &ResolvedPlan,
    found: &CampaignOutcome,
    repeats: u32,
    mut watch: impl FnMut(u64, u64) -> ControlFlow<()>,
) -> Result<BTreeMap<u32, Repeats>, MishandleError> {
    let counterexamples: Vec<(u32, &Minimum)> = found
        .trials
        .iter()
        .filter(|trial| trial.falsified())
        .filter_map(|trial| Some((trial.trial, trial.minimum.as_ref()?)))
        .filter(|(_, minimum)| depends_on_seed(resolved, &minimum.scenario))
        .collect();
    let share = found.simulations / (counterexamples.len() as u64).max(1);
    let each = u64::from(repeats).min(share.max(FEWEST));
    let mut reports = BTreeMap::new();
    if counterexamples.is_empty() || each == 0 {
        return Ok(reports);
    }
    let all = each * counterexamples.len() as u64;
    let mut system = resolved.system()?;
    let mut done = 0;
    for (trial, minimum) in counterexamples {
        let mut is_interrupted = false;
        let report = repeat(&mut *system, &minimum.scenario, repeat_seeds(minimum.seed, each), |_| {
            done += 1;
            let flow = watch(done, all);
            is_interrupted |= flow.is_break();
            flow
        })?;
        reports.insert(trial, report);
        if is_interrupted {
            break;
        }
    }
    Ok(reports)
}
