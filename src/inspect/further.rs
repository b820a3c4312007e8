use std::ops::ControlFlow;
use std::path::Path;

use mishandle_results::Answer;
use mishandle_store::RunFile;

use crate::error::MishandleError;
use crate::inspect::mode_survey;
use crate::inspect::smooth_region::smooth_region_of;
use crate::resolve::ResolvedPlan;
use crate::run::counterexample_repeats;

/// Adds to the answer of a falsification what takes its rows or further simulations: the failure
/// modes of one that keeps going, and of a complete one the repeats of its counterexamples and the
/// smooth region. Other answers stay as they are.
///
/// The run file must be closed. `repeats` and `watch` are those of [`counterexample_repeats`].
///
/// # Errors
/// If a simulation cannot be run, or the run file cannot be read.
pub fn further(
    resolved: &ResolvedPlan,
    answer: &mut Answer,
    repeats: Option<u64>,
    mut watch: impl FnMut(u64, u64) -> ControlFlow<()>,
) -> Result<(), MishandleError> {
    let Answer::Falsification(found) = answer else { return Ok(()) };
    let Some(path) = found.run.clone() else { return Ok(()) };
    if resolved.plan.falsify.as_ref().is_some_and(|falsify| falsify.keep_going) {
        let run = RunFile::open_unchecked(&path)?;
        found.modes = Some(mode_survey(&run)?.result(run.header()));
    }
    if found.is_complete {
        let mut repeated = counterexample_repeats(resolved, found, repeats, &mut watch)?;
        for trial in &mut found.trials {
            trial.repeats = repeated.remove(&trial.trial);
        }
        if found.screening.is_none() {
            found.smooth_region = smooth_region_of(resolved, found, Path::new(&path), &mut watch)?;
        }
    }
    Ok(())
}
