use std::ops::ControlFlow;

use mishandle_evaluation::{Evaluation, EvaluationReport, FormulaRoles, Metrics};
use mishandle_rollout::{AxisKind, Request, Scenario, Seed, Space, Target};
use mishandle_store::{RunWriter, TrialStatus};

use crate::record;
use crate::{EvaluatePlan, MishandleError, ResolvedPlan, StartRegion};

/// An evaluation's simulations are one trial of its run.
const TRIAL: u32 = 1;

/// Most simulations of an evaluation; their numbers are 32 bits in its run.
const MOST: u64 = 1_000_000_000;

/// The task preset whose completion times count failures, too, as in the original benchmark's code.
const COUNTS_FAILURES: &str = "code";

/// Measures a target as its plan says, and stores every simulation in `run`, an open run file of that plan: those it
/// holds already count and are not run again. `watch` is told how many are done, and may stop.
///
/// # Errors
/// If the plan has nothing to evaluate, or a simulation cannot be run or stored.
pub fn evaluate(
    resolved: &ResolvedPlan,
    mut run: RunWriter,
    mut watch: impl FnMut(u64) -> ControlFlow<()>,
) -> Result<EvaluationReport, MishandleError> {
    let plan = &resolved.plan;
    let evaluate = plan.evaluate.as_ref().ok_or(MishandleError::OtherPlan { wanted: "evaluate" })?;
    let accepts = |scenario: &Scenario| is_reachable(resolved, scenario);
    let evaluation = Evaluation {
        filter: (evaluate.starts == StartRegion::Reachable).then_some(&accepts as &dyn Fn(&Scenario) -> bool),
        batch: evaluate.batch as usize,
        ..Evaluation::new(evaluate.episodes, Seed(plan.seed))
    };
    let mut metrics = Metrics::new(FormulaRoles::of(&resolved.specification))
        .with_completion_times_of_failures(plan.preset == COUNTS_FAILURES);
    if run.file().trials()?.is_empty() {
        run.start_trial(TRIAL, plan.seed)?;
    }
    for simulation in run.file().simulations() {
        let episode = record::episode(&simulation?)?;
        let asked = evaluation.request(&resolved.space, metrics.simulations() as u32 + 1)?;
        let Request { number, seed, scenario, .. } = &episode.request;
        if (*number, *seed) != (asked.number, asked.seed) || !scenario.is_same(&asked.scenario) {
            return Err(MishandleError::OtherSimulation { number: asked.number });
        }
        metrics.add(&episode);
    }
    if watch(metrics.simulations()).is_break() {
        return Ok(metrics.report(Seed(plan.seed)));
    }
    let mut done = metrics.simulations();
    let mut system = resolved.system()?;
    let report = mishandle_evaluation::evaluate(&mut *system, &evaluation, &mut metrics, |episodes| {
        run.record(&episodes.iter().map(|episode| record::record(episode, 0)).collect::<Vec<_>>())?;
        done += episodes.len() as u64;
        Ok::<_, MishandleError>(watch(done))
    })?;
    if report.simulations == evaluate.episodes && run.file().trial(TRIAL)?.status == TrialStatus::Running {
        run.end_trial(TRIAL, TrialStatus::BudgetSpent)?;
    }
    run.close()?;
    Ok(report)
}

fn is_reachable(resolved: &ResolvedPlan, scenario: &Scenario) -> bool {
    resolved.target.reachable.as_ref().is_none_or(|reachable| reachable(&resolved.space, scenario))
}

/// Whether any scenario of the plan's evaluation is another than the one drawn first, which was out of reach. If none is,
/// the scenarios of the reachable part of the space are those of the whole.
pub fn leaves_out_starts(resolved: &ResolvedPlan) -> bool {
    let ResolvedPlan { plan, space, .. } = resolved;
    let left_out = |index| !is_reachable(resolved, &space.sample(Seed(plan.seed), index));
    let reachable = plan.evaluate.as_ref().filter(|evaluate| evaluate.starts == StartRegion::Reachable);
    reachable.is_some_and(|evaluate| (0..evaluate.episodes).any(left_out))
}

/// Checks what an evaluation is asked to do in a space.
pub(crate) fn check(evaluate: &EvaluatePlan, target: &Target, space: &Space) -> Result<(), MishandleError> {
    crate::falsify::check_batch(evaluate.batch)?;
    if evaluate.starts == StartRegion::Reachable {
        let refused = |option| MishandleError::NotForTarget { target: target.identity.name.clone(), option };
        target.reachable.as_ref().ok_or_else(|| refused("reachable part of the box"))?;
        if space.axes().iter().all(|axis| axis.kind != AxisKind::Start) {
            let wanted =
                "a space with the axes of `starts`, for its starts to be from the reachable part of the box";
            return Err(MishandleError::Value { what: "the space", value: space.name().to_string(), wanted });
        }
    }
    if (1..=MOST).contains(&evaluate.episodes) {
        return Ok(());
    }
    let (what, wanted) = ("the number of episodes", "from 1 to 1000000000");
    Err(MishandleError::Value { what, value: evaluate.episodes.to_string(), wanted })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Plan, create_run};

    #[test]
    fn a_simulation_that_the_plan_does_not_ask_for_is_not_counted() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.sqlite");
        let plan = EvaluatePlan { episodes: 3, ..EvaluatePlan::default() };
        let resolved =
            ResolvedPlan::new(&Plan { evaluate: Some(plan), ..Plan::new("toy/sphere-2d", "") }).unwrap();
        let mut run = create_run(&resolved, Some(&path)).unwrap();
        run.start_trial(TRIAL, 0).unwrap();
        let other = Evaluation::new(3, Seed(9)).request(&resolved.space, 1).unwrap();
        let episodes = resolved.system().unwrap().rollout(&[other]).unwrap();
        run.record(&[record::record(&episodes[0], 0)]).unwrap();
        let error = evaluate(&resolved, run, |_| ControlFlow::Continue(())).unwrap_err();
        assert!(matches!(error, MishandleError::OtherSimulation { number: 1 }), "{error}");
    }
}
