//! Settings of any algorithm, and the learner that they build.

use std::any::Any;
use std::fmt::Debug;

use mishandle_network::NetworkDevice;
use mishandle_rollout::{BatchFactory, Seed, TrainingScenarios};

use crate::learner::Learner;
use crate::learner::origin::Origin;
use crate::settings::setting::require;
use crate::{
    ALGORITHMS, Checkpoint, EpisodeSettings, Observer, RewardSettings, RunSettings, ScenarioSettings,
    Setting, TomlSettings, TrainingError, TrainingResult, learner,
};

/// Settings of one algorithm. Each algorithm implements this trait in its own folder and has a line
/// in [`ALGORITHMS`](crate::ALGORITHMS).
pub(crate) trait Algorithm: TomlSettings + Clone + Debug + PartialEq + Send + Sync + 'static {
    /// One-line summary of the algorithm.
    const SUMMARY: &'static str;

    /// The learner that these settings build.
    type Learner: BuildLearner<Settings = Self>;

    /// Returns the `[run]` table for modification.
    fn run_mut(&mut self) -> &mut RunSettings;

    /// Returns the `[scenarios]` table for modification.
    fn scenarios_mut(&mut self) -> &mut ScenarioSettings;
}

/// A learner that can be built from settings. The on-policy and the off-policy learner implement it
/// for all their algorithms.
pub(crate) trait BuildLearner: Learner + Sized + 'static {
    /// Settings of the algorithm.
    type Settings;

    /// Returns the settings that every algorithm has.
    fn common(settings: &Self::Settings) -> CommonSettings<'_>;

    /// Builds the learner in its state before the first iteration.
    ///
    /// # Errors
    /// If networks of these sizes or the environment batch cannot be created.
    fn build(
        settings: &Self::Settings,
        environments: &dyn BatchFactory,
        seed: Seed,
    ) -> Result<Self, TrainingError>;
}

/// Settings that every algorithm has.
pub(crate) struct CommonSettings<'a> {
    pub run: &'a RunSettings,
    pub episodes: &'a EpisodeSettings,
    pub scenarios: &'a ScenarioSettings,
    pub rewards: &'a RewardSettings,
}

/// Object-safe form of [`Algorithm`].
trait ErasedSettings: Debug + Send + Sync {
    fn algorithm(&self) -> &'static str;
    fn settings(&self) -> Vec<Setting>;
    fn to_toml(&self) -> String;
    fn check(&self) -> Result<(), TrainingError>;
    fn depends_on_total_steps(&self) -> Option<&'static str>;
    fn common(&self) -> CommonSettings<'_>;
    fn run_mut(&mut self) -> &mut RunSettings;
    fn scenarios_mut(&mut self) -> &mut ScenarioSettings;
    fn learner(&self, environments: &dyn BatchFactory, seed: Seed)
    -> Result<Box<dyn Learner>, TrainingError>;
    fn boxed_clone(&self) -> Box<dyn ErasedSettings>;
    fn equals(&self, other: &dyn ErasedSettings) -> bool;
    fn as_any(&self) -> &dyn Any;
}

impl<S: Algorithm> ErasedSettings for S {
    fn algorithm(&self) -> &'static str {
        S::ALGORITHM
    }

    fn settings(&self) -> Vec<Setting> {
        S::settings()
    }

    fn to_toml(&self) -> String {
        TomlSettings::to_toml(self)
    }

    fn check(&self) -> Result<(), TrainingError> {
        TomlSettings::check(self)
    }

    fn depends_on_total_steps(&self) -> Option<&'static str> {
        TomlSettings::depends_on_total_steps(self)
    }

    fn common(&self) -> CommonSettings<'_> {
        S::Learner::common(self)
    }

    fn run_mut(&mut self) -> &mut RunSettings {
        Algorithm::run_mut(self)
    }

    fn scenarios_mut(&mut self) -> &mut ScenarioSettings {
        Algorithm::scenarios_mut(self)
    }

    fn learner(
        &self,
        environments: &dyn BatchFactory,
        seed: Seed,
    ) -> Result<Box<dyn Learner>, TrainingError> {
        Ok(Box::new(S::Learner::build(self, environments, seed)?))
    }

    fn boxed_clone(&self) -> Box<dyn ErasedSettings> {
        Box::new(self.clone())
    }

    fn equals(&self, other: &dyn ErasedSettings) -> bool {
        other.as_any().downcast_ref::<S>() == Some(self)
    }

    fn as_any(&self) -> &dyn Any {
        self
    }
}

/// Settings of one of the [algorithms](ALGORITHMS).
///
/// # Example
/// ```
/// use mishandle_training::{AlgorithmSettings, ppo::PpoSettings};
/// let settings = AlgorithmSettings::from(PpoSettings { gamma: 0.9, ..PpoSettings::default() });
/// assert_eq!(settings, AlgorithmSettings::from_toml("ppo", "gamma = 0.9").unwrap()?);
/// assert_eq!(settings.downcast_ref::<PpoSettings>().unwrap().gamma, 0.9);
/// # Ok::<(), mishandle_training::TrainingError>(())
/// ```
#[derive(Debug)]
pub struct AlgorithmSettings(Box<dyn ErasedSettings>);

impl<S: Algorithm> From<S> for AlgorithmSettings {
    fn from(settings: S) -> AlgorithmSettings {
        AlgorithmSettings(Box::new(settings))
    }
}

impl Clone for AlgorithmSettings {
    fn clone(&self) -> AlgorithmSettings {
        AlgorithmSettings(self.0.boxed_clone())
    }
}

impl PartialEq for AlgorithmSettings {
    fn eq(&self, other: &AlgorithmSettings) -> bool {
        self.0.equals(&*other.0)
    }
}

impl AlgorithmSettings {
    /// Reads the settings of `algorithm` from TOML; returns `None` if the algorithm is unknown.
    ///
    /// # Errors
    /// If the text is not TOML, contains an unknown key, or assigns a value that is not allowed.
    ///
    /// # Example
    /// ```
    /// use mishandle_training::AlgorithmSettings;
    /// let settings = AlgorithmSettings::from_toml("ppo", "run.total_steps = 5_000").unwrap()?;
    /// assert_eq!(settings.run().total_steps, 5_000);
    /// assert!(AlgorithmSettings::from_toml("reinforce", "").is_none());
    /// # Ok::<(), mishandle_training::TrainingError>(())
    /// ```
    pub fn from_toml(algorithm: &str, text: &str) -> Option<Result<AlgorithmSettings, TrainingError>> {
        let entry = ALGORITHMS.iter().find(|entry| entry.name == algorithm)?;
        Some((entry.from_toml)(text))
    }

    /// Returns the name of the algorithm.
    pub fn algorithm(&self) -> &'static str {
        self.0.algorithm()
    }

    /// Returns the settings as those of one algorithm; `None` if they belong to another one.
    pub fn downcast_ref<S: TomlSettings + 'static>(&self) -> Option<&S> {
        self.0.as_any().downcast_ref()
    }

    /// Returns the facts about each setting, in order of declaration.
    pub fn settings(&self) -> Vec<Setting> {
        self.0.settings()
    }

    /// Returns the settings as TOML: every key with its value, without the settings that are not
    /// set.
    pub fn to_toml(&self) -> String {
        self.0.to_toml()
    }

    /// Returns the `[run]` table: length, validation, early stopping, checkpoints.
    pub fn run(&self) -> &RunSettings {
        self.0.common().run
    }

    /// Returns the `[episodes]` table: the parallel environments.
    pub fn episodes(&self) -> &EpisodeSettings {
        self.0.common().episodes
    }

    /// Returns the `[scenarios]` table: the scenarios of the episodes.
    pub fn scenarios(&self) -> &ScenarioSettings {
        self.0.common().scenarios
    }

    /// Returns the `[rewards]` table: the reward terms for the manner.
    pub fn rewards(&self) -> &RewardSettings {
        self.0.common().rewards
    }

    /// Returns the `[scenarios]` table for modification.
    pub fn scenarios_mut(&mut self) -> &mut ScenarioSettings {
        self.0.scenarios_mut()
    }

    /// Returns the `[run]` table for modification.
    pub fn run_mut(&mut self) -> &mut RunSettings {
        self.0.run_mut()
    }

    /// Checks the constraints of all settings.
    ///
    /// # Errors
    /// If a value is not allowed; the message states the allowed values.
    pub fn check(&self) -> Result<(), TrainingError> {
        self.0.check()
    }

    /// Checks that a curriculum has an axis whose range grows.
    ///
    /// # Errors
    /// If the scenarios have none.
    pub fn check_curriculum(&self, scenarios: &TrainingScenarios) -> Result<(), TrainingError> {
        let grows = self.scenarios().curriculum.is_none() || scenarios.can_shrink();
        let expected =
            "not set without an axis whose range can grow; name a space or axes besides those of the start";
        require("scenarios.curriculum", expected, "a curriculum", grows)
    }

    /// Returns the reason why the result after n steps depends on `run.total_steps`; `None` if it
    /// does not.
    pub(crate) fn depends_on_total_steps(&self) -> Option<&'static str> {
        self.0.depends_on_total_steps()
    }

    /// Checks that [`train`](Self::train) with the same arguments could resume from a checkpoint.
    ///
    /// # Errors
    /// If a setting has a value that is not allowed, or the checkpoint belongs to another training
    /// run.
    pub fn check_resumption(
        &self,
        environments: &dyn BatchFactory,
        seed: Seed,
        checkpoint: &Checkpoint,
    ) -> Result<(), TrainingError> {
        learner::check_resumption(self, environments, seed, checkpoint)
    }

    /// Trains a policy in batches from `environments`, on the threads of the current rayon pool. An
    /// [`Arc`](std::sync::Arc) of an [`Environment`](mishandle_rollout::Environment) creates
    /// batches on the CPU.
    ///
    /// From a checkpoint of the same settings, training resumes there and produces the same bits as
    /// an uninterrupted run. Only `run.total_steps` may differ, and only if the learning does not
    /// depend on it.
    ///
    /// # Errors
    /// If a setting has a value that is not allowed, the origin is not that of the settings, a
    /// weight becomes NaN or infinite, or the environment batch fails.
    pub fn train(
        &self,
        environments: &dyn BatchFactory,
        seed: Seed,
        origin: Origin<'_>,
        observer: &mut dyn Observer,
    ) -> Result<TrainingResult, TrainingError> {
        learner::train(self, environments, None, seed, origin, observer)
    }

    /// As [`train`](Self::train), with the networks of the learner on another device, where the
    /// algorithm can use one: PPO does. Another device rounds otherwise, so the weights are not
    /// those of the CPU bit for bit.
    ///
    /// # Errors
    /// As for [`train`](Self::train), and if the device fails.
    pub fn train_on(
        &self,
        environments: &dyn BatchFactory,
        networks: &dyn NetworkDevice,
        seed: Seed,
        origin: Origin<'_>,
        observer: &mut dyn Observer,
    ) -> Result<TrainingResult, TrainingError> {
        learner::train(self, environments, Some(networks), seed, origin, observer)
    }

    /// Builds the learner in its state before the first iteration.
    ///
    /// # Errors
    /// If networks of these sizes or the environment batch cannot be created.
    pub(crate) fn learner(
        &self,
        environments: &dyn BatchFactory,
        seed: Seed,
    ) -> Result<Box<dyn Learner>, TrainingError> {
        self.0.learner(environments, seed)
    }
}
