use std::ops::ControlFlow;

use mishandle_evaluation::{Evaluation, EvaluationReport, FormulaRoles, Metrics};
use mishandle_rollout::{AxisKind, Request, Scenario, Seed, Space, Target};
use mishandle_store::{RunFile, RunWriter, TrialRecord, TrialStatus, TrialSummary};

use crate::record;
use crate::replay::header;
use crate::{EvaluatePlan, MishandleError, ResolvedPlan, StartRegion};

/// Number of the only trial of an evaluation.
const TRIAL: u32 = 1;

/// Largest number of simulations in an evaluation. Run files store simulation numbers in 32 bits.
const MAX_EPISODES: u64 = 1_000_000_000;

/// The task preset whose completion times include failed episodes, as in the code of the original benchmark.
const COUNTS_FAILURES: &str = "code";

/// Evaluates a target and stores every simulation in `run`.
///
/// `run` is an open run file of the same plan. The simulations that it already contains are counted, not repeated.
/// `watch` gets the number of finished simulations after each batch and can stop the evaluation; the report then
/// covers the finished simulations.
///
/// # Errors
/// If the plan has no table `[evaluate]`, `run` contains other simulations than the plan, or a simulation cannot be
/// run or stored.
pub fn evaluate(
    resolved: &ResolvedPlan,
    mut run: RunWriter,
    mut watch: impl FnMut(u64) -> ControlFlow<()>,
) -> Result<EvaluationReport, MishandleError> {
    let plan = &resolved.plan;
    let evaluate = plan.evaluate.as_ref().ok_or(MishandleError::MissingPlanTable { table: "evaluate" })?;
    header::check(run.file().header(), resolved)?;
    check_trials(resolved, run.file())?;
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
        let expected = evaluation.request(&resolved.space, metrics.simulations() as u32 + 1)?;
        let Request { trial, number, seed, scenario, unit_point, .. } = &episode.request;
        let is_same = (*trial, *number, *seed) == (TRIAL, expected.number, expected.seed)
            && scenario.is_same(&expected.scenario)
            && unit_point.is_empty()
            && u64::from(*number) <= evaluate.episodes;
        if !is_same {
            return Err(MishandleError::SimulationMismatch { number: expected.number });
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

/// Checks that a run has no trial but that of an evaluation.
fn check_trials(resolved: &ResolvedPlan, run: &RunFile) -> Result<(), MishandleError> {
    let episodes = resolved.plan.evaluate.as_ref().map_or(0, |evaluate| evaluate.episodes);
    let mut differences = Vec::new();
    for TrialSummary { trial, counts, .. } in run.trials()? {
        differences.extend(trial_difference(resolved, &trial));
        if trial.status == TrialStatus::BudgetSpent && counts.simulations < episodes {
            differences.push(format!(
                "status of trial {}: recorded as complete, but it has {} of {episodes} simulations",
                trial.number, counts.simulations
            ));
        }
    }
    if differences.is_empty() { Ok(()) } else { Err(MishandleError::RunMismatch { differences }) }
}

/// Describes the difference between a recorded trial and the only trial of an evaluation.
pub(crate) fn trial_difference(resolved: &ResolvedPlan, trial: &TrialRecord) -> Option<String> {
    let TrialRecord { number, seed, status } = *trial;
    let planned = resolved.plan.seed;
    if number != TRIAL {
        Some(format!("trial {number}: an evaluation has only trial {TRIAL}"))
    } else if seed != planned {
        Some(format!("seed of trial {TRIAL}: recorded {seed}, expected {planned}"))
    } else if !matches!(status, TrialStatus::Running | TrialStatus::BudgetSpent) {
        Some(format!("status of trial {TRIAL}: recorded {status:?}, expected Running or BudgetSpent"))
    } else {
        None
    }
}

/// Returns the request of simulation `number` of an evaluation.
pub(crate) fn request(resolved: &ResolvedPlan, number: u32) -> Result<Request, MishandleError> {
    let ResolvedPlan { plan, space, .. } = resolved;
    let starts = plan.evaluate.as_ref().map(|evaluate| evaluate.starts);
    let accepts = |scenario: &Scenario| is_reachable(resolved, scenario);
    let filter = (starts == Some(StartRegion::Reachable)).then_some(&accepts as &dyn Fn(&Scenario) -> bool);
    Ok(Evaluation { filter, ..Evaluation::new(0, Seed(plan.seed)) }.request(space, number)?)
}

fn is_reachable(resolved: &ResolvedPlan, scenario: &Scenario) -> bool {
    resolved.target.reachable.as_ref().is_none_or(|reachable| reachable(&resolved.space, scenario))
}

/// Returns whether the evaluation rejects any scenario as unreachable and draws it again.
///
/// If it rejects none, `box = "reachable"` evaluates the same scenarios as `box = "whole"`.
pub fn rejects_scenarios(resolved: &ResolvedPlan) -> bool {
    let ResolvedPlan { plan, space, .. } = resolved;
    let is_rejected = |index| !is_reachable(resolved, &space.sample(Seed(plan.seed), index));
    let reachable = plan.evaluate.as_ref().filter(|evaluate| evaluate.starts == StartRegion::Reachable);
    reachable.is_some_and(|evaluate| (0..evaluate.episodes).any(is_rejected))
}

/// Checks the evaluation settings of a plan against its target and space.
pub(crate) fn check(evaluate: &EvaluatePlan, target: &Target, space: &Space) -> Result<(), MishandleError> {
    crate::falsify::check_batch(evaluate.batch)?;
    if evaluate.starts == StartRegion::Reachable {
        let unsupported =
            |option| MishandleError::UnsupportedOption { target: target.identity.name.clone(), option };
        target.reachable.as_ref().ok_or_else(|| unsupported("`--box reachable`"))?;
        if space.axes().iter().all(|axis| axis.kind != AxisKind::Start) {
            let expected =
                "a space that contains `starts`, because --box reachable restricts the initial state";
            return Err(MishandleError::InvalidValue {
                what: "the space",
                value: space.name().to_string(),
                expected,
            });
        }
    }
    if (1..=MAX_EPISODES).contains(&evaluate.episodes) {
        return Ok(());
    }
    let (what, expected) = ("the number of episodes", "from 1 to 1000000000");
    Err(MishandleError::InvalidValue { what, value: evaluate.episodes.to_string(), expected })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Plan, create_run};

    #[test]
    fn a_recorded_simulation_that_differs_from_the_plan_is_an_error() {
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
        assert!(matches!(error, MishandleError::SimulationMismatch { number: 1 }), "{error}");
    }
}
