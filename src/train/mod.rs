//! Training runs with their output files.

pub(crate) mod curve;
mod facts;
mod output_check;
mod plan;
mod recorder;
mod result;
mod scenarios;
pub(crate) mod tensorboard;
mod write_failures;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use mishandle_controllers::guard::Guard;
use mishandle_controllers::{
    ActionLimiter, ControllerFile, Header, LimitedPolicy, Policy, TrainingRecord, ValidationRecord,
};
use mishandle_files::{FileLock, NewFolders, limits, read_text_bounded};
use mishandle_results::{Choice, Key, Remedy};
use mishandle_rollout::{BatchFactory, ScenarioBatches, Seed, Supervisor, TrainingScenarios};
use mishandle_tasks::TaskBatches;
use mishandle_text::path_text;
use mishandle_training::{
    ALGORITHMS, AlgorithmSettings, BASES, BEST, Checkpoint, Origin, SpaceSetting, TrainingControl,
    TrainingProgress, TrainingResult, Validation,
};

use crate::build::build;
use crate::error::{MishandleError, invalid};
use crate::plan::{CPU, DEVICES, GPU, TrainPlan};
use crate::resolve::{TrainingEnvironment, TrainingTarget, training_target};
use crate::run::Device;
pub(crate) use output_check::check as check_outputs;
use plan::with_suffix;
use recorder::TrainingRecorder;

pub use crate::error::CurveProblem;
pub use crate::resolve::{default_reward, reward};
pub use curve::{Curve, CurveRow, NoTrainingTime};
pub use facts::{TrainingFacts, training_facts};
pub use plan::default_out;
pub use result::controller_result;

/// Total steps per step in which only the critic learns, if training starts from a controller and
/// the user gives no settings.
const CRITIC_SHARE: u64 = 20;

/// Receives the progress of a training run.
pub trait TrainObserver {
    /// Called before the first iteration, after all checks, with the environment steps so far and
    /// in total.
    fn training_started(&mut self, _done: u64, _total: u64) {}

    /// Called after each iteration. After [`TrainingControl::Stop`] all output files are written.
    fn iteration_finished(&mut self, progress: &TrainingProgress) -> TrainingControl;

    /// Called when a file cannot be written; once until a later attempt succeeds. The next attempt
    /// follows after the next iteration, for a checkpoint after a minute.
    fn write_failed(&mut self, error: &MishandleError);
}

/// Report of a training run.
#[derive(Debug)]
pub struct TrainReport {
    /// The best and the last policy, with their validations.
    pub result: TrainingResult,
    /// All settings.
    pub settings: AlgorithmSettings,
    /// Row of the curve where the return converged; see [`Curve::training_time`].
    pub training_time: Result<CurveRow, NoTrainingTime>,
    /// Errors of the files that could not be written: controllers, last checkpoint, curve, event
    /// file.
    pub write_failures: Vec<MishandleError>,
}

impl TrainReport {
    /// Returns whether training finished; `false` means that it was interrupted.
    pub fn is_finished(&self) -> bool {
        self.result.reached_target || self.result.environment_steps >= self.settings.run().total_steps
    }

    /// Returns whether training stopped before its last step because validations reached the target
    /// rates.
    pub fn stopped_early(&self) -> bool {
        self.result.reached_target && self.result.environment_steps < self.settings.run().total_steps
    }
}

/// Trains a controller and writes the best one by validation to the plan's file, and the last one
/// beside it. `observer` receives the progress and can stop the run. `gpu` is the device of a plan
/// that trains on it.
///
/// The first checkpoint is written after the first iteration. After that, a file that cannot be
/// written does not end the run; writing is tried again, and the report contains the errors that
/// remain at the end.
///
/// # Errors
/// If a name is unknown, a setting has a value that is not allowed, the checkpoint or the curve
/// belongs to another training run, an output file exists, or the first checkpoint or the start of
/// an output file cannot be written. The files that this run created are then deleted.
pub fn train(
    plan: &TrainPlan,
    gpu: Option<&Device>,
    observer: &mut dyn TrainObserver,
) -> Result<TrainReport, MishandleError> {
    let target = plan.target()?;
    plan.check_extension()?;
    plan.check_distinct_outputs()?;
    let prepared = prepare(plan, &*target)?;
    let mut folders = NewFolders::default();
    let _locks = lock(plan, &mut folders)?;
    plan.check_existing_files()?;
    let hash = target.hash(&plan.reward)?;
    let specification = target.specification()?;
    let resumed = if plan.resume { Some(Checkpoint::load(&plan.checkpoint())?) } else { None };
    let mut recorder = TrainingRecorder::new(plan, &prepared, specification, resumed.as_ref(), observer)?;
    let Prepared { settings, start, environment, scenarios, supervisor, .. } = prepared;
    let batches = batches(plan, gpu, environment, scenarios, supervisor)?;
    let seed = Seed(plan.seed);
    let origin = match (&resumed, &start) {
        (Some(checkpoint), _) => Origin::Checkpoint(checkpoint),
        (None, Some(policy)) => Origin::Policy(policy),
        (None, None) => Origin::New,
    };
    let networks = gpu.and_then(|gpu| gpu.networks.as_deref());
    let trained = match networks.filter(|_| plan.device == GPU) {
        Some(networks) => settings.train_on(&batches, networks, seed, origin, &mut recorder),
        None => settings.train(&batches, seed, origin, &mut recorder),
    };
    let result = match recorder.take_error().map_or(trained.map_err(MishandleError::from), Err) {
        Ok(result) => result,
        Err(error) => {
            recorder.abandon();
            return Err(error);
        }
    };
    let (best, last) = controllers(plan, &*target, &hash, &settings, &result);
    let saved = [best.save(&plan.out), last.save(&plan.last())];
    let mut write_failures: Vec<MishandleError> =
        saved.into_iter().filter_map(Result::err).map(MishandleError::from).collect();
    write_failures.extend(recorder.finish());
    let training_time = match plan.csv.as_deref().map(Curve::load) {
        Some(Ok(curve)) => curve.training_time().cloned(),
        None => Err(NoTrainingTime::NoCurve),
        Some(Err(error)) => {
            write_failures.push(error);
            Err(NoTrainingTime::NoCurve)
        }
    };
    Ok(TrainReport { result, settings, training_time, write_failures })
}

/// Locks the output files against other training runs and creates their folders.
fn lock(plan: &TrainPlan, folders: &mut NewFolders) -> Result<Vec<FileLock>, MishandleError> {
    let own = [(Key::OUT, plan.out.clone()), (Key::OUT, plan.last())];
    let outputs = own.into_iter().chain(plan.csv.clone().map(|csv| (Key::CURVE, csv)));
    outputs
        .map(|(key, path)| {
            let folder = path.parent().unwrap_or(Path::new(""));
            folders.create(folder).map_err(|source| MishandleError::Write {
                what: "folder",
                path: folder.to_path_buf(),
                source,
            })?;
            // A lock beside a device would be in a folder such as /dev.
            if std::fs::metadata(&path).is_ok_and(|found| !found.is_file() && !found.is_dir()) {
                let source = std::io::Error::other("expected a regular file");
                return Err(MishandleError::Write { what: "file", path, source });
            }
            let file = with_suffix(&path, ".lock");
            let lock = FileLock::try_acquire(&file).map_err(|source| MishandleError::Write {
                what: "lock file",
                path: file,
                source,
            })?;
            lock.ok_or_else(|| MishandleError::busy("training run", &path, key))
        })
        .collect()
}

/// Settings, environment and scenarios of a plan.
pub(crate) struct Prepared {
    /// All settings.
    pub settings: AlgorithmSettings,
    /// The policy from which training starts, if it is that of a controller.
    pub start: Option<Policy>,
    /// The environment over the axes of the scene.
    pub environment: TrainingEnvironment,
    /// The scenarios of the episodes.
    pub scenarios: TrainingScenarios,
    /// The guard under which the policy trains.
    pub guard: Option<Guard>,
    /// The limiter of the policy's action interface.
    pub limiter: Option<ActionLimiter>,
    /// The changes of the policy's actions in training: its action interface, then the guard.
    pub supervisor: Option<Arc<dyn Supervisor>>,
}

/// Looks up the names of a plan and of its settings.
pub(crate) fn prepare(plan: &TrainPlan, target: &dyn TrainingTarget) -> Result<Prepared, MishandleError> {
    let mut settings = settings(plan, target)?;
    let scene = target.scene(&plan.reward, &settings)?;
    let (environment, scenarios) = scenarios::scenarios(target, scene, &mut settings)?;
    let start = settings.run().from.as_deref();
    let start = start.map(|name| target.start_controller(name)).transpose()?;
    if let Some(file) = &start {
        file.check(&file.header.task, &target.layout(&settings))?;
    }
    let start = start.map(|file| file.policy);
    let guard = plan.guard.as_ref().map(|guard| target.guard(guard, &settings)).transpose()?;
    let limiter = target.limiter(&settings)?;
    let after = guard.clone().map(|guard| Arc::new(guard) as Arc<dyn Supervisor>);
    let supervisor = match &limiter {
        Some(limiter) => Some(Arc::new(LimitedPolicy::new(limiter.clone(), after)) as Arc<dyn Supervisor>),
        None => after,
    };
    Ok(Prepared { settings, start, environment, scenarios, guard, limiter, supervisor })
}

/// Returns the factory of a plan's training environments.
pub(crate) fn batches(
    plan: &TrainPlan,
    gpu: Option<&Device>,
    environment: TrainingEnvironment,
    scenarios: TrainingScenarios,
    supervisor: Option<Arc<dyn Supervisor>>,
) -> Result<ScenarioBatches<Arc<dyn BatchFactory>>, MishandleError> {
    known("device", &plan.device, &DEVICES)?;
    let batches: Arc<dyn BatchFactory> = match environment.task.filter(|_| plan.device == GPU) {
        Some(task) => {
            let gpu = gpu.ok_or_else(|| MishandleError::NoDevice { device: plan.device.clone() })?;
            Arc::new(TaskBatches::new(task, gpu.worlds.clone()))
        }
        None => environment.batches,
    };
    Ok(ScenarioBatches { supervisor, ..ScenarioBatches::new(batches, scenarios) })
}

/// Reads the settings of a plan.
fn settings(plan: &TrainPlan, target: &dyn TrainingTarget) -> Result<AlgorithmSettings, MishandleError> {
    known_algorithm(&plan.algorithm)?;
    let (path, text) = match (&plan.settings, &plan.from) {
        (Some(path), _) if path != Path::new(BEST) => (path.clone(), given_settings(path)?),
        (None, Some(from)) => recorded_settings(plan, target, from)?,
        _ => shipped(plan, target)?.unwrap_or_default(),
    };
    let settings = AlgorithmSettings::from_toml(&plan.algorithm, &text).expect("the algorithm is known");
    let mut settings = settings.map_err(|error| MishandleError::from(error).of(path_text(&path)))?;
    settings.run_mut().total_steps = plan.steps.unwrap_or(settings.run().total_steps);
    if let Some(from) = &plan.from {
        let run = settings.run_mut();
        run.from = Some(from.clone());
        if plan.settings.is_none() {
            run.critic_steps = run.total_steps / CRITIC_SHARE;
        }
    }
    let scenarios = settings.scenarios_mut();
    scenarios.space = plan.space.clone().map(SpaceSetting::One).or(scenarios.space.take());
    scenarios.axes.extend(plan.axes.clone());
    settings.check()?;
    Ok(settings)
}

/// Returns path and text of the settings by which a controller was trained.
fn recorded_settings(
    plan: &TrainPlan,
    target: &dyn TrainingTarget,
    from: &str,
) -> Result<(PathBuf, String), MishandleError> {
    let header = target.start_controller(from)?.header;
    if header.algorithm != plan.algorithm {
        let error =
            invalid("the algorithm", &plan.algorithm, "the algorithm of the controller to start from");
        return Err(
            error.with(Remedy::set(Key::ALGORITHM_SETTINGS, Choice::FILE).when("another one is meant"))
        );
    }
    Ok((PathBuf::from(from), header.training.settings))
}

/// Returns the text of the settings file or settings base that the user named.
fn given_settings(path: &Path) -> Result<String, MishandleError> {
    // An argument that is not a file and does not look like one is the name of a settings base.
    if !path.exists() && path.components().count() == 1 && path.extension().is_none_or(|end| end != "toml") {
        known("settings base", &path.to_string_lossy(), &BASES)?;
    }
    match BASES.iter().find(|base| path == Path::new(base)) {
        Some(base) => Ok(format!("base = \"{base}\"")),
        None => read_text_bounded(path, limits::SETTINGS).map_err(MishandleError::file(path)),
    }
}

/// Returns path and text of the shipped settings of target and algorithm; `None` if none are
/// shipped.
fn shipped(
    plan: &TrainPlan,
    target: &dyn TrainingTarget,
) -> Result<Option<(PathBuf, String)>, MishandleError> {
    let Some(file) = target.shipped_settings(&plan.algorithm, &plan.device)? else {
        return Ok(None);
    };
    let text = String::from_utf8_lossy(&file.bytes()?).into_owned();
    Ok(Some((file.path().to_path_buf(), text)))
}

/// Returns whether training uses the default settings of its algorithm, because the plan names no
/// settings and none are shipped for its task.
///
/// # Errors
/// If a name is unknown, or shipped settings cannot be read.
pub fn uses_default_settings(plan: &TrainPlan) -> Result<bool, MishandleError> {
    known_algorithm(&plan.algorithm)?;
    let names_settings =
        plan.from.is_some() || plan.settings.as_deref().is_some_and(|path| path != Path::new(BEST));
    Ok(!names_settings && shipped(plan, &*plan.target()?)?.is_none())
}

/// Returns the algorithm that trained a controller of a target. `name` is a path or the name of a
/// shipped controller.
///
/// # Errors
/// If there is no such target, or no such trained controller of it.
pub fn algorithm_of(target: &str, name: &str) -> Result<String, MishandleError> {
    Ok(training_target(target, CPU)?.start_controller(name)?.header.algorithm)
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

/// Returns the files of the best and of the last controller.
fn controllers(
    plan: &TrainPlan,
    target: &dyn TrainingTarget,
    hash: &str,
    settings: &AlgorithmSettings,
    result: &TrainingResult,
) -> (ControllerFile, ControllerFile) {
    let file = |policy: &Policy, environment_steps: u64, validation: Option<Validation>| ControllerFile {
        header: Header {
            task: target.name().to_string(),
            algorithm: plan.algorithm.clone(),
            preset: target.preset().to_string(),
            reward: plan.reward.clone(),
            layout: target.layout(settings),
            action_interface: settings.episodes().action_interface.clone(),
            task_hash: hash.to_string(),
            training: TrainingRecord {
                seed: plan.seed,
                environment_steps,
                wall_clock_secs: result.wall_clock_secs,
                git_commit: build().git_commit,
                command: plan.command(),
                settings: settings.to_toml(),
                validation: validation.filter(|found| found.nominal().has_verdicts()).map(|validation| {
                    ValidationRecord {
                        episodes: settings.run().validation_episodes,
                        success_rate: validation.success_rate,
                        strict_success_rate: validation.strict_success_rate,
                    }
                }),
            },
        },
        policy: policy.clone(),
    };
    let best = file(&result.best, result.best_environment_steps, result.best_validation);
    (best, file(&result.last, result.environment_steps, result.last_validation))
}
