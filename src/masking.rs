//! Masking: which predicates of a formula set the robustness of a run, and which ones fail.

use mishandle_rollout::RolloutError;
use mishandle_stl::{Formula, Trace};
use mishandle_store::{RunFile, Simulation};

use crate::explanation::{explain_trace, trace};
use crate::record;
use crate::{MishandleError, ResolvedPlan};

/// Number of simulations per batch.
const BATCH: usize = 64;

/// A predicate over the simulations of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MaskedPredicate {
    /// Position in the list of [`Formula::subformulas`].
    pub position: usize,
    /// Text of the predicate.
    pub predicate: String,
    /// Number of simulations whose robustness it sets.
    pub sets: u64,
    /// Number of these that violate the formula.
    pub violations: u64,
    /// Number of simulations that violate the formula with this predicate as the only operand of each `and` above it.
    pub fails: u64,
}

/// The predicates of a formula over the simulations of a run.
///
/// The robustness of `and` is that of its weakest operand. So a predicate with small numbers can set the robustness of almost
/// all simulations, and hide from a search how far the others are from failing.
#[derive(Clone, Debug, PartialEq)]
pub struct Masking {
    /// The predicates, in the order of the formula.
    pub predicates: Vec<MaskedPredicate>,
    /// Number of simulations that were evaluated.
    pub evaluated: u64,
    /// Number of simulations of the run that have a robustness.
    pub decided: u64,
    /// Whether only recorded traces were evaluated, which are those of counterexamples.
    pub counterexamples_only: bool,
}

/// Counts which predicates set the robustness of a run and which ones fail, over at most `limit` of its simulations, evenly
/// chosen. They are simulated again with `resolved`; without it, only the simulations with a recorded trace are evaluated.
/// `watch` gets the number of evaluated simulations and the number of all that will be evaluated.
///
/// # Errors
/// If the run cannot be read, a simulation cannot be run, or the formula has no finite value on a trace.
pub fn masking(
    run: &RunFile,
    resolved: Option<&ResolvedPlan>,
    limit: u64,
    mut watch: impl FnMut(u64, u64),
) -> Result<Masking, MishandleError> {
    let header = run.header();
    let parse = |source| RolloutError::Parse { formula: header.formula.clone(), source };
    let formula = Formula::parse(&header.formula).map_err(parse)?;
    let mut usable = Vec::new();
    let mut decided = 0;
    for simulation in run.simulations() {
        let simulation = simulation?;
        decided += u64::from(simulation.robustness.is_some());
        let is_counterexample = simulation.robustness.is_some_and(|rho| rho < 0.0);
        if simulation.robustness.is_some() && (resolved.is_some() || is_counterexample) {
            usable.push((simulation.trial, simulation.number));
        }
    }
    let chosen: Vec<Simulation> = evenly(usable.len() as u64, limit)
        .map(|index| usable[index as usize])
        .map(|(trial, number)| run.simulation(trial, number))
        .collect::<Result<_, _>>()?;
    let total = chosen.len() as u64;
    let mut masking =
        Masking { predicates: Vec::new(), evaluated: 0, decided, counterexamples_only: resolved.is_none() };
    let mut count = |trace: &Trace| {
        masking.add(&formula, trace, header.control_dt)?;
        watch(masking.evaluated, total);
        Ok::<_, MishandleError>(())
    };
    match resolved {
        Some(resolved) => {
            let mut system = resolved.system()?;
            for batch in chosen.chunks(BATCH) {
                let requests: Vec<_> =
                    batch.iter().map(|simulation| record::request(simulation, false)).collect();
                system.rollout(&requests)?.iter().try_for_each(|episode| count(&episode.trace))?;
            }
        }
        None => {
            for stored in chosen.iter().filter_map(|simulation| simulation.trace.as_ref()) {
                count(&trace(header, stored))?;
            }
        }
    }
    Ok(masking)
}

impl Masking {
    fn add(&mut self, formula: &Formula, trace: &Trace, control_dt: f64) -> Result<(), MishandleError> {
        let explanation = explain_trace(formula, trace, control_dt)?;
        if self.predicates.is_empty() {
            let named = |conjunct: &crate::Conjunct| MaskedPredicate {
                position: conjunct.position,
                predicate: conjunct.predicate.clone(),
                ..MaskedPredicate::default()
            };
            self.predicates = explanation.conjuncts.iter().map(named).collect();
        }
        self.evaluated += 1;
        let decisive = explanation.diagnosis.predicate.as_ref().map(|predicate| predicate.position);
        let is_violated = explanation.diagnosis.robustness() < 0.0;
        for (predicate, conjunct) in self.predicates.iter_mut().zip(&explanation.conjuncts) {
            let sets = decisive == Some(predicate.position);
            predicate.sets += u64::from(sets);
            predicate.violations += u64::from(sets && is_violated);
            predicate.fails += u64::from(conjunct.robustness < 0.0);
        }
        Ok(())
    }
}

/// Returns at most `limit` of the numbers below `n`, evenly spaced.
fn evenly(n: u64, limit: u64) -> impl Iterator<Item = u64> {
    let count = n.min(limit);
    // u128, since the product of two u64 can overflow.
    (0..count).map(move |index| (u128::from(index) * u128::from(n) / u128::from(count.max(1))) as u64)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    #[test]
    fn a_predicate_with_small_numbers_masks_one_that_fails_more_often() {
        let formula = Formula::parse("always(height > 0 and distance <= 5)").unwrap();
        let names: Arc<[String]> = Arc::from(["height".to_string(), "distance".to_string()]);
        let mut masking =
            Masking { predicates: Vec::new(), evaluated: 0, decided: 3, counterexamples_only: false };
        // By hand: margins (0.1, 4), (0.1, -1), (-2, -1).
        for [height, distance] in [[0.1, 1.0], [0.1, 6.0], [-2.0, 6.0]] {
            let mut trace = Trace::new(Arc::clone(&names));
            trace.push(&[height, distance]);
            masking.add(&formula, &trace, 0.1).unwrap();
        }
        let counts: Vec<[u64; 3]> =
            masking.predicates.iter().map(|found| [found.sets, found.violations, found.fails]).collect();
        assert_eq!(counts, [[2, 1, 1], [1, 1, 2]]);
        assert_eq!(masking.predicates[1].predicate, "distance <= 5");
    }

    #[test]
    fn chosen_simulations_are_spread_over_the_run() {
        assert_eq!(evenly(10, 4).collect::<Vec<_>>(), [0, 2, 5, 7]);
        assert_eq!(evenly(3, 9).collect::<Vec<_>>(), [0, 1, 2]);
        assert_eq!(evenly(0, 9).count(), 0);
    }
}
