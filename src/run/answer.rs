//! Parts of an answer that its run file has: no simulation is necessary.

use mishandle_results::{Answer, EndReasons};
use mishandle_store::RunFile;

use crate::error::MishandleError;
use crate::plan::Plan;
use crate::run::axis_rates::axis_rates;
use crate::run::cause::isolation;
use crate::run::findings::add_findings;
use crate::run::requirements::requirements;
use crate::run::vacuity;
use crate::run::violation::{broken_formulas, recorded_violation};
use crate::run::warnings::warnings;
use crate::run::without_verdict::without_verdict;

/// Adds the share of simulations without a verdict, the success rates over the values of axes, the
/// named requirements, the reasons of ends, and the causes of counterexamples.
pub(super) fn add_recorded_parts(
    answer: &mut Answer,
    run: &RunFile,
    plan: &Plan,
    can_fail: bool,
) -> Result<(), MishandleError> {
    let without_verdict = without_verdict(answer, run, plan.max_without_verdict)?;
    match answer {
        Answer::Evaluation(found) => found.without_verdict = without_verdict,
        Answer::Falsification(found) => {
            found.without_verdict = without_verdict;
            found.warnings = warnings(run)?;
            add_findings(found, run)?;
            found.asks_nothing = asks_nothing_in(run)?;
            for trial in found.trials.iter_mut().filter(|trial| trial.falsified) {
                let Some(simulation) = trial.simulation else { continue };
                trial.violation = recorded_violation(run, trial.trial, simulation)?;
            }
        }
        Answer::Margin(found) => {
            found.without_verdict = without_verdict;
            found.asks_nothing = asks_nothing_in(run)?;
            if found.asks_nothing.is_some() {
                found.no_violation_up_to = None;
                found.no_violation_simulations = None;
                found.no_violation_seeds = None;
                found.no_violation_is_exhaustive = None;
            }
        }
        Answer::Metamorphic(found) => {
            found.without_verdict = without_verdict;
            found.asks_nothing = asks_nothing_in(run)?;
        }
        Answer::Risk(found) => {
            found.without_verdict = without_verdict;
            found.asks_nothing = asks_nothing_in(run)?;
        }
        Answer::Hardening(found) => found.without_verdict = without_verdict,
    }
    if let Answer::Evaluation(found) = answer
        && found.screening.is_none()
    {
        found.asks_nothing = asks_nothing_in(run)?;
        found.axis_rates = axis_rates(run)?;
        found.breaks = broken_formulas(run)?;
    }
    let falsify = plan.falsify.as_ref();
    let is_isolated = falsify.is_some_and(|falsify| falsify.isolate == Some(true));
    // Only a target that can fail says why.
    if plan.requirements.is_empty() && !is_isolated && !can_fail {
        return Ok(());
    }
    let reasons = reasons(run)?;
    match answer {
        Answer::Falsification(found) => {
            found.requirements = requirements(run)?;
            found.reasons = reasons;
            for trial in &mut found.trials {
                let isolation = isolation(run, trial.trial)?;
                trial.cause = isolation.map(|isolation| isolation.result(run)).transpose()?;
            }
        }
        Answer::Evaluation(found) => {
            found.requirements = requirements(run)?;
            found.reasons = reasons;
        }
        Answer::Margin(found) => found.reasons = reasons,
        Answer::Metamorphic(found) => found.reasons = reasons,
        Answer::Risk(found) => found.reasons = reasons,
        Answer::Hardening(_) => {}
    }
    Ok(())
}

/// Returns why no simulation of a run asks anything with the formula of its question; `None` if one
/// does.
///
/// # Errors
/// If the run cannot be read.
pub(crate) fn asks_nothing_in(run: &RunFile) -> Result<Option<String>, MishandleError> {
    vacuity::of_question(run)
}

/// Returns why simulations of a run ended as they did; `None` if no target said so.
fn reasons(run: &RunFile) -> Result<Option<Vec<EndReasons>>, MishandleError> {
    let reasons = run.reasons()?.into_iter().map(|found| EndReasons {
        end: found.end,
        simulations: found.simulations,
        trial: found.trial,
        simulation: found.number,
        reason: found.reason,
    });
    Ok(Some(reasons.collect::<Vec<_>>()).filter(|reasons| !reasons.is_empty()))
}
