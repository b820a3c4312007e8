//! Settings that algorithms share, and how settings are read.

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::declare::{choice, settings};
use crate::reading::read;
use crate::setting::{AT_LEAST_1, NOT_NEGATIVE, SHARE};
use crate::{Setting, TrainingError};

/// Settings of an algorithm. As TOML, each is a key of its name; a key that is left out is as the settings preset has it
/// that the key `preset` names (`best`, the defaults, if it names none), one that is not known is an error.
pub trait Settings: Default + Serialize + DeserializeOwned {
    /// Name of the algorithm.
    const ALGORITHM: &'static str;

    /// Settings presets besides `best`: their names, and as TOML what each has other than the defaults.
    const PRESETS: &'static [(&'static str, &'static str)] = &[];

    /// What is known of each setting, in order.
    fn settings() -> Vec<Setting>;

    /// Checks that every setting is in its range.
    ///
    /// # Errors
    /// If one is not; the message says what it must be.
    fn check(&self) -> Result<(), TrainingError>;

    /// Why the result of a training of some steps is not that of a longer one at the same step; `None` if it is.
    fn hangs_on_total(&self) -> Option<&'static str> {
        None
    }

    /// The settings that a TOML text states.
    ///
    /// # Errors
    /// If it is not TOML, a key is not known, or a value is of another kind or out of its range.
    fn from_toml(text: &str) -> Result<Self, TrainingError> {
        read(text)
    }

    /// The settings as TOML, every key with its value; what has none is left out.
    fn to_toml(&self) -> String {
        toml::to_string(self).expect("settings are numbers, names and lists of numbers")
    }
}

settings! {
    /// `[run]`: how long to train, when to look how it goes, when to stop.
    pub struct RunSettings in "run." {
        /// Environment steps (control steps times simulations) of the whole training.
        pub total_steps: u64 = 20_000_000, AT_LEAST_1;
        /// Iterations between two validations.
        pub validation_every: u64 = 20, AT_LEAST_1;
        /// Episodes of a validation.
        pub validation_episodes: usize = 200, AT_LEAST_1;
        /// Success rate on validation at which training may end; never if left out.
        pub stop_success: Option<f64> = None, SHARE;
        /// Strict success rate on validation at which training may end; never if left out.
        pub stop_strict: Option<f64> = None, SHARE;
        /// Validations in a row that have to reach both rates.
        pub stop_validations: u64 = 3, AT_LEAST_1;
        /// Iterations between two checkpoints.
        pub checkpoint_every: u64 = 50, AT_LEAST_1;
    }
}

settings! {
    /// `[episodes]`: the simulations that are learned from.
    pub struct EpisodeSettings in "episodes." {
        /// Simulations that run side by side.
        pub environments: usize = 512, AT_LEAST_1;
        /// Control steps after which the clock ends a training episode; as many as an episode of the task has if left out.
        pub time_limit: Option<usize> = None, AT_LEAST_1;
        /// What is learned from an episode that the clock ended.
        pub time_limits: TimeLimits = TimeLimits::Bootstrap;
        /// Whether first episodes have only a random part of their time, so that the simulations are not in step.
        pub staggered: bool = true;
        /// Standard deviation of noise on each clipped action while training.
        pub action_noise: f64 = 0.0, NOT_NEGATIVE;
    }
}

choice! {
    /// What is learned from an episode that the clock ended.
    pub enum TimeLimits {
        /// What would have followed has its value.
        Bootstrap = "bootstrap",
        /// Nothing of value follows, as if the task had ended it.
        Terminal = "terminal",
    }
}

impl EpisodeSettings {
    /// Checks that every setting is in its range.
    ///
    /// # Errors
    /// If one is not; the message says what it must be.
    pub fn check(&self) -> Result<(), TrainingError> {
        self.check_rules()
    }
}

/// An activation as its name.
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
