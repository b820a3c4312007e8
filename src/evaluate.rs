use std::ops::ControlFlow;

use mishandle_evaluation::{Evaluation, Metrics, Report};
use mishandle_rollout::{Environment, Seed};
use mishandle_store::{RunWriter, TrialStatus};
use mishandle_tasks::Preset;

use crate::record::{self, Place};
use crate::{EvaluatePlan, MishandleError, Plan, Starts, Subject, preset};

/// An evaluation's simulations are one trial of its run.
const TRIAL: u32 = 1;

/// Most simulations of an evaluation; their numbers are 32 bits in its run.
const MOST: u64 = 1_000_000_000;

/// Measures a controller as `plan` says, and stores every simulation in `run`, an open run file of that plan: those it
/// holds already count and are not run again. `watch` is told how many are done, and may stop.
///
/// # Errors
/// If the plan has nothing to evaluate, or a simulation cannot be run or stored.
pub fn evaluate(
    plan: &Plan,
    subject: &Subject,
    mut run: RunWriter,
    mut watch: impl FnMut(u64) -> ControlFlow<()>,
) -> Result<Report, MishandleError> {
    let evaluate = plan.evaluate.as_ref().ok_or(MishandleError::OtherPlan { wanted: "evaluate" })?;
    let task = subject.task;
    let reachable = move |x0: &[f64]| task.reachable(x0);
    let evaluation = Evaluation {
        accepted: (evaluate.starts == Starts::Reachable).then_some(&reachable as &dyn Fn(&[f64]) -> bool),
        ..Evaluation::new(evaluate.episodes, Seed(plan.seed))
    };
    let mut metrics = match preset(&plan.preset)? {
        Preset::Paper => Metrics::new(),
        Preset::Code => Metrics::with_failures_completing(),
    };
    match run.file().trials()?.is_empty() {
        true => run.start_trial(TRIAL, plan.seed)?,
        false => {
            for simulation in run.file().simulations() {
                let simulation = simulation?;
                let steps = simulation.steps as usize;
                metrics.add_verdict(record::end(&simulation), steps, &record::verdict(&simulation));
            }
        }
    }
    if watch(metrics.simulations()).is_break() {
        return Ok(metrics.report(Seed(plan.seed)));
    }
    let mut system = subject.system()?;
    let report =
        mishandle_evaluation::evaluate(&mut system, &evaluation, &mut metrics, |first, episodes| {
            let records: Vec<_> = (first..)
                .zip(episodes)
                .map(|(index, episode)| {
                    let place = Place { trial: TRIAL, number: index as u32 + 1, unit_point: &[] };
                    record::record(&place, episode)
                })
                .collect();
            run.record(&records)?;
            Ok::<_, MishandleError>(watch(first + episodes.len() as u64))
        })?;
    if report.simulations == evaluate.episodes && run.file().trial(TRIAL)?.status == TrialStatus::Running {
        run.end_trial(TRIAL, TrialStatus::BudgetSpent)?;
    }
    run.close()?;
    Ok(report)
}

/// Whether any start of the plan's evaluation is another than the one drawn first, which was out of reach. If none is,
/// the starts of the reachable part of the box are those of the whole.
pub fn leaves_out_starts(plan: &Plan, subject: &Subject) -> bool {
    let initial_box = subject.environment.initial_box();
    let left_out = |index| !subject.task.reachable(&initial_box.sample(Seed(plan.seed), index));
    let reachable = plan.evaluate.as_ref().filter(|evaluate| evaluate.starts == Starts::Reachable);
    reachable.is_some_and(|evaluate| (0..evaluate.episodes).any(left_out))
}

/// Checks what an evaluation is asked to do.
pub(crate) fn check(evaluate: &EvaluatePlan) -> Result<(), MishandleError> {
    if (1..=MOST).contains(&evaluate.episodes) {
        return Ok(());
    }
    let (what, wanted) = ("the number of episodes", "from 1 to 1000000000");
    Err(MishandleError::Value { what, value: evaluate.episodes.to_string(), wanted })
}
