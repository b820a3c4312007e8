//! Training, and what it leaves behind.

mod places;
mod plan;
mod watcher;

use std::path::Path;
use std::sync::Arc;

use mishandle_controllers::{ControllerFile, Header, Policy, TrainingRecord, ValidationRecord};
use mishandle_rollout::Seed;
use mishandle_tasks::{Preset, Reward, Task, TaskEnvironment, task_hash};
use mishandle_training::{
    ALGORITHMS, BEST, Checkpoint, Config, Flow, PRESETS, Progress, Trained, Validation,
};

use crate::curve::{Curve, CurveRow};
use crate::home::check_home;
use crate::lock::Lock;
use crate::{MishandleError, build, memory, settings_path, task};
pub(crate) use places::check as check_places;
use plan::with_ending;
use watcher::Watcher;

pub use plan::{TrainPlan, default_out};

/// What a training gave, and the settings it ran with.
#[derive(Clone, Debug)]
pub struct TrainReport {
    /// The best and the last policy.
    pub trained: Trained,
    /// The settings.
    pub config: Config,
    /// Where the return became flat, if the plan has the curve written; see [`Curve::flat_after`].
    pub flat_after: Option<CurveRow>,
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
/// `watch` is told how it goes after each iteration, and may stop it; what has been learned until then is written all
/// the same.
///
/// # Errors
/// If a name is unknown, the settings are wrong or take more memory than is free, the checkpoint or the curve is another
/// training's, something is in the way of what is to be written, or a file cannot be written. If only the last
/// checkpoint, the curve or the event file could not, the controllers are there nevertheless.
pub fn train(plan: &TrainPlan, watch: impl FnMut(&Progress) -> Flow) -> Result<TrainReport, MishandleError> {
    let task = task(&plan.task)?;
    let config = settings(plan)?;
    let environment = Arc::new(environment(plan)?);
    memory::check(&config, &*environment)?;
    let _locks = lock(plan)?;
    plan.check_places()?;
    let hash = task_hash(task, reward(&plan.reward)?)?;
    let specification = task.definition().formulas(Preset::Paper).specification()?;
    let resumed = if plan.resume { Some(Checkpoint::load(&plan.checkpoint())?) } else { None };
    let mut watcher = Watcher::new(plan, environment.clone(), specification, resumed.as_ref(), watch)?;
    let trained = config.train(environment, Seed(plan.seed), resumed.as_ref(), &mut watcher)?;
    if let Some(failure) = watcher.failure() {
        return Err(failure);
    }
    let (best, last) = controllers(plan, (task, &hash), &config, &trained);
    best.save(&plan.out)?;
    last.save(&plan.last())?;
    watcher.finish()?;
    let curve = plan.csv.as_deref().map(Curve::load).transpose()?;
    let flat_after = curve.and_then(|curve| curve.flat_after().cloned());
    Ok(TrainReport { trained, config, flat_after })
}

/// Keeps other trainings away from this one's files, whose folders are made.
fn lock(plan: &TrainPlan) -> Result<Vec<Lock>, MishandleError> {
    let places = [("--out", Some(&plan.out)), ("--csv", plan.csv.as_ref())];
    let places = places.into_iter().filter_map(|(flag, path)| Some((flag, path?)));
    places
        .map(|(flag, path)| {
            let folder = path.parent().unwrap_or(Path::new(""));
            std::fs::create_dir_all(folder)
                .map_err(|source| MishandleError::File { path: folder.to_path_buf(), source })?;
            Lock::take(with_ending(path, ".lock"), path, flag)
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
    known("training algorithm", &plan.algorithm, &ALGORITHMS)?;
    let given = plan.settings.clone().filter(|path| *path != Path::new(BEST));
    if given.is_none() {
        check_home("experiments/training")?;
    }
    let definition = task(&plan.task)?.definition();
    let path = given.unwrap_or_else(|| settings_path(definition, &plan.algorithm));
    // What is neither a file nor looks like one was meant as a settings preset.
    if !path.exists() && path.components().count() == 1 && path.extension().is_none_or(|end| end != "toml") {
        known("settings preset", &path.to_string_lossy(), &PRESETS)?;
    }
    let text = match PRESETS.iter().find(|preset| path == Path::new(preset)) {
        Some(preset) => format!("preset = \"{preset}\""),
        None => std::fs::read_to_string(&path)
            .map_err(|source| MishandleError::File { path: path.clone(), source })?,
    };
    let config = Config::from_toml(&plan.algorithm, &text).expect("the algorithm is known");
    let mut config = config.map_err(|source| MishandleError::Settings { path, source: Box::new(source) })?;
    config.run_mut().total_steps = plan.steps.unwrap_or(config.run().total_steps);
    config.check()?;
    Ok(config)
}

/// The reward of that name: `shaped` or `original`.
///
/// # Errors
/// If there is none.
pub fn reward(name: &str) -> Result<Reward, MishandleError> {
    known("reward", name, &["shaped", "original"])?;
    Ok(if name == "original" { Reward::Original } else { Reward::Shaped })
}

fn known(kind: &'static str, name: &str, names: &[&str]) -> Result<(), MishandleError> {
    if names.contains(&name) {
        return Ok(());
    }
    let known = names.iter().map(|name| (*name).to_string()).collect();
    Err(MishandleError::Name { kind, name: name.to_string(), known })
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
