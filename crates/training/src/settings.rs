//! Settings that algorithms share, and how settings are read.

use std::fmt::Display;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use toml::de::{DeTable, ValueDeserializer};

use crate::TrainingError;
use crate::presets::{BEST, overlay, preset};

/// Settings of an algorithm. As TOML, each is a key of its name; a key that is left out is as the preset has it that
/// the key `preset` names (`best`, the defaults, if it names none), one that is not known is an error.
pub trait Settings: Default + Serialize + DeserializeOwned {
    /// Name of the algorithm.
    const ALGORITHM: &'static str;

    /// Presets besides `best`: their names, and as TOML what each has other than the defaults.
    const PRESETS: &'static [(&'static str, &'static str)] = &[];

    /// Checks that every setting is in its range.
    ///
    /// # Errors
    /// If one is not; the message says what it must be.
    fn check(&self) -> Result<(), TrainingError>;

    /// The settings that a TOML text states.
    ///
    /// # Errors
    /// If it is not TOML, a key is not known, or a value is of another type or out of its range.
    fn from_toml(text: &str) -> Result<Self, TrainingError> {
        let settings: Self = read(text)?;
        settings.check()?;
        Ok(settings)
    }

    /// The settings as TOML, every key with its value; what has none is left out.
    fn to_toml(&self) -> String {
        toml::to_string(self).expect("settings are numbers, names and lists of numbers")
    }
}

/// `[run]`: how long to train, when to look how it goes, when to stop.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RunSettings {
    /// Environment steps (control steps times simulations) of the whole training. Default 20,000,000.
    pub total_steps: u64,
    /// Iterations between two validations. Default 20.
    pub validation_every: u64,
    /// Episodes of a validation. Default 200.
    pub validation_episodes: usize,
    /// Success rate on validation at which training may end; never if left out.
    pub stop_success: Option<f64>,
    /// Strict success rate on validation at which training may end; never if left out.
    pub stop_strict: Option<f64>,
    /// Validations in a row that have to reach both rates. Default 3.
    pub stop_validations: u64,
    /// Iterations between two checkpoints. Default 50.
    pub checkpoint_every: u64,
}

/// `[episodes]`: the simulations that are learned from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EpisodeSettings {
    /// Simulations that run side by side. Default 512.
    pub environments: usize,
    /// Control steps after which the clock ends a training episode; default the environment's.
    pub time_limit: Option<usize>,
    /// What is learned from an episode that the clock ended: `bootstrap`, that what would have followed has its value;
    /// or `terminal`, that nothing of value follows, as if the task had ended it. Default `bootstrap`.
    pub time_limits: TimeLimits,
    /// Whether first episodes have only a random part of their time, so that the simulations are not in step.
    /// Default true.
    pub staggered: bool,
    /// Standard deviation of noise on each clipped action while training. Default 0.
    pub action_noise: f64,
}

/// What is learned from an episode that the clock ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TimeLimits {
    /// What would have followed has its value.
    Bootstrap,
    /// Nothing of value follows, as if the task had ended it.
    Terminal,
}

impl Default for RunSettings {
    fn default() -> RunSettings {
        RunSettings {
            total_steps: 20_000_000,
            validation_every: 20,
            validation_episodes: 200,
            stop_success: None,
            stop_strict: None,
            stop_validations: 3,
            checkpoint_every: 50,
        }
    }
}

impl Default for EpisodeSettings {
    fn default() -> EpisodeSettings {
        EpisodeSettings {
            environments: 512,
            time_limit: None,
            time_limits: TimeLimits::Bootstrap,
            staggered: true,
            action_noise: 0.0,
        }
    }
}

impl RunSettings {
    pub(crate) fn check(&self) -> Result<(), TrainingError> {
        let rate = |name, rate: Option<f64>| {
            let found = rate.map_or(String::new(), |rate| rate.to_string());
            ask(name, SHARE, found, rate.is_none_or(is_share))
        };
        at_least_1("total_steps", self.total_steps)?;
        at_least_1("validation_every", self.validation_every)?;
        at_least_1("validation_episodes", self.validation_episodes as u64)?;
        rate("stop_success", self.stop_success)?;
        rate("stop_strict", self.stop_strict)?;
        at_least_1("stop_validations", self.stop_validations)?;
        at_least_1("checkpoint_every", self.checkpoint_every)
    }
}

impl EpisodeSettings {
    /// Checks that every setting is in its range.
    ///
    /// # Errors
    /// If one is not; the message says what it must be.
    pub fn check(&self) -> Result<(), TrainingError> {
        at_least_1("environments", self.environments as u64)?;
        at_least_1("time_limit", self.time_limit.unwrap_or(1) as u64)?;
        not_negative("action_noise", self.action_noise)
    }
}

/// Settings from a TOML text: a key that is left out, at any depth, has the value that it has in the preset that the
/// text names; one that is not known is an error.
fn read<S: Settings>(text: &str) -> Result<S, TrainingError> {
    let told = |error: toml::de::Error| {
        let start = error.span().map_or(0, |span| span.start).min(text.len());
        let line = 1 + text.as_bytes()[..start].iter().filter(|byte| **byte == b'\n').count();
        TrainingError::Settings { line, message: error.message().replace('\n', ", ") }
    };
    let mut stated = DeTable::parse(text).map_err(told)?;
    let mut settings = match stated.get_mut().remove("preset") {
        Some(name) => preset::<S>(&String::deserialize(ValueDeserializer::from(name)).map_err(told)?)?,
        None => preset::<S>(BEST)?,
    };
    // The first reading finds mistakes, and knows their lines.
    S::deserialize(toml::Deserializer::from(stated.clone())).map_err(told)?;
    overlay(&mut settings, toml::Table::deserialize(toml::Deserializer::from(stated)).map_err(told)?);
    settings.try_into().map_err(told)
}

const SHARE: &str = "a number from 0 to 1";

fn is_share(x: f64) -> bool {
    (0.0..=1.0).contains(&x)
}

pub(crate) fn share(name: &'static str, x: f64) -> Result<(), TrainingError> {
    ask(name, SHARE, x, is_share(x))
}

pub(crate) fn at_least_1(name: &'static str, count: u64) -> Result<(), TrainingError> {
    ask(name, "at least 1", count, count >= 1)
}

pub(crate) fn positive(name: &'static str, x: f64) -> Result<(), TrainingError> {
    ask(name, "a number above 0", x, x > 0.0 && x.is_finite())
}

pub(crate) fn not_negative(name: &'static str, x: f64) -> Result<(), TrainingError> {
    ask(name, "a number of at least 0", x, x >= 0.0 && x.is_finite())
}

pub(crate) fn number(name: &'static str, x: f64) -> Result<(), TrainingError> {
    ask(name, "a finite number", x, x.is_finite())
}

pub(crate) fn layer_sizes(name: &'static str, hidden: &[usize]) -> Result<(), TrainingError> {
    ask(name, "sizes of at least 1", format!("{hidden:?}"), !hidden.contains(&0))
}

pub(crate) fn ask(
    name: &'static str,
    wanted: &'static str,
    found: impl Display,
    right: bool,
) -> Result<(), TrainingError> {
    if right { Ok(()) } else { Err(TrainingError::Setting { name, wanted, found: found.to_string() }) }
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
