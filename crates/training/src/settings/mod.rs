//! Settings: the trait that algorithms implement, the tables that all of them share, reading,
//! listing and bases.

pub(crate) mod bases;
pub(crate) mod declare;
mod listing;
mod read;
mod rewards;
pub(crate) mod scenarios;
pub(crate) mod setting;

use mishandle_controllers::ActionInterface;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::TrainingError;
use declare::{choice, settings};
use setting::{ARRAY_SIZE, AT_LEAST_1, FRACTION, NOISE};

pub use bases::{BASES, BEST};
pub use rewards::RewardSettings;
pub use scenarios::{AxisSetting, CurriculumSettings, ScenarioSettings, SelectionWeights, SpaceSetting};
pub use setting::{Choice, Setting};

/// Settings of an algorithm, readable from TOML.
///
/// Each field is a key of the same name. A missing key takes its value from the settings base that
/// the key `base` names (default: `best`). An unknown key is an error.
pub trait TomlSettings: Default + Serialize + DeserializeOwned {
    /// Name of the algorithm.
    const ALGORITHM: &'static str;

    /// Settings bases besides `best`: name, and the differences from the defaults as TOML.
    const BASES: &'static [(&'static str, &'static str)] = &[];

    /// Returns the facts about each setting, in order of declaration.
    fn settings() -> Vec<Setting>;

    /// Checks the constraints of all settings.
    ///
    /// # Errors
    /// If a value is not allowed; the message states the allowed values.
    fn check(&self) -> Result<(), TrainingError>;

    /// Returns the reason why the result after n steps depends on `run.total_steps`; `None` if it
    /// does not.
    fn depends_on_total_steps(&self) -> Option<&'static str> {
        None
    }

    /// Reads settings from TOML.
    ///
    /// # Errors
    /// If the text is not TOML, contains an unknown key, or assigns a value that is not allowed.
    fn from_toml(text: &str) -> Result<Self, TrainingError> {
        read::read(text)
    }

    /// Returns the settings as TOML: every key with its value, without the settings that are not
    /// set.
    fn to_toml(&self) -> String {
        toml::to_string(self).expect("settings are numbers, names and lists of numbers")
    }
}

settings! {
    /// `[run]`: length of the training run, validation, early stopping, checkpoints.
    pub struct RunSettings in "run." {
        /// Total number of environment steps (control steps times environments).
        pub total_steps: u64 = 20_000_000, AT_LEAST_1;
        /// Controller from which training starts, with its normalizer, which then stays as it
        /// is, but for `policy.std_floor`.
        /// Without it, the policy is random at first. A controller with a shorter history than
        /// `policy.history` gets the longer one.
        pub from: Option<String> = None;
        /// Number of environment steps at the start in which only the critic learns: a controller
        /// has no critic in its file, and a random one would spoil it.
        pub critic_steps: u64 = 0;
        /// Number of iterations between two validations.
        pub validation_interval: u64 = 20, AT_LEAST_1;
        /// Number of episodes of a validation.
        pub validation_episodes: usize = 200, ARRAY_SIZE;
        /// Success rate on validation that allows early stopping; no early stopping by this rate if
        /// not set.
        pub stop_success: Option<f64> = None, FRACTION;
        /// Strict success rate on validation that allows early stopping; no early stopping by this
        /// rate if not set.
        pub stop_strict: Option<f64> = None, FRACTION;
        /// Number of consecutive validations that must reach both rates before training stops
        /// early.
        pub stop_validations: u64 = 3, AT_LEAST_1;
        /// Number of iterations between two checkpoints.
        pub checkpoint_interval: u64 = 50, AT_LEAST_1;
    }
}

settings! {
    /// `[episodes]`: the parallel environments and their episodes.
    pub struct EpisodeSettings in "episodes." {
        /// Number of parallel environments.
        pub environments: usize = 512, ARRAY_SIZE;
        /// Time limit of a training episode in control steps; the task's episode length if not set.
        pub time_limit: Option<usize> = None, AT_LEAST_1;
        /// Treatment of an episode that reaches the time limit.
        pub timeouts: TimeoutHandling = TimeoutHandling::Bootstrap;
        /// Whether each environment's first episode has a random length, so that the environments
        /// are not in phase.
        pub staggered: bool = true;
        /// Further parts of the observation that the policy reads, such as `["joint_targets"]`: see
        /// `mishandle list tasks NAME`.
        pub further_parts: Vec<String> = Vec::new();
        /// Action interface of the controller: velocity (rad/s), acceleration (rad/s²) and velocity
        /// of the target (rad/s) of each joint of the arm, margin at the ends of its range (rad),
        /// and lead of the targets (s). The policy must read `joint_targets`. Not set: actions move
        /// the targets directly.
        pub action_interface: Option<ActionInterface> = None;
        /// Standard deviation of the noise added to each clipped action during training.
        pub action_noise: f64 = 0.0, NOISE;
        /// Standard deviation of the noise added to each number of the observation during training.
        pub observation_noise: f64 = 0.0, NOISE;
    }
}

choice! {
    /// Treatment of an episode that reaches the time limit.
    pub enum TimeoutHandling {
        /// Truncation: the return is bootstrapped with the value of the last observation.
        Bootstrap = "bootstrap",
        /// Termination: the value after the last step is 0.
        Terminal = "terminal",
    }
}

impl RunSettings {
    /// Returns whether the policy learns after `steps` environment steps, or only the critic.
    pub(crate) fn learns_policy(&self, steps: u64) -> bool {
        steps >= self.critic_steps
    }
}

impl EpisodeSettings {
    /// Checks the constraints of all settings.
    ///
    /// # Errors
    /// If a value is not allowed; the message states the allowed values.
    pub fn check(&self) -> Result<(), TrainingError> {
        self.check_constraints()
    }
}

/// Serializes an activation as its name.
pub(crate) mod activation_name {
    use mishandle_network::Activation;
    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    pub fn serialize<S: Serializer>(activation: &Activation, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(activation)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Activation, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(D::Error::custom)
    }
}
