//! The counterexamples of a falsification, simulated with other seeds.

use std::collections::BTreeMap;
use std::ops::ControlFlow;

use mishandle_evaluation::Repeats;
use mishandle_falsification::{FalsificationOutcome, Minimum, Repeated, repeat, repeat_seeds};

use crate::error::MishandleError;
use crate::resolve::{ResolvedPlan, depends_on_seed};

/// Simulates each counterexample with other seeds, as often as [`Repeated::each_counterexample`] says; `requested` replaces the
/// default of [`Repeated::Counterexample`]. Returns the reports by trial: none for a target without randomness, whose
/// counterexamples always fail.
///
/// `watch` gets the number of finished simulations and of all, and can end the repeats.
///
/// # Errors
/// If a simulation cannot be run.
pub fn counterexample_repeats(
    resolved: &ResolvedPlan,
    found: &FalsificationOutcome,
    requested: Option<u64>,
    mut watch: impl FnMut(u64, u64) -> ControlFlow<()>,
) -> Result<BTreeMap<u32, Repeats>, MishandleError> {
    let counterexamples: Vec<(u32, &Minimum)> = found
        .trials
        .iter()
        .filter(|trial| trial.falsified())
        .filter_map(|trial| Some((trial.trial, trial.minimum.as_ref()?)))
        .filter(|(_, minimum)| depends_on_seed(resolved, &minimum.scenario))
        .collect();
    let number = counterexamples.len() as u64;
    let requested = requested.unwrap_or(Repeated::Counterexample.simulations());
    let each = Repeated::each_counterexample(requested, found.simulations, number);
    let mut reports = BTreeMap::new();
    if counterexamples.is_empty() || each == 0 {
        return Ok(reports);
    }
    let mut system = resolved.system()?;
    let (mut done, mut is_interrupted) = (0, false);
    for (trial, minimum) in counterexamples {
        let seeds = repeat_seeds(minimum.seed, each);
        let report = repeat(&mut *system, &minimum.scenario, seeds, |_| {
            done += 1;
            let flow = watch(done, each * number);
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
