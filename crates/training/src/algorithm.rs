//! Settings of any algorithm, and what an algorithm makes of them.

use std::any::Any;
use std::fmt::Debug;

use mishandle_rollout::{BatchFactory, EnvironmentSpec, Seed};

use crate::learner::Learner;
use crate::{
    ALGORITHMS, Checkpoint, EpisodeSettings, MemoryNeed, Observer, RunSettings, Setting, Settings, Trained,
    TrainingError, learner,
};

/// Settings from which an algorithm can be started. Each algorithm implements it in its own folder and has a line in the
/// [list](ALGORITHMS).
pub(crate) trait Algorithm: Settings + Clone + Debug + PartialEq + Send + Sync + 'static {
    /// What the algorithm is, in one line.
    const SUMMARY: &'static str;

    /// The algorithm at work.
    type Learner: FromSettings<Settings = Self>;

    /// How long to train, and when to look, to be set.
    fn run_mut(&mut self) -> &mut RunSettings;
}

/// A learner as a function of its settings. The on-policy and the off-policy learner implement it for all their
/// algorithms.
pub(crate) trait FromSettings: Learner + Sized + 'static {
    /// The settings of the algorithm.
    type Settings;

    /// The settings that every algorithm has.
    fn common(settings: &Self::Settings) -> Common<'_>;

    /// The memory that experience takes.
    fn experience_memory(settings: &Self::Settings, environment: &EnvironmentSpec) -> Vec<MemoryNeed>;

    /// The algorithm before its first iteration.
    ///
    /// # Errors
    /// If networks of these sizes or the environment batch cannot be made.
    fn start(
        settings: &Self::Settings,
        environments: &dyn BatchFactory,
        seed: Seed,
    ) -> Result<Self, TrainingError>;
}

/// Settings that every algorithm has.
pub(crate) struct Common<'a> {
    pub run: &'a RunSettings,
    pub episodes: &'a EpisodeSettings,
    /// Widths of the hidden layers of policy and critic.
    pub hidden: [&'a [usize]; 2],
}

/// [`Algorithm`] without its types.
trait AnySettings: Debug + Send + Sync {
    fn algorithm(&self) -> &'static str;
    fn settings(&self) -> Vec<Setting>;
    fn to_toml(&self) -> String;
    fn check(&self) -> Result<(), TrainingError>;
    fn hangs_on_total(&self) -> Option<&'static str>;
    fn common(&self) -> Common<'_>;
    fn run_mut(&mut self) -> &mut RunSettings;
    fn experience_memory(&self, environment: &EnvironmentSpec) -> Vec<MemoryNeed>;
    fn learner(&self, environments: &dyn BatchFactory, seed: Seed)
    -> Result<Box<dyn Learner>, TrainingError>;
    fn boxed_clone(&self) -> Box<dyn AnySettings>;
    fn equals(&self, other: &dyn AnySettings) -> bool;
    fn as_any(&self) -> &dyn Any;
}

impl<C: Algorithm> AnySettings for C {
    fn algorithm(&self) -> &'static str {
        C::ALGORITHM
    }

    fn settings(&self) -> Vec<Setting> {
        C::settings()
    }

    fn to_toml(&self) -> String {
        Settings::to_toml(self)
    }

    fn check(&self) -> Result<(), TrainingError> {
        Settings::check(self)
    }

    fn hangs_on_total(&self) -> Option<&'static str> {
        Settings::hangs_on_total(self)
    }

    fn common(&self) -> Common<'_> {
        C::Learner::common(self)
    }

    fn run_mut(&mut self) -> &mut RunSettings {
        Algorithm::run_mut(self)
    }

    fn experience_memory(&self, environment: &EnvironmentSpec) -> Vec<MemoryNeed> {
        C::Learner::experience_memory(self, environment)
    }

    fn learner(
        &self,
        environments: &dyn BatchFactory,
        seed: Seed,
    ) -> Result<Box<dyn Learner>, TrainingError> {
        Ok(Box::new(C::Learner::start(self, environments, seed)?))
    }

    fn boxed_clone(&self) -> Box<dyn AnySettings> {
        Box::new(self.clone())
    }

    fn equals(&self, other: &dyn AnySettings) -> bool {
        other.as_any().downcast_ref::<C>() == Some(self)
    }

    fn as_any(&self) -> &dyn Any {
        self
    }
}

/// Settings of one of the [algorithms](ALGORITHMS).
///
/// # Example
/// ```
/// use mishandle_training::{Config, ppo::PpoConfig};
/// let config = Config::from(PpoConfig { gamma: 0.9, ..PpoConfig::default() });
/// assert_eq!(config, Config::from_toml("ppo", "gamma = 0.9").unwrap()?);
/// assert_eq!(config.downcast_ref::<PpoConfig>().unwrap().gamma, 0.9);
/// # Ok::<(), mishandle_training::TrainingError>(())
/// ```
#[derive(Debug)]
pub struct Config(Box<dyn AnySettings>);

impl<C: Algorithm> From<C> for Config {
    fn from(settings: C) -> Config {
        Config(Box::new(settings))
    }
}

impl Clone for Config {
    fn clone(&self) -> Config {
        Config(self.0.boxed_clone())
    }
}

impl PartialEq for Config {
    fn eq(&self, other: &Config) -> bool {
        self.0.equals(&*other.0)
    }
}

impl Config {
    /// The settings of `algorithm` that a TOML text states; `None` if there is no such algorithm.
    ///
    /// # Errors
    /// If it is not TOML, a key is not known, or a value is of another type or out of its range.
    ///
    /// # Example
    /// ```
    /// use mishandle_training::Config;
    /// let config = Config::from_toml("ppo", "run.total_steps = 5_000").unwrap()?;
    /// assert_eq!(config.run().total_steps, 5_000);
    /// assert!(Config::from_toml("reinforce", "").is_none());
    /// # Ok::<(), mishandle_training::TrainingError>(())
    /// ```
    pub fn from_toml(algorithm: &str, text: &str) -> Option<Result<Config, TrainingError>> {
        let entry = ALGORITHMS.iter().find(|entry| entry.name == algorithm)?;
        Some((entry.from_toml)(text))
    }

    /// Name of the algorithm.
    pub fn algorithm(&self) -> &'static str {
        self.0.algorithm()
    }

    /// The settings as those of one algorithm; `None` if they are another's.
    pub fn downcast_ref<C: Settings + 'static>(&self) -> Option<&C> {
        self.0.as_any().downcast_ref()
    }

    /// What is known of each of its settings, in order.
    pub fn settings(&self) -> Vec<Setting> {
        self.0.settings()
    }

    /// The settings as TOML, every key with its value; what has none is left out.
    pub fn to_toml(&self) -> String {
        self.0.to_toml()
    }

    /// How long to train, and when to look.
    pub fn run(&self) -> &RunSettings {
        self.0.common().run
    }

    /// The simulations that are learned from.
    pub fn episodes(&self) -> &EpisodeSettings {
        self.0.common().episodes
    }

    /// How long to train, and when to look, to be set.
    pub fn run_mut(&mut self) -> &mut RunSettings {
        self.0.run_mut()
    }

    /// Checks that every setting is in its range.
    ///
    /// # Errors
    /// If one is not; the message says what it must be.
    pub fn check(&self) -> Result<(), TrainingError> {
        self.0.check()
    }

    /// Widths of the hidden layers of policy and critic.
    pub(crate) fn hidden(&self) -> [&[usize]; 2] {
        self.0.common().hidden
    }

    /// The memory that experience takes.
    pub(crate) fn experience_memory(&self, environment: &EnvironmentSpec) -> Vec<MemoryNeed> {
        self.0.experience_memory(environment)
    }

    /// Why a training of some steps is not the beginning of a longer one; `None` if it is.
    pub(crate) fn hangs_on_total(&self) -> Option<&'static str> {
        self.0.hangs_on_total()
    }

    /// Checks that a training with the same arguments could go on from a checkpoint.
    ///
    /// # Errors
    /// If a setting is out of its range, or the checkpoint is another training's.
    pub fn check_resumption(
        &self,
        environments: &dyn BatchFactory,
        seed: Seed,
        checkpoint: &Checkpoint,
    ) -> Result<(), TrainingError> {
        learner::check_resumption(self, environments, seed, checkpoint)
    }

    /// Trains a policy in batches of `environments`, on the threads of the current rayon pool. An [`Arc`](std::sync::Arc)
    /// of an [`Environment`](mishandle_rollout::Environment) makes them on the CPU.
    ///
    /// With a checkpoint of the same settings it goes on from there, to the same bits as if it had not been
    /// interrupted. Only `run.total_steps` may differ, and only if what is learned does not hang on it.
    ///
    /// # Errors
    /// If a setting is out of its range, the checkpoint is another training's, the weights stop being finite, or the
    /// environment batch fails as a whole.
    pub fn train(
        &self,
        environments: &dyn BatchFactory,
        seed: Seed,
        resume: Option<&Checkpoint>,
        observer: &mut dyn Observer,
    ) -> Result<Trained, TrainingError> {
        learner::train(self, environments, seed, resume, observer)
    }

    /// The algorithm before its first iteration.
    ///
    /// # Errors
    /// If networks of these sizes or the environment batch cannot be made.
    pub(crate) fn learner(
        &self,
        environments: &dyn BatchFactory,
        seed: Seed,
    ) -> Result<Box<dyn Learner>, TrainingError> {
        self.0.learner(environments, seed)
    }
}
