//! The answer of a question with what its simulations say besides.

use std::ops::ControlFlow;
use std::path::Path;

use mishandle_results as results;
use mishandle_store::RunFile;

use crate::error::MishandleError;
use crate::inspect::cause::isolation;
use crate::inspect::requirements::requirements;
use crate::inspect::{axis_rates, mode_survey, smooth_region_of};
use crate::resolve::ResolvedPlan;
use crate::run::{Answer, counterexample_repeats};

/// Returns the answer of a question as a result, with all that the question asks for: a
/// falsification that keeps going has its failure modes, and a complete one the repeats and causes
/// of its counterexamples and the smooth region.
///
/// `run` is the path of the run file, which must be closed. `repeats` and `watch` are those of
/// [`counterexample_repeats`].
///
/// # Errors
/// If a simulation cannot be run, or the run file cannot be read.
pub fn whole_result(
    resolved: &ResolvedPlan,
    answer: &Answer,
    run: &Path,
    repeats: Option<u64>,
    mut watch: impl FnMut(u64, u64) -> ControlFlow<()>,
) -> Result<results::Answer, MishandleError> {
    let mut result = recorded_result(resolved, answer, run)?;
    let (Answer::Falsification(outcome, counts), results::Answer::Falsification(found)) =
        (answer, &mut result)
    else {
        return Ok(result);
    };
    if resolved.plan.falsify.as_ref().is_some_and(|falsify| falsify.keep_going) {
        let run = RunFile::open_unchecked(run)?;
        found.modes = Some(mode_survey(&run)?.result(run.header()));
    }
    if answer.is_complete() {
        let mut repeated = counterexample_repeats(resolved, outcome, repeats, &mut watch)?;
        for trial in &mut found.trials {
            trial.repeats = repeated.remove(&trial.trial);
        }
        if counts.is_none() {
            found.smooth_region = smooth_region_of(resolved, outcome, run, &mut watch)?;
        }
    }
    Ok(result)
}

/// Returns the answer of a question as a result, with what its run file says besides: the named
/// requirements, the success rates over the values of axes, and the causes of counterexamples. It
/// simulates nothing.
///
/// # Errors
/// If the run file at `run`, which must be closed, cannot be read.
pub fn recorded_result(
    resolved: &ResolvedPlan,
    answer: &Answer,
    run: &Path,
) -> Result<results::Answer, MishandleError> {
    let mut result = answer.result(resolved, run)?;
    if let results::Answer::Evaluation(found) = &mut result
        && found.screening.is_none()
    {
        found.axis_rates = axis_rates(&RunFile::open_unchecked(run)?)?;
    }
    let falsify = resolved.plan.falsify.as_ref();
    let is_isolated = falsify.is_some_and(|falsify| falsify.isolate == Some(true));
    // Only a target that can fail says why.
    if resolved.plan.requirements.is_empty() && !is_isolated && !resolved.target.can_fail {
        return Ok(result);
    }
    let run = RunFile::open_unchecked(run)?;
    let reasons = reasons(&run)?;
    match &mut result {
        results::Answer::Falsification(found) => {
            (found.requirements, found.reasons) = (requirements(&run)?, reasons);
            for trial in &mut found.trials {
                trial.cause = isolation(&run, trial.trial)?.map(|isolation| isolation.result());
            }
        }
        results::Answer::Evaluation(found) => {
            (found.requirements, found.reasons) = (requirements(&run)?, reasons);
        }
        results::Answer::Margin(found) => found.reasons = reasons,
        results::Answer::Metamorphic(found) => found.reasons = reasons,
        results::Answer::Risk(found) => found.reasons = reasons,
        results::Answer::Hardening(_) => {}
    }
    Ok(result)
}

/// Returns why simulations of a run ended as they did; `None` if no target said so.
pub fn reasons(run: &RunFile) -> Result<Option<Vec<results::EndReasons>>, MishandleError> {
    let reasons = run.reasons()?.into_iter().map(|found| results::EndReasons {
        end: found.end,
        simulations: found.simulations,
        trial: found.trial,
        simulation: found.number,
        reason: found.reason,
    });
    Ok(Some(reasons.collect::<Vec<_>>()).filter(|reasons| !reasons.is_empty()))
}
