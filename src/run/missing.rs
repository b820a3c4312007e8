//! Whether a recorded run is complete.

use mishandle_store::{RANDOM_TRIAL, RunFile, RunKind, TrialStatus};
use mishandle_text::plural;

use crate::error::MishandleError;
use crate::plan::Plan;
use crate::resolve::ResolvedPlan;
use crate::run::ask::recorded_answer;
use crate::run::evaluation::progress::stops_by_itself;

/// Describes what a run lacks that its plan asks for, such as `40 of 100 simulations`; `None` if it
/// is complete.
///
/// It needs only the run file, not the target.
///
/// # Errors
/// If the run file cannot be read.
pub fn unfinished(run: &RunFile) -> Result<Option<String>, MishandleError> {
    let trials = run.trials()?;
    let plan = Plan::from_toml(&run.header().plan).ok();
    let has = |found: u64, planned: u64, noun: &str| {
        (found < planned).then(|| format!("it has {found} of {}", plural(planned, noun)))
    };
    let screened = plan.as_ref().is_some_and(|plan| plan.screening.is_some());
    let missing = match run.header().kind {
        // A device proposes simulations that are not rows.
        RunKind::Evaluate | RunKind::Risk | RunKind::Margin | RunKind::Metamorphic if screened => {
            trials.is_empty().then(|| "it has no simulation".to_string())
        }
        RunKind::Margin | RunKind::Metamorphic => {
            trials.is_empty().then(|| "it has no simulation".to_string())
        }
        RunKind::Risk => {
            let planned = plan.and_then(|plan| plan.risk).map_or(1, |risk| risk.simulations);
            has(trials.iter().map(|found| found.counts.simulations).sum(), planned, "simulation")
        }
        RunKind::Falsify => {
            let falsify = plan.and_then(|plan| plan.falsify);
            let planned = falsify.as_ref().map_or(1, |falsify| u64::from(falsify.trials));
            let is_isolated = falsify.is_some_and(|falsify| falsify.isolate == Some(true)) && !screened;
            let falsified =
                trials.iter().filter(|found| found.trial.status == TrialStatus::Falsified).count();
            let done = run.derived_trials()?;
            let done = done.iter().filter(|found| found.trial.status != TrialStatus::Running).count();
            let isolated = || has(done as u64, falsified as u64, "counterexample, moved toward nominal");
            let isolated = || if is_isolated { isolated() } else { None };
            has(trials.len() as u64, planned, "trial").or_else(isolated)
        }
        // The rule decides, so only the status says whether it did.
        RunKind::Evaluate if plan.as_ref().is_some_and(stops_by_itself) => {
            trials.is_empty().then(|| "it has no simulation".to_string())
        }
        RunKind::Evaluate => {
            let planned = plan.and_then(|plan| plan.evaluate).map_or(1, |evaluate| evaluate.episodes);
            let random = trials.iter().find(|found| found.trial.number == RANDOM_TRIAL);
            has(random.map_or(0, |found| found.counts.simulations), planned, "random simulation")
        }
    };
    let control = run.derived_trials()?.into_iter().filter(|_| run.header().kind == RunKind::Evaluate);
    let is_control_missing =
        control.map(|found| found.trial.status).any(|status| status == TrialStatus::Running);
    let missing = missing.or_else(|| is_control_missing.then(|| "its control arm has not ended".to_string()));
    let running = trials.iter().find(|found| found.trial.status == TrialStatus::Running);
    Ok(missing.or(running.map(|found| format!("trial {} has not ended", found.trial.number))))
}

/// Describes what a run lacks, as [`unfinished`] does, and also what only the target shows: trials
/// of corners and of the control arm, and simulations that the question still asks. A forged run
/// can lack them although its rows say that it is complete.
///
/// # Errors
/// If the run file cannot be read.
pub fn missing(run: &RunFile, resolved: &ResolvedPlan) -> Result<Option<String>, MishandleError> {
    if let Some(missing) = unfinished(run)? {
        return Ok(Some(missing));
    }
    Ok(match recorded_answer(run, Some(resolved)) {
        Ok(answer) if answer.is_complete() => None,
        Ok(_) => Some("its question asks for further simulations".to_string()),
        Err(error) => Some(error.to_string()),
    })
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;

    use super::*;
    use crate::plan::EvaluatePlan;
    use crate::run::{Engine, Progress, ask, create_run};

    #[test]
    fn an_evaluation_is_complete_after_its_last_simulation() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.sqlite");
        let evaluation = EvaluatePlan { episodes: 4, batch: 2, ..EvaluatePlan::default() };
        let plan = Plan { evaluate: Some(evaluation), ..Plan::new("toy/sphere-2d", "") };
        let resolved = ResolvedPlan::new(&plan).unwrap();
        create_run(&resolved, Some(&path)).unwrap().close().unwrap();
        let missing = || unfinished(&RunFile::open(&path).unwrap()).unwrap();
        assert_eq!(missing().unwrap(), "it has 0 of 4 random simulations");
        // The last stop is in the corners: a corner and the center are missing.
        for (stop, expected) in [
            (2, Some("it has 2 of 4 random simulations")),
            (6, Some("trial 1 has not ended")),
            (u64::MAX, None),
        ] {
            let run = mishandle_store::RunWriter::resume(&path).unwrap();
            let mut watch = |progress: &Progress| {
                if progress.simulations >= stop { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            };
            ask(&resolved, run, Engine::Direct, &mut watch).unwrap();
            assert_eq!(missing().as_deref(), expected);
        }
    }
}
