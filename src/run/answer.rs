//! Parts of an answer that its run file has: no simulation is necessary.

use mishandle_results::{Answer, EndReasons};
use mishandle_store::RunFile;

use crate::error::MishandleError;
use crate::plan::Plan;
use crate::run::axis_rates::axis_rates;
use crate::run::cause::isolation;
use crate::run::requirements::requirements;
use crate::run::vacuity;
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
            found.warnings.clone_from(&run.header().preflight);
            found.asks_nothing = vacuity::of_search(run)?;
        }
        Answer::Margin(found) => found.without_verdict = without_verdict,
        Answer::Metamorphic(found) => found.without_verdict = without_verdict,
        Answer::Risk(found) => found.without_verdict = without_verdict,
        Answer::Hardening(found) => found.without_verdict = without_verdict,
    }
    if let Answer::Evaluation(found) = answer
        && found.screening.is_none()
    {
        found.axis_rates = axis_rates(run)?;
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
                trial.cause = isolation(run, trial.trial)?.map(|isolation| isolation.result());
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
