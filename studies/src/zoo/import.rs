//! Takes in training runs that ended, here or elsewhere: checks them, measures them, puts their
//! files in place.

use std::fs;
use std::path::Path;

use mishandle::train::Curve;
use mishandle::training::{AlgorithmSettings, Validation};

use crate::zoo::folder::{read, remove, write};
use crate::zoo::measure::Bench;
use crate::zoo::plan_entry::{CONTROLLER, CURVE};
use crate::zoo::{
    BenchmarkTask, CurveFileProblem, PlanEntry, StoredCurve, Training, TrainingInputs, TrainingSummary,
    TrainingTime, ZooError, ZooObserver,
};

/// Takes in a controller and the curve of its training run.
///
/// The file that marks the training run as done, the controller, is written last.
///
/// # Errors
/// If the training run differs from the plan or has not ended, or its controller cannot be
/// measured. Nothing is put in place then.
pub(crate) fn take_in(
    bench: &Bench<'_>,
    task: &BenchmarkTask,
    training: &Training,
    expected: &TrainingInputs,
    controller: &Path,
    csv: &Path,
) -> Result<(), ZooError> {
    let mut summary = TrainingSummary::load(controller)?;
    let found = summary.reconcile(training, expected, false);
    if !found.is_empty() {
        let path = controller.to_path_buf();
        let reasons = found.iter().map(ToString::to_string).collect();
        return Err(ZooError::NotPlanned { path, reasons });
    }
    let problem = |problem| ZooError::Curve { path: csv.to_path_buf(), problem };
    let unreadable = || problem(CurveFileProblem::Settings { algorithm: training.algorithm.clone() });
    let config = summary.config().ok_or_else(unreadable)?;
    let curve = Curve::load(csv)?;
    check_ended(&curve, &config).map_err(problem)?;
    summary.training_time = training_time(&curve, &config);
    summary.trained_steps = curve.rows.last().map(|row| row.environment_steps);
    let record = bench.record(task, training, &summary, controller)?;
    write(&bench.folder.curve(training), StoredCurve::from(&curve).csv().as_bytes())?;
    record.save(bench.folder)?;
    write(&bench.folder.controller(training), &read(controller)?)
}

fn training_time(curve: &Curve, config: &AlgorithmSettings) -> Option<TrainingTime> {
    let row = curve.training_time().ok()?;
    Some(TrainingTime {
        environment_steps: row.environment_steps,
        control_steps: row.control_steps(config.episodes().environments),
        secs: row.wall_clock_secs,
    })
}

/// Measures a controller that is in its place. If it was put there by hand, an existing curve
/// belongs to another training run and is removed.
///
/// # Errors
/// If it cannot be measured.
pub(crate) fn measure_again(
    bench: &Bench<'_>,
    task: &BenchmarkTask,
    entry: &PlanEntry,
) -> Result<(), ZooError> {
    let training = &entry.training;
    let path = bench.folder.controller(training);
    let summary = match &entry.summary {
        Some(summary) => summary.clone(),
        None => TrainingSummary::load(&path)?,
    };
    let record = bench.record(task, training, &summary, &path)?;
    if entry.record.as_ref().is_none_or(|old| old.file_hash != record.file_hash) {
        remove(&bench.folder.curve(training))?;
    }
    record.save(bench.folder)
}

/// Takes in the finished training runs of a folder that the plan lacks, and reports those that it
/// refuses.
///
/// # Errors
/// If any was refused.
pub(crate) fn import(
    bench: &Bench<'_>,
    source: &Path,
    tasks: &[BenchmarkTask],
    entries: &[PlanEntry],
    observer: &dyn ZooObserver,
) -> Result<(), ZooError> {
    let mut refused = 0;
    for name in unknown_controllers(source, entries)? {
        observer.note(&name, "not in the plan, or not selected");
    }
    for entry in entries {
        let training = &entry.training;
        let name = training.name();
        let file = |ending: &str| source.join(name.clone() + ending);
        if !file(CONTROLLER).is_file() {
            continue;
        }
        // A controller that was put in place by hand has no curve; the import can add it.
        if entry.state.is_measured() && bench.folder.curve(training).is_file() {
            observer.note(&name, "already in the repository");
            continue;
        }
        let Some(task) = tasks.iter().find(|task| task.name == training.task) else { continue };
        match take_in(bench, task, training, &entry.expected, &file(CONTROLLER), &file(CURVE)) {
            Ok(()) => observer.note(&name, "imported"),
            Err(ZooError::Interrupted) => return Err(ZooError::Interrupted),
            Err(error) => {
                refused += 1;
                observer.ended(&name, &Err(error));
            }
        }
    }
    match refused {
        0 => Ok(()),
        _ => Err(ZooError::Refused { refused, folder: source.to_path_buf() }),
    }
}

/// Returns the names of controllers in a folder that belong to no selected training run. The last
/// controllers of training runs, beside the best ones, do not count.
fn unknown_controllers(source: &Path, entries: &[PlanEntry]) -> Result<Vec<String>, ZooError> {
    let mut names = Vec::new();
    for file in fs::read_dir(source).map_err(ZooError::file(source))? {
        let path = file.map_err(ZooError::file(source))?.path();
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let is_known = entries.iter().any(|entry| entry.training.name() == name);
        let is_controller = path.extension().is_some_and(|ending| ending == "safetensors");
        if is_controller && !is_known && !name.ends_with(".last") {
            names.push(name);
        }
    }
    names.sort();
    Ok(names)
}

/// Checks that a training run reached its end: all its steps, or enough good validations in a row.
fn check_ended(curve: &Curve, settings: &AlgorithmSettings) -> Result<(), CurveFileProblem> {
    let run = settings.run();
    if let Some(first) = curve.rows.first().filter(|row| row.iteration != 1) {
        return Err(CurveFileProblem::MissingStart { iteration: first.iteration });
    }
    let done = curve.rows.last().map_or(0, |row| row.environment_steps);
    if done >= run.total_steps {
        return Ok(());
    }
    let validations = curve.rows.iter().rev().filter_map(|row| row.validation);
    let is_good = |found: &Validation| {
        let rates = found.mixture(&settings.scenarios().selection);
        run.stop_success.is_none_or(|least| rates.success_rate >= least)
            && run.stop_strict.is_none_or(|least| rates.strict_success_rate >= least)
    };
    let streak = validations.take_while(is_good).count() as u64;
    let stops_early = run.stop_success.is_some() || run.stop_strict.is_some();
    if stops_early && streak >= run.stop_validations {
        Ok(())
    } else {
        Err(CurveFileProblem::Unfinished { done, total: run.total_steps })
    }
}

#[cfg(test)]
mod tests {
    use mishandle::train::CurveRow;
    use mishandle::training::{Rates, TimeShares};

    use super::*;

    #[track_caller]
    fn check(settings: &str, rows: &[(u64, f64)], ended: bool) {
        let row = |(index, (environment_steps, rate)): (usize, &(u64, f64))| CurveRow {
            iteration: index as u64 + 1,
            environment_steps: *environment_steps,
            wall_clock_secs: 1.0,
            mean_return: None,
            mean_episode_steps: None,
            terminated_rate: None,
            scenario_share: None,
            validation: Some(Validation::of_starts(Rates {
                success_rate: *rate,
                strict_success_rate: *rate,
                mean_return: 0.0,
            })),
            kl: None,
            entropy: None,
            learning_rate: 0.0,
            time_shares: TimeShares::default(),
            reward_terms: vec![],
        };
        let rows: Vec<CurveRow> = rows.iter().enumerate().map(row).collect();
        let curve = Curve {
            has_scenarios: false,
            has_curriculum: false,
            reward_terms: vec![],
            rows,
            is_truncated: false,
        };
        let config = AlgorithmSettings::from_toml("ppo", settings).unwrap().unwrap();
        let found = check_ended(&curve, &config);
        assert_eq!(found.is_ok(), ended, "{settings}: {found:?}");
    }

    #[test]
    fn a_training_run_ends_with_its_steps_or_after_enough_good_validations() {
        let steps = "[run]\ntotal_steps = 100\n";
        check(steps, &[(64, 1.0), (128, 0.0)], true);
        check(steps, &[(64, 1.0)], false);
        check(steps, &[], false);
        let early = "[run]\ntotal_steps = 100\nstop_success = 0.9\nstop_strict = 0.8\nstop_validations = 2\n";
        check(early, &[(16, 0.95), (32, 0.9)], true);
        check(early, &[(16, 0.95), (32, 0.85), (48, 0.9)], false);
    }
}
