pub(crate) mod arm;
pub(crate) mod pairs;
pub(crate) mod progress;
mod rule;

use std::ops::ControlFlow;

use mishandle_evaluation::{
    CornerCounter, Corners, Evaluation, EvaluationError, FormulaRoles, ScreenedProgress, evaluate_corners,
    evaluate_screened,
};
use mishandle_results::{Answer, Command, Remedy};
use mishandle_rollout::{Request, Scenario, Seed, Space};
use mishandle_store::{RANDOM_TRIAL, RunFile, TrialRecord, TrialStatus, TrialSummary};
use mishandle_text::plural;

use crate::error::{Compared, MishandleError, invalid};
use crate::plan::{ScreeningPlan, StartRegion};
use crate::resolve::ResolvedPlan;
use crate::run::ask::{Found, Progress, Watch};
use crate::run::evaluation::arm::ControlArm;
use crate::run::evaluation::progress::{Evaluating, stops_by_itself};
use crate::run::journal::Journal;
use crate::run::result::screened_evaluation_result;

/// The simulations of an evaluation: a function of the plan and the space.
pub(crate) struct Requests<'a> {
    pub random: Evaluation<'a>,
    pub corners: Option<Corners>,
    pub control: Option<ControlArm>,
    space: &'a Space,
}

impl Requests<'_> {
    /// Returns the request of a simulation; `None` if the plan has no such simulation.
    pub(crate) fn request(&self, trial: u32, number: u32) -> Result<Option<Request>, MishandleError> {
        if trial == Corners::TRIAL {
            return Ok(self.corners.as_ref().and_then(|corners| corners.request(number)));
        }
        let planned = match (trial, &self.control) {
            (RANDOM_TRIAL, _) => self.random.episodes,
            (arm::TRIAL, Some(arm)) => arm.simulations(self.random.episodes),
            _ => 0,
        };
        if !(1..=planned).contains(&number.into()) {
            return Ok(None);
        }
        let random = self.random.request(self.space, number)?;
        Ok(Some(match &self.control {
            Some(arm) if trial == arm::TRIAL => arm.request(&random),
            _ => random,
        }))
    }

    /// Returns the numbers of the trials.
    pub(crate) fn trials(&self) -> impl Iterator<Item = u32> {
        let corners = self.corners.as_ref().map(|_| Corners::TRIAL);
        let control = self.control.as_ref().map(|_| arm::TRIAL);
        [Some(RANDOM_TRIAL), corners, control].into_iter().flatten()
    }
}

/// Calls `with` with the simulations of the plan.
pub(crate) fn with_requests<T>(
    resolved: &ResolvedPlan,
    with: impl FnOnce(&Requests<'_>) -> Result<T, MishandleError>,
) -> Result<T, MishandleError> {
    let evaluate =
        resolved.plan.evaluate.as_ref().ok_or(MishandleError::MissingPlanTable { table: "evaluate" })?;
    let accepts = |scenario: &Scenario| is_reachable(resolved, scenario);
    let random = Evaluation {
        filter: (evaluate.starts == StartRegion::Reachable).then_some(&accepts as &dyn Fn(&Scenario) -> bool),
        batch: evaluate.batch as usize,
        ..Evaluation::new(evaluate.episodes, Seed(resolved.plan.seed))
    };
    let control = ControlArm::new(resolved)?;
    with(&Requests { random, corners: corners(resolved), control, space: &resolved.space })
}

/// Returns the corner simulations of the plan.
fn corners(resolved: &ResolvedPlan) -> Option<Corners> {
    let ResolvedPlan { plan, space, .. } = resolved;
    plan.evaluate.as_ref().filter(|evaluate| evaluate.corners)?;
    Corners::new(space, crate::resolve::space_depends_on_seed(resolved), Seed(plan.seed))
}

/// Returns the number of simulations of an evaluation: the random ones, those of the corners and
/// the center, and those of the control arm; the largest one if a rule ends the evaluation.
///
/// # Errors
/// If the axes of the control arm make no space.
pub fn evaluation_simulations(resolved: &ResolvedPlan) -> Result<u64, MishandleError> {
    let mut sum = 0;
    for trial in [RANDOM_TRIAL, Corners::TRIAL, arm::TRIAL] {
        sum += planned_simulations(resolved, trial)?.unwrap_or(0);
    }
    Ok(sum)
}

/// Returns the number of simulations of a trial of an evaluation; `None` if its plan has no such
/// trial.
fn planned_simulations(resolved: &ResolvedPlan, trial: u32) -> Result<Option<u64>, MishandleError> {
    let episodes = resolved.plan.evaluate.as_ref().map_or(0, |evaluate| evaluate.episodes);
    Ok(match trial {
        RANDOM_TRIAL => Some(episodes),
        Corners::TRIAL => corners(resolved).map(|corners| corners.simulations().into()),
        arm::TRIAL => ControlArm::new(resolved)?.map(|arm| arm.simulations(episodes)),
        _ => None,
    })
}

/// Returns the request that the plan of an evaluation derives for a simulation; `None` if it has no
/// such simulation.
///
/// A recorded simulation with another scenario or seed does not belong to the plan.
///
/// # Errors
/// If the plan has no table `[evaluate]`, or no scenario is reachable.
pub fn evaluation_request(
    resolved: &ResolvedPlan,
    trial: u32,
    number: u32,
) -> Result<Option<Request>, MishandleError> {
    with_requests(resolved, |requests| requests.request(trial, number))
}

/// Evaluates a target: the random simulations are trial 1, those of the corners trial 2, those of
/// the control arm a derived trial.
///
/// The recorded simulations are counted, not repeated. `watch` can stop the evaluation; the answer
/// then covers the finished simulations.
pub(super) fn ask(journal: &Journal<'_>, watch: Watch<'_>) -> Result<Found, MishandleError> {
    let resolved = journal.resolved();
    if let Some(plan) = &resolved.plan.screening {
        return screened(journal, plan, watch);
    }
    if resolved.plan.compare.is_some() && !journal.is_read_only() {
        let what = "the plan of the run";
        let value = "one of a comparison that stops by itself".to_string();
        let both = Remedy::Run(Command::ResumeComparison { is_python: false });
        return Err(invalid(what, value, "continued together with the other run").with(both));
    }
    let max_simulations = evaluation_simulations(resolved)?;
    let mut watch = |simulations| watch(&Progress { simulations, max_simulations, ..Progress::default() });
    with_requests(resolved, |requests| {
        let mut evaluating = Evaluating::open(journal, requests, |_| {})?;
        if journal.is_read_only() || watch(evaluating.done()).is_break() {
            return Ok(evaluating.found());
        }
        let on_batch = &mut |done, _: &[_]| watch(done);
        match evaluating.advance(requests.random.episodes, on_batch)? {
            ControlFlow::Continue(()) => evaluating.finish(on_batch),
            ControlFlow::Break(()) => Ok(evaluating.found()),
        }
    })
}

/// Evaluates a target by screening: see
/// [`evaluate_screened`](mishandle_evaluation::evaluate_screened()). The corners are all from the
/// target's system.
fn screened(journal: &Journal<'_>, plan: &ScreeningPlan, watch: Watch<'_>) -> Result<Found, MishandleError> {
    let resolved = journal.resolved();
    let max_simulations = resolved.plan.evaluate.as_ref().map_or(0, |evaluate| evaluate.episodes);
    let mut watch = |progress: ScreenedProgress| {
        watch(&Progress { simulations: progress.screened, max_simulations, ..Progress::default() })
    };
    let mut screen = journal.screening();
    let mut system = journal.system(None);
    let roles = FormulaRoles::of(&resolved.specification);
    let found = with_requests(resolved, |requests| {
        let mut report =
            evaluate_screened(&mut screen, &mut system, &requests.random, roles, plan.confirm, &mut watch)?;
        let Some(corners) = requests.corners.as_ref().filter(|_| report.is_complete) else {
            return Ok((report, None));
        };
        let progress = ScreenedProgress { screened: report.failures.trials, confirmed: report.confirmed() };
        let mut found = corner_counter(resolved, corners);
        let mut is_stopped = false;
        evaluate_corners(&mut system, corners, requests.random.batch, &mut found, |_| {
            let flow = watch(progress);
            is_stopped |= flow.is_break();
            Ok::<_, EvaluationError>(flow)
        })?;
        report.is_complete = !is_stopped;
        Ok((report, (!is_stopped).then_some(found)))
    });
    let (report, corners) = journal.result(found)?;
    let trials = [Some(RANDOM_TRIAL), corners.as_ref().map(|_| Corners::TRIAL)];
    let trials = trials.into_iter().flatten().filter(|_| report.is_complete);
    let ended = trials.map(|trial| (trial, TrialStatus::BudgetSpent)).collect();
    let found = screened_evaluation_result(resolved, &report, corners.as_ref(), &journal.path());
    Ok(Found { answer: Answer::Evaluation(Box::new(found)), ended, is_checked: false })
}

/// Counts no simulation of the corners yet.
pub(crate) fn corner_counter(resolved: &ResolvedPlan, corners: &Corners) -> CornerCounter {
    let starts = resolved.plan.evaluate.as_ref().map(|evaluate| evaluate.starts);
    let reachable = |scenario: &Scenario| {
        resolved.target.reachable.as_ref().map(|reachable| reachable(&resolved.space, scenario))
    };
    corners.counter(
        FormulaRoles::of(&resolved.specification),
        starts == Some(StartRegion::Reachable),
        reachable,
    )
}

/// Checks that a run has no trials but those of an evaluation.
pub(crate) fn check_trials(resolved: &ResolvedPlan, run: &RunFile) -> Result<(), MishandleError> {
    let differences = trial_differences(resolved, run)?;
    if differences.is_empty() { Ok(()) } else { Err(MishandleError::differs(Compared::Plan, differences)) }
}

/// Lists the differences between the trials of a run and those that the plan of an evaluation
/// implies. A forged run can have others.
pub(crate) fn trial_differences(
    resolved: &ResolvedPlan,
    run: &RunFile,
) -> Result<Vec<String>, MishandleError> {
    let mut differences = Vec::new();
    for TrialSummary { trial, counts, .. } in run.trials()?.into_iter().chain(run.derived_trials()?) {
        let last = run.last_simulation_number(trial.number)?;
        differences.extend(trial_difference(resolved, &trial, counts.simulations, last)?);
    }
    Ok(differences)
}

/// Describes the difference between a recorded trial with this number of simulations, the last of
/// which has the number `last`, and the trial that the plan of an evaluation implies.
fn trial_difference(
    resolved: &ResolvedPlan,
    trial: &TrialRecord,
    simulations: u64,
    last: u32,
) -> Result<Option<String>, MishandleError> {
    let TrialRecord { number, seed, status } = *trial;
    let Some(planned) = planned_simulations(resolved, number)? else {
        return Ok(Some(format!("trial {number}: the plan has no such trial")));
    };
    // Then the rows decide, which are checked one by one.
    let may_be_fewer = stops_by_itself(&resolved.plan) && number != Corners::TRIAL;
    let expected = resolved.plan.seed;
    Ok(if seed != expected {
        Some(format!("seed of trial {number}: recorded {seed}, expected {expected}"))
    } else if !matches!(status, TrialStatus::Running | TrialStatus::BudgetSpent) {
        Some(format!("status of trial {number}: recorded {status:?}, expected Running or BudgetSpent"))
    } else if simulations != u64::from(last) {
        Some(format!(
            "trial {number}: its last simulation has the number {last}, but it has {}",
            plural(simulations, "simulation")
        ))
    } else if simulations > planned {
        let planned = plural(planned, "simulation");
        Some(format!("trial {number}: it has {simulations} simulations, but the plan has {planned}"))
    } else if status == TrialStatus::BudgetSpent && simulations < planned && !may_be_fewer {
        Some(format!(
            "status of trial {number}: recorded as complete, but it has {simulations} of {}",
            plural(planned, "simulation")
        ))
    } else {
        None
    })
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

#[cfg(test)]
mod tests {
    use mishandle_results::CornerPoint;
    use mishandle_store::RunWriter;

    use super::*;
    use crate::error::RunError;
    use crate::plan::{EvaluatePlan, Plan};
    use crate::run::{Engine, create_run, rows};

    fn evaluate(
        resolved: &ResolvedPlan,
        run: RunWriter,
        mut watch: impl FnMut() -> ControlFlow<()> + Send,
    ) -> Result<mishandle_results::Evaluation, MishandleError> {
        Ok(crate::run::ask(resolved, run, Engine::Direct, &mut |_| watch())?.try_into()?)
    }

    #[test]
    fn a_recorded_simulation_that_differs_from_the_plan_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.sqlite");
        let plan = EvaluatePlan { episodes: 3, ..EvaluatePlan::default() };
        let resolved =
            ResolvedPlan::new(&Plan { evaluate: Some(plan), ..Plan::new("toy/sphere-2d", "") }).unwrap();
        let mut run = create_run(&resolved, Some(&path)).unwrap();
        run.start_trial(RANDOM_TRIAL, 0).unwrap();
        let other = Evaluation::new(3, Seed(9)).request(&resolved.space, 1).unwrap();
        let episodes = resolved.system().unwrap().rollout(&[other]).unwrap();
        run.record(&[rows::row(&episodes[0], &resolved)]).unwrap();
        let error = evaluate(&resolved, run, || ControlFlow::Continue(())).unwrap_err();
        assert!(matches!(error, MishandleError::Run(RunError::OtherRequest { number: 1, .. })), "{error}");
    }

    fn toy(name: &str, episodes: u64) -> ResolvedPlan {
        let plan = EvaluatePlan { episodes, batch: 8, ..EvaluatePlan::default() };
        ResolvedPlan::new(&Plan { evaluate: Some(plan), ..Plan::new(name, "") }).unwrap()
    }

    #[test]
    fn the_corners_of_the_box_are_trial_2_and_are_resumed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.sqlite");
        let other = folder.path().join("other.sqlite");
        let resolved = toy("toy/noisy", 10);
        let run = create_run(&resolved, Some(&path)).unwrap();
        let whole = evaluate(&resolved, run, || ControlFlow::Continue(())).unwrap();
        // One axis has two corners and a center, and the noise needs 20 seeds.
        let corners = whole.corners.clone().unwrap();
        assert!(whole.is_complete && evaluation_simulations(&resolved).unwrap() == 70);
        assert_eq!(corners.points.iter().map(|point| point.n).collect::<Vec<_>>(), [20, 20, 20]);
        let values = |point: &CornerPoint| point.scenario.values().next().copied().flatten().unwrap();
        assert_eq!(corners.points.iter().map(values).collect::<Vec<_>>(), [0.0, 1.0, 0.5]);

        // Two stops are in the random simulations, the third is in the corners.
        let mut stopped = create_run(&resolved, Some(&other)).unwrap();
        for _ in 0..3 {
            let mut batches = 0;
            let outcome = evaluate(&resolved, stopped, || {
                batches += 1;
                if batches > 1 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            });
            assert!(!outcome.unwrap().is_complete);
            stopped = RunWriter::resume(&other).unwrap();
        }
        let resumed = evaluate(&resolved, stopped, || ControlFlow::Continue(())).unwrap();
        assert_eq!((resumed.metrics, resumed.corners), (whole.metrics, whole.corners));

        let file = RunFile::open(&path).unwrap();
        let counts: Vec<usize> = [1, 2]
            .map(|trial| file.simulations().filter(|found| found.as_ref().unwrap().trial == trial).count())
            .to_vec();
        assert_eq!(counts, [10, 60]);
        assert!(file.trials().unwrap().iter().all(|trial| trial.trial.status == TrialStatus::BudgetSpent));
        for number in [1, 20, 21, 60] {
            let recorded = file.simulation(2, number).unwrap();
            let expected = evaluation_request(&resolved, 2, number).unwrap().unwrap();
            assert_eq!(
                (recorded.seed, &recorded.scenario[..]),
                (expected.seed.0, expected.scenario.values())
            );
            assert!(crate::replay::replay(&file, 2, number, None).unwrap().differences.is_empty());
        }
        assert_eq!(evaluation_request(&resolved, 2, 61).unwrap(), None);
        assert_eq!(evaluation_request(&resolved, 1, 11).unwrap(), None);
    }

    #[test]
    fn a_run_that_was_killed_before_it_started_the_corners_gets_them_when_it_is_resumed() {
        let folder = tempfile::tempdir().unwrap();
        let resolved = toy("toy/sphere-2d", 3);
        let mut run = create_run(&resolved, Some(&folder.path().join("run.sqlite"))).unwrap();
        run.start_trial(RANDOM_TRIAL, 0).unwrap();
        let found = evaluate(&resolved, run, || ControlFlow::Continue(())).unwrap();
        let corners: u32 = found.corners.unwrap().points.iter().map(|point| point.n).sum();
        assert_eq!((found.metrics.simulations, corners), (3, 5));
        assert!(found.is_complete);
    }

    #[test]
    fn a_space_without_initial_states_has_no_corners() {
        let folder = tempfile::tempdir().unwrap();
        let plan = EvaluatePlan { episodes: 2, ..EvaluatePlan::default() };
        let plan = Plan { evaluate: Some(plan), space: "noise".to_string(), ..Plan::new("toy/noisy", "") };
        let resolved = ResolvedPlan::new(&plan).unwrap();
        let run = create_run(&resolved, Some(&folder.path().join("run.sqlite"))).unwrap();
        let outcome = evaluate(&resolved, run, || ControlFlow::Continue(())).unwrap();
        assert_eq!((outcome.corners, outcome.is_complete), (None, true));
    }
}
