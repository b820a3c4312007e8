//! One training run: from its start or its checkpoint to a measured controller in its place.

use std::fs;
use std::path::Path;

use mishandle::MishandleError;
use mishandle::files::FileLock;
use mishandle::plan::TrainPlan;
use mishandle::results::Key;
use mishandle::train::TrainObserver;
use mishandle::training::{TrainingControl, TrainingProgress};

use crate::zoo::folder::{create_parent, remove, write};
use crate::zoo::import::take_in;
use crate::zoo::measure::Bench;
use crate::zoo::plan::SEED;
use crate::zoo::plan_entry::{CHECKPOINT, CONTROLLER, CURVE, STARTED, started_mark};
use crate::zoo::provenance::REWARD;
use crate::zoo::{BenchmarkTask, PlanEntry, TrainingState, ZooError, ZooObserver};

/// Ending of the lock file of `mishandle train`.
const LOCK: &str = ".safetensors.lock";

/// Trains, measures and puts the controller in its place.
///
/// # Errors
/// If the training run fails, is interrupted, or gives something other than planned.
pub(crate) fn train(
    bench: &Bench<'_>,
    task: &BenchmarkTask,
    entry: &PlanEntry,
    observer: &dyn ZooObserver,
) -> Result<(), ZooError> {
    let training = &entry.training;
    let file = |ending: &str| bench.folder.work(training, ending);
    let lock_path = file(LOCK);
    create_parent(&lock_path)?;
    let lock = FileLock::try_acquire(&lock_path).map_err(ZooError::file(&lock_path))?;
    // Its files must not be removed while a training run that was started by hand writes them.
    drop(lock.ok_or_else(|| MishandleError::busy("training run", &file(CONTROLLER), Key::OUT))?);
    if !matches!(entry.state, TrainingState::Interrupted { .. }) {
        clear(&file(""))?;
        write(&file(STARTED), started_mark(&entry.expected).as_bytes())?;
    }
    let plan = TrainPlan {
        task: training.task.clone(),
        algorithm: training.algorithm.clone(),
        reward: REWARD.to_string(),
        seed: SEED,
        out: file(CONTROLLER),
        csv: Some(file(CURVE)),
        resume: file(CHECKPOINT).is_file(),
        ..TrainPlan::default()
    };
    let name = training.name();
    let has_ended = bench.runner.train(&plan, &mut Watch { bench, name: &name, observer })?;
    if !has_ended {
        return Err(ZooError::Interrupted);
    }
    take_in(bench, task, training, &entry.expected, &file(CONTROLLER), &file(CURVE))?;
    clear(&file(""))
}

/// Passes progress on, and stops the training run on request.
struct Watch<'a> {
    bench: &'a Bench<'a>,
    name: &'a str,
    observer: &'a dyn ZooObserver,
}

impl TrainObserver for Watch<'_> {
    fn iteration_finished(&mut self, progress: &TrainingProgress) -> TrainingControl {
        self.observer.progress(self.name, progress);
        if (self.bench.stop)() { TrainingControl::Stop } else { TrainingControl::Continue }
    }

    fn write_failed(&mut self, failure: &MishandleError) {
        self.observer.warning(self.name, failure);
    }
}

/// Removes all files whose names are `start`'s and one of the endings of a training run.
fn clear(start: &Path) -> Result<(), ZooError> {
    let folder = start.parent().unwrap_or(Path::new("."));
    let name = start.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let entries = fs::read_dir(folder).map_err(ZooError::file(folder))?;
    for entry in entries {
        let path = entry.map_err(ZooError::file(folder))?.path();
        let own = path.file_name().unwrap_or_default().to_string_lossy();
        let ending = own.strip_prefix(&name);
        if ending.is_some_and(|ending| ending.starts_with('.')) {
            remove(&path)?;
        }
    }
    Ok(())
}
