//! Masking: which conjuncts of a formula set the robustness of a run, and which ones fail.

use std::ops::ControlFlow;
use std::path::Path;

use mishandle_results::{EvaluatedCount, MaskedConjunct, Masking};
use mishandle_rollout::RolloutError;
use mishandle_stl::{Clock, Formula, Monitor, Trace, is_violated};
use mishandle_store::{RunFile, Simulation};

use crate::error::MishandleError;
use crate::inspect::traces::{each_trace, evenly};
use crate::resolve::ResolvedPlan;

/// Counts which conjuncts set the robustness of a run and which ones fail, over at most `limit` of
/// its simulations: all violated ones, or that many evenly chosen, and satisfied ones, evenly
/// chosen, up to the limit. They are simulated again with `resolved`; without it, only the
/// simulations with a recorded trace are evaluated, which are violated ones. `watch` gets the
/// number of evaluated simulations and the number of all that will be evaluated; it can end the
/// count, which then has nothing to say: `None`.
///
/// # Errors
/// If the run cannot be read, a simulation cannot be run, or the formula has no finite value on a
/// trace.
pub fn masking(
    run: &RunFile,
    resolved: Option<&ResolvedPlan>,
    limit: u64,
    mut watch: impl FnMut(u64, u64) -> ControlFlow<()>,
) -> Result<Option<Masking>, MishandleError> {
    let header = run.header();
    let parse = |source| RolloutError::Parse { formula: header.formula.clone(), source };
    let formula = Formula::parse(&header.formula).map_err(parse)?;
    let mut satisfied = Vec::new();
    let mut violated = Vec::new();
    for simulation in run.simulations() {
        let simulation = simulation?;
        match simulation.robustness {
            Some(rho) if is_violated(rho) => violated.push((simulation.trial, simulation.number)),
            Some(_) => satisfied.push((simulation.trial, simulation.number)),
            None => {}
        }
    }
    let chosen_violated = evenly(&violated, limit);
    let rest = if resolved.is_some() { limit - chosen_violated.len() as u64 } else { 0 };
    let chosen: Vec<Simulation> = chosen_violated
        .into_iter()
        .chain(evenly(&satisfied, rest))
        .map(|(trial, number)| run.simulation(trial, number))
        .collect::<Result<_, _>>()?;
    let mut masking = Counter::new(run.path(), &formula);
    // As it is recorded, not as it is parsed.
    masking.found.formula = header.formula.clone();
    masking.found.satisfied.total = satisfied.len() as u64;
    masking.found.violated.total = violated.len() as u64;
    let total = chosen.len() as u64;
    let is_whole = each_trace(run, resolved, &chosen, |_, trace| {
        masking.add(trace, header.control_dt)?;
        Ok(watch(masking.found.satisfied.evaluated + masking.found.violated.evaluated, total))
    })?;
    if is_whole.is_break() {
        return Ok(None);
    }
    Ok(Some(masking.found))
}

/// The conjuncts of a formula over some simulations.
///
/// The robustness of `and` is that of its weakest operand. So a predicate with small numbers can
/// set the robustness of almost all simulations, and hide from a search how far the others are from
/// failing.
struct Counter<'a> {
    formula: &'a Formula,
    /// Position of each conjunct in the list of [`Formula::subformulas`].
    positions: Vec<usize>,
    found: Masking,
}

impl Counter<'_> {
    fn new<'a>(path: &Path, formula: &'a Formula) -> Counter<'a> {
        let positions = formula.conjuncts();
        // Their positions ascend.
        let mut texts = formula.subformulas();
        let mut next = 0;
        let mut conjunct = |position: &usize| {
            let text = position.checked_sub(next).and_then(|skipped| texts.nth(skipped));
            next = position + 1;
            MaskedConjunct { formula: text.unwrap_or_default(), ..MaskedConjunct::default() }
        };
        let found = Masking {
            run: path.to_string_lossy().into_owned(),
            formula: formula.to_string(),
            satisfied: EvaluatedCount::default(),
            violated: EvaluatedCount::default(),
            conjuncts: positions.iter().map(&mut conjunct).collect(),
        };
        Counter { formula, positions, found }
    }

    fn add(&mut self, trace: &Trace, control_dt: f64) -> Result<(), MishandleError> {
        let formula = self.formula;
        let clock = Clock::steps(control_dt);
        let monitor_error = |source| RolloutError::Monitor { formula: formula.to_string(), source };
        let diagnosis = formula.diagnose(trace, &clock).map_err(monitor_error)?;
        let fails = is_violated(diagnosis.robustness());
        let count = if fails { &mut self.found.violated } else { &mut self.found.satisfied };
        count.evaluated += 1;
        for (position, conjunct) in self.positions.iter().zip(&mut self.found.conjuncts) {
            let sets = diagnosis.path.iter().any(|found| found.position == *position);
            conjunct.sets_satisfied += u64::from(sets && !fails);
            conjunct.sets_violated += u64::from(sets && fails);
            let alone = formula.conjunct(*position).filter(|_| fails);
            if let Some(alone) = alone {
                let mut monitor = Monitor::new(&alone, trace.names(), clock).map_err(monitor_error)?;
                let robustness = monitor.robustness_signal(trace).map_err(monitor_error)?;
                conjunct.fails += u64::from(robustness.first().is_some_and(|rho| is_violated(*rho)));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    #[test]
    fn a_conjunct_with_small_numbers_masks_one_that_fails_more_often() {
        let formula = Formula::parse("always(height > 0 and distance <= 5)").unwrap();
        let names: Arc<[String]> = Arc::from(["height".to_string(), "distance".to_string()]);
        let mut masking = Counter::new(Path::new(""), &formula);
        // By hand: margins (0.1, 4), (0.1, -1), (-2, -1).
        for [height, distance] in [[0.1, 1.0], [0.1, 6.0], [-2.0, 6.0]] {
            let mut trace = Trace::new(Arc::clone(&names));
            trace.push(&[height, distance]);
            masking.add(&trace, 0.1).unwrap();
        }
        let counts: Vec<[u64; 3]> = masking
            .found
            .conjuncts
            .iter()
            .map(|found| [found.sets_satisfied, found.sets_violated, found.fails])
            .collect();
        assert_eq!(counts, [[1, 1, 1], [0, 1, 2]]);
        assert_eq!(masking.found.conjuncts[1].formula, "distance <= 5");
        assert_eq!((masking.found.satisfied.evaluated, masking.found.violated.evaluated), (1, 2));
    }

    #[test]
    fn an_operand_of_until_is_no_conjunct() {
        let formula = Formula::parse("a >= 0 until b >= 0").unwrap();
        let masking = Counter::new(Path::new(""), &formula);
        let texts: Vec<&str> = masking.found.conjuncts.iter().map(|found| found.formula.as_str()).collect();
        assert_eq!(texts, [formula.to_string()]);
    }

    #[test]
    fn chosen_simulations_are_spread_over_the_run() {
        let items: Vec<u32> = (0..10).collect();
        assert_eq!(evenly(&items, 4), [0, 2, 5, 7]);
        assert_eq!(evenly(&items[..3], 9), [0, 1, 2]);
        assert!(evenly(&items[..0], 9).is_empty());
    }
}
