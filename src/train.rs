use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use mishandle_controllers::{ControllerFile, Header, Policy, TrainingRecord, ValidationRecord};
use mishandle_rollout::{Environment, Noise, Request, Rollout, Seed, Specification, System};
use mishandle_tasks::{Preset, Reward, Task, TaskEnvironment};
use mishandle_training::{
    ALGORITHMS, BEST, Checkpoint, Config, Flow, Observer, PRESETS, Progress, Trained, TrainingError,
    Validation,
};

use crate::home::check_home;
use crate::lock::Lock;
use crate::{MishandleError, build, settings_path, shell_word, task};

/// Key of the starts that a training validates on: no evaluation has it unless it is asked for.
const VALIDATION_SEED: Seed = Seed(0x7661_6c69_6461_7465);

/// A checkpoint is written at least this often, whatever the settings say of iterations: so much work may be lost.
const SAVE_EVERY: Duration = Duration::from_secs(60);

/// What to train.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainPlan {
    /// Name of the task.
    pub task: String,
    /// Name of the algorithm.
    pub algorithm: String,
    /// Name of the reward: `original` or `shaped`.
    pub reward: String,
    /// The settings file, or the name of a preset; without one, and for the preset `best`, the file of the task and
    /// algorithm in `experiments/training/`.
    pub settings: Option<PathBuf>,
    /// Environment steps, if others than the settings say.
    pub steps: Option<u64>,
    /// Seed of everything random.
    pub seed: u64,
    /// Where the controller goes; the checkpoint goes beside it.
    pub out: PathBuf,
    /// Whether to carry on from the checkpoint.
    pub resume: bool,
}

impl TrainPlan {
    /// Where the checkpoint is.
    pub fn checkpoint(&self) -> PathBuf {
        self.beside(".checkpoint")
    }

    /// The output's name with this at its end.
    fn beside(&self, ending: &str) -> PathBuf {
        let mut name = self.out.clone().into_os_string();
        name.push(ending);
        name.into()
    }

    /// The command line that does the same again, but for where the controller goes.
    pub fn command(&self) -> String {
        let mut command = format!("mishandle train {} --algorithm {}", self.task, self.algorithm);
        if self.reward != "shaped" {
            command += &format!(" --reward {}", self.reward);
        }
        if let Some(settings) = &self.settings {
            command += &format!(" --settings {}", shell_word(&settings.to_string_lossy()));
        }
        if let Some(steps) = self.steps {
            command += &format!(" --steps {steps}");
        }
        command + &format!(" --seed {}", self.seed)
    }
}

/// Trains a controller and writes it to the plan's file: the best one by validation. `watch` is told how it goes after
/// each iteration, and may stop it; what has been learned until then is written all the same.
///
/// # Errors
/// If a name is unknown, the settings are wrong, the checkpoint is another training's, or a file cannot be written. If
/// only the last checkpoint could not, the controller is there nevertheless.
pub fn train(plan: &TrainPlan, watch: impl FnMut(&Progress) -> Flow) -> Result<Trained, MishandleError> {
    let task = task(&plan.task)?;
    let reward = reward(&plan.reward)?;
    let mut config = settings(plan)?;
    config.run_mut().total_steps = plan.steps.unwrap_or(config.run().total_steps);
    if let Some(folder) = plan.out.parent() {
        std::fs::create_dir_all(folder)
            .map_err(|source| MishandleError::File { path: folder.to_path_buf(), source })?;
    }
    let _lock = Lock::take(plan.beside(".lock"), &plan.out)?;
    let environment = Arc::new(TaskEnvironment::new(task, Preset::Paper, reward)?);
    let specification = task.definition().formulas(Preset::Paper).specification()?;
    let resumed = if plan.resume { Some(Checkpoint::load(&plan.checkpoint())?) } else { None };
    let mut watcher = Watcher {
        environment: environment.clone(),
        specification,
        checkpoint: plan.checkpoint(),
        watch,
        failure: None,
        unsaved: None,
        saved: Instant::now(),
    };
    let trained = config.train(environment, Seed(plan.seed), resumed.as_ref(), &mut watcher)?;
    if let Some(failure) = watcher.failure {
        return Err(failure);
    }
    controller(plan, task, &config, &trained).save(&plan.out)?;
    match watcher.unsaved {
        Some(failure) => Err(failure.into()),
        None => Ok(trained),
    }
}

fn settings(plan: &TrainPlan) -> Result<Config, MishandleError> {
    known("training algorithm", &plan.algorithm, &ALGORITHMS)?;
    let given = plan.settings.clone().filter(|path| *path != Path::new(BEST));
    if given.is_none() {
        check_home("experiments/training")?;
    }
    let path = given.unwrap_or_else(|| settings_path(&plan.task, &plan.algorithm));
    let text = match PRESETS.iter().find(|preset| path == Path::new(preset)) {
        Some(preset) => format!("preset = \"{preset}\""),
        None => std::fs::read_to_string(&path)
            .map_err(|source| MishandleError::File { path: path.clone(), source })?,
    };
    let config = Config::from_toml(&plan.algorithm, &text).expect("the algorithm is known");
    config.map_err(|source| MishandleError::Settings { path, source })
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

fn controller(plan: &TrainPlan, task: &dyn Task, config: &Config, trained: &Trained) -> ControllerFile {
    let definition = task.definition();
    ControllerFile {
        header: Header {
            task: plan.task.clone(),
            algorithm: plan.algorithm.clone(),
            preset: "paper".to_string(),
            reward: plan.reward.clone(),
            layout: definition.layout(),
            training: TrainingRecord {
                seed: plan.seed,
                environment_steps: trained.best_environment_steps,
                wall_clock_secs: trained.wall_clock_secs,
                git_commit: build().git_commit,
                command: plan.command(),
                settings: config.to_toml(),
                validation: trained.best_validation.map(|found| ValidationRecord {
                    episodes: config.run().validation_episodes,
                    success_rate: found.success_rate,
                    strict_success_rate: found.strict_success_rate,
                }),
            },
        },
        policy: trained.best.clone(),
    }
}

/// Validates on the task's formulas, keeps the checkpoint, passes progress on.
struct Watcher<W> {
    environment: Arc<TaskEnvironment>,
    specification: Specification,
    checkpoint: PathBuf,
    watch: W,
    /// Why the last validation was not possible: that ends the training.
    failure: Option<MishandleError>,
    /// Why the last checkpoint could not be written: the training goes on, and the next may be.
    unsaved: Option<TrainingError>,
    /// When the last checkpoint was written.
    saved: Instant,
}

impl<W> Watcher<W> {
    fn measure(&self, policy: &Policy, episodes: usize) -> Result<Validation, MishandleError> {
        let mut rollout = Rollout::new(
            self.environment.clone(),
            Arc::new(policy.clone()),
            self.specification.clone(),
            Noise::default(),
        )?;
        let starts = self.environment.initial_box();
        let requests: Vec<Request> = (0..episodes as u64)
            .map(|i| Request { x0: starts.sample(VALIDATION_SEED, i), seed: VALIDATION_SEED.child(i) })
            .collect();
        let found = rollout.rollout(&requests)?;
        let share = |holds: &dyn Fn(&mishandle_rollout::Episode) -> bool| {
            found.iter().filter(|episode| holds(episode)).count() as f64 / episodes as f64
        };
        Ok(Validation {
            success_rate: share(&|episode| episode.verdict.success > Some(0.0)),
            strict_success_rate: share(&|episode| episode.verdict.strict > Some(0.0)),
            mean_return: found.iter().map(|episode| episode.total_reward).sum::<f64>() / episodes as f64,
        })
    }
}

impl<W: FnMut(&Progress) -> Flow> Observer for Watcher<W> {
    fn validate(&mut self, policy: &Policy, episodes: usize) -> Option<Validation> {
        match self.measure(policy, episodes) {
            Ok(found) => Some(found),
            Err(error) => {
                self.failure = Some(error);
                None
            }
        }
    }

    fn progress(&mut self, progress: &Progress) -> Flow {
        match (self.watch)(progress) {
            _ if self.failure.is_some() => Flow::Stop,
            Flow::Continue if self.saved.elapsed() > SAVE_EVERY => Flow::Save,
            flow => flow,
        }
    }

    fn checkpoint(&mut self, checkpoint: &Checkpoint) {
        self.unsaved = checkpoint.save(&self.checkpoint).err();
        self.saved = Instant::now();
    }
}

/// Where a training puts its controller if nothing else is said.
pub fn default_out(task: &str, algorithm: &str, seed: u64) -> PathBuf {
    Path::new("runs").join(format!("{task}-{algorithm}-s{seed}.safetensors"))
}
