//! Training, and what it leaves behind.

mod places;
mod plan;
mod unwritten;
mod watcher;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use mishandle_controllers::{ControllerFile, Header, Policy, TrainingRecord, ValidationRecord};
use mishandle_files::{FileLock, NewFolders};
use mishandle_rollout::Seed;
use mishandle_tasks::{Preset, Reward, Task, TaskEnvironment, task_hash};
use mishandle_training::{
    ALGORITHMS, BEST, Checkpoint, Config, Flow, PRESETS, Progress, Trained, Validation,
};

use crate::curve::{Curve, CurveRow, NoTrainingTime};
use crate::home::check_home;
use crate::{MishandleError, build, memory, shipped_settings, task};
pub(crate) use places::check as check_places;
use plan::with_ending;
use watcher::Watcher;

pub use plan::{TrainPlan, default_out};

/// Who is told how a training goes.
pub trait TrainObserver {
    /// Called before the first iteration, when all has been checked: how many environment steps are done and wanted.
    fn begins(&mut self, _done: u64, _total: u64) {}

    /// Called after each iteration. [`Flow::Stop`] ends the training; what has been learned until then is written all
    /// the same.
    fn progress(&mut self, progress: &Progress) -> Flow;

    /// Called when a file cannot be written, once until it can be written again: that is tried after each iteration, of
    /// a checkpoint after each minute.
    fn unwritten(&mut self, failure: &MishandleError);
}

/// What a training gave, and the settings it ran with.
#[derive(Debug)]
pub struct TrainReport {
    /// The best and the last policy.
    pub trained: Trained,
    /// The settings.
    pub config: Config,
    /// Where the return became flat; see [`Curve::training_time`].
    pub training_time: Result<CurveRow, NoTrainingTime>,
    /// Why what is not written is not: controllers, the last checkpoint, the curve, the event file.
    pub unwritten: Vec<MishandleError>,
}

impl TrainReport {
    /// Whether it came to its end; if not, it was stopped from outside.
    pub fn has_ended(&self) -> bool {
        self.trained.reached || self.trained.environment_steps >= self.config.run().total_steps
    }

    /// Whether it ended before its last step, since its policy was as good as the settings ask for.
    pub fn stopped_early(&self) -> bool {
        self.trained.reached && self.trained.environment_steps < self.config.run().total_steps
    }
}

/// Trains a controller and writes it to the plan's file, the best one by validation, with the last one beside it.
/// `watch` is told how it goes, and may stop it.
///
/// A checkpoint is written after the first iteration. From then on the training goes on without what cannot be written,
/// and tries again.
///
/// # Errors
/// If a name is unknown, the settings are wrong or take more memory than is free, the checkpoint or the curve is another training's, something is in the
/// way of what is to be written, or its first part or the first checkpoint cannot be written. What was not there before
/// is then gone again. What cannot be written in the end, the report tells.
pub fn train(plan: &TrainPlan, watch: &mut dyn TrainObserver) -> Result<TrainReport, MishandleError> {
    let task = task(&plan.task)?;
    let config = settings(plan)?;
    plan.check_places()?;
    let environment = Arc::new(environment(plan)?);
    memory::check(&config, &*environment)?;
    let mut folders = NewFolders::default();
    let _locks = lock(plan, &mut folders)?;
    plan.check_presence()?;
    let hash = task_hash(task, reward(&plan.reward)?)?;
    let specification = task.definition().formulas(Preset::Paper).specification()?;
    let resumed = if plan.resume { Some(Checkpoint::load(&plan.checkpoint())?) } else { None };
    let mut watcher = Watcher::new(plan, environment.clone(), specification, resumed.as_ref(), watch)?;
    let trained = config.train(&environment, Seed(plan.seed), resumed.as_ref(), &mut watcher);
    let trained = match watcher.failure().map_or(trained.map_err(MishandleError::from), Err) {
        Ok(trained) => trained,
        Err(failure) => {
            watcher.abandon();
            return Err(failure);
        }
    };
    let (best, last) = controllers(plan, (task, &hash), &config, &trained);
    let saved = [best.save(&plan.out), last.save(&plan.last())];
    let mut unwritten: Vec<MishandleError> =
        saved.into_iter().filter_map(Result::err).map(MishandleError::from).collect();
    unwritten.extend(watcher.finish());
    let training_time = match plan.csv.as_deref().map(Curve::load) {
        Some(Ok(curve)) => curve.training_time().cloned(),
        None => Err(NoTrainingTime::NoCurve),
        Some(Err(error)) => {
            unwritten.push(error);
            Err(NoTrainingTime::NoCurve)
        }
    };
    Ok(TrainReport { trained, config, training_time, unwritten })
}

/// Keeps other trainings away from this one's files, whose folders are made.
fn lock(plan: &TrainPlan, folders: &mut NewFolders) -> Result<Vec<FileLock>, MishandleError> {
    let own = [("--out", plan.out.clone()), ("--out", plan.last())];
    let places = own.into_iter().chain(plan.csv.clone().map(|csv| ("--csv", csv)));
    places
        .map(|(flag, path)| {
            let folder = path.parent().unwrap_or(Path::new(""));
            folders
                .create(folder)
                .map_err(|source| MishandleError::File { path: folder.to_path_buf(), source })?;
            let file = with_ending(&path, ".lock");
            let lock =
                FileLock::try_acquire(&file).map_err(|source| MishandleError::File { path: file, source })?;
            lock.ok_or(MishandleError::Busy { path, flag })
        })
        .collect()
}

/// The environment that a plan asks for.
pub(crate) fn environment(plan: &TrainPlan) -> Result<TaskEnvironment, MishandleError> {
    let reward = reward(&plan.reward)?;
    Ok(TaskEnvironment::new(task(&plan.task)?, Preset::Paper, reward)?)
}

/// The settings that a plan asks for.
pub(crate) fn settings(plan: &TrainPlan) -> Result<Config, MishandleError> {
    known_algorithm(&plan.algorithm)?;
    let (path, text) = match plan.settings.as_deref().filter(|path| *path != Path::new(BEST)) {
        Some(path) => (path.to_path_buf(), given_settings(path)?),
        None => shipped(plan)?.unwrap_or_default(),
    };
    let config = Config::from_toml(&plan.algorithm, &text).expect("the algorithm is known");
    let mut config = config.map_err(|source| MishandleError::Settings { path, source: Box::new(source) })?;
    config.run_mut().total_steps = plan.steps.unwrap_or(config.run().total_steps);
    config.check()?;
    Ok(config)
}

/// The settings in a file that the user named, or those of a settings preset.
fn given_settings(path: &Path) -> Result<String, MishandleError> {
    // What is neither a file nor looks like one was meant as a settings preset.
    if !path.exists() && path.components().count() == 1 && path.extension().is_none_or(|end| end != "toml") {
        known("settings preset", &path.to_string_lossy(), &PRESETS)?;
    }
    match PRESETS.iter().find(|preset| path == Path::new(preset)) {
        Some(preset) => Ok(format!("preset = \"{preset}\"")),
        None => std::fs::read_to_string(path)
            .map_err(|source| MishandleError::File { path: path.to_path_buf(), source }),
    }
}

/// The shipped settings of a plan's task and algorithm, with their path; `None` if none are shipped.
fn shipped(plan: &TrainPlan) -> Result<Option<(PathBuf, String)>, MishandleError> {
    let definition = task(&plan.task)?.definition();
    check_home("experiments/training")?;
    let Some(file) = shipped_settings(definition, &plan.algorithm) else { return Ok(None) };
    let text = String::from_utf8_lossy(&file.bytes()?).into_owned();
    Ok(Some((file.path().to_path_buf(), text)))
}

/// Whether a training takes the default settings of its algorithm, because the plan names no settings and none are shipped
/// for its task.
///
/// # Errors
/// If a name is unknown, or shipped settings cannot be read.
pub fn uses_default_settings(plan: &TrainPlan) -> Result<bool, MishandleError> {
    known_algorithm(&plan.algorithm)?;
    let names_settings = plan.settings.as_deref().is_some_and(|path| path != Path::new(BEST));
    Ok(!names_settings && shipped(plan)?.is_none())
}

/// The reward of that name: `shaped` or `original`.
///
/// # Errors
/// If there is none.
pub fn reward(name: &str) -> Result<Reward, MishandleError> {
    known("reward", name, &["shaped", "original"])?;
    Ok(if name == "original" { Reward::Original } else { Reward::Shaped })
}

fn known_algorithm(name: &str) -> Result<(), MishandleError> {
    let algorithms: Vec<&str> = ALGORITHMS.iter().map(|entry| entry.name).collect();
    known("training algorithm", name, &algorithms)
}

fn known(kind: &'static str, name: &str, names: &[&str]) -> Result<(), MishandleError> {
    if names.contains(&name) {
        return Ok(());
    }
    let known = names.iter().map(|name| (*name).to_string()).collect();
    Err(MishandleError::UnknownName { kind, name: name.to_string(), known })
}

/// The files of the best controller and of the last.
fn controllers(
    plan: &TrainPlan,
    (task, task_hash): (&dyn Task, &str),
    config: &Config,
    trained: &Trained,
) -> (ControllerFile, ControllerFile) {
    let definition = task.definition();
    let file = |policy: &Policy, environment_steps: u64, validation: Option<Validation>| ControllerFile {
        header: Header {
            task: plan.task.clone(),
            algorithm: plan.algorithm.clone(),
            preset: "paper".to_string(),
            reward: plan.reward.clone(),
            layout: definition.layout(),
            task_hash: task_hash.to_string(),
            training: TrainingRecord {
                seed: plan.seed,
                environment_steps,
                wall_clock_secs: trained.wall_clock_secs,
                git_commit: build().git_commit,
                command: plan.command(),
                settings: config.to_toml(),
                validation: validation.map(|found| ValidationRecord {
                    episodes: config.run().validation_episodes,
                    success_rate: found.success_rate,
                    strict_success_rate: found.strict_success_rate,
                }),
            },
        },
        policy: policy.clone(),
    };
    let best = file(&trained.best, trained.best_environment_steps, trained.best_validation);
    (best, file(&trained.last, trained.environment_steps, trained.last_validation))
}
