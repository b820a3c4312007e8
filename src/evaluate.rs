use std::ops::ControlFlow;

use mishandle_evaluation::{Evaluation, Metrics, Report, Roles};
use mishandle_rollout::{Scenario, Seed};
use mishandle_store::{RunWriter, TrialStatus};

use crate::record;
use crate::{EvaluatePlan, MishandleError, Resolved, Starts};

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
    resolved: &Resolved,
    mut run: RunWriter,
    mut watch: impl FnMut(u64) -> ControlFlow<()>,
) -> Result<Report, MishandleError> {
    let plan = &resolved.plan;
    let evaluate = plan.evaluate.as_ref().ok_or(MishandleError::OtherPlan { wanted: "evaluate" })?;
    let accepts = |scenario: &Scenario| is_reachable(resolved, scenario);
    let evaluation = Evaluation {
        accepted: (evaluate.starts == Starts::Reachable).then_some(&accepts as &dyn Fn(&Scenario) -> bool),
        batch: evaluate.batch as usize,
        ..Evaluation::new(evaluate.episodes, Seed(plan.seed))
    };
    let mut metrics = Metrics::new(Roles::of(&resolved.specification))
        .with_failures_completing(plan.preset == COUNTS_FAILURES);
    if run.file().trials()?.is_empty() {
        run.start_trial(TRIAL, plan.seed)?;
    }
    for simulation in run.file().simulations() {
        metrics.add(&record::episode(&simulation?)?);
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

fn is_reachable(resolved: &Resolved, scenario: &Scenario) -> bool {
    resolved.target.reachable.as_ref().is_none_or(|reachable| reachable(&resolved.space, scenario))
}

/// Whether any scenario of the plan's evaluation is another than the one drawn first, which was out of reach. If none is,
/// the scenarios of the reachable part of the space are those of the whole.
pub fn leaves_out_starts(resolved: &Resolved) -> bool {
    let Resolved { plan, space, .. } = resolved;
    let left_out = |index| !is_reachable(resolved, &space.sample(Seed(plan.seed), index));
    let reachable = plan.evaluate.as_ref().filter(|evaluate| evaluate.starts == Starts::Reachable);
    reachable.is_some_and(|evaluate| (0..evaluate.episodes).any(left_out))
}

/// Checks what an evaluation is asked to do.
pub(crate) fn check(evaluate: &EvaluatePlan) -> Result<(), MishandleError> {
    crate::falsify::check_batch(evaluate.batch)?;
    if (1..=MOST).contains(&evaluate.episodes) {
        return Ok(());
    }
    let (what, wanted) = ("the number of episodes", "from 1 to 1000000000");
    Err(MishandleError::Value { what, value: evaluate.episodes.to_string(), wanted })
}
