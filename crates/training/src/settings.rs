//! Settings that algorithms share, and how settings are read.

use std::fmt::Display;

use mishandle_network::Activation;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use toml::de::{DeTable, ValueDeserializer};

use crate::presets::{BEST, overlay, preset};
use crate::{Initialization, TrainingError};

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

/// `[policy]`: a Gaussian policy whose deviations do not depend on what is seen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PolicySettings {
    /// Outputs of the hidden layers. Default `[64, 64]`.
    pub hidden: Vec<usize>,
    /// Activation of the hidden layers: `elu`, `tanh` or `relu`. Default `elu`.
    #[serde(with = "activation_name")]
    pub activation: Activation,
    /// Its first weights; see [`Initialization`]. Default `orthogonal`.
    pub initialization: Initialization,
    /// log σ of each action at the start. Default -0.5.
    pub initial_log_std: f64,
    /// Smallest log σ. Default -3.
    pub min_log_std: f64,
    /// Largest log σ. Default 0.5.
    pub max_log_std: f64,
    /// Whether observations are scaled by running moments, for the critic too. Default true.
    pub normalize_observations: bool,
    /// When these moments follow what is seen; see [`ObservationMoments`]. Default `rollout`.
    pub observation_moments: ObservationMoments,
}

/// When the moments that scale observations follow what is seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ObservationMoments {
    /// Once for each rollout, after it was learned from, so that the first ratios are exactly 1.
    Rollout,
    /// With each minibatch of the first epoch, before it is learned from, and with its sample variance, as skrl's
    /// `RunningStandardScaler` does; in TRPO with the whole rollout before the step of the policy, too.
    Minibatches,
}

/// `[critic]`: a network that learns the value of observations.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CriticSettings {
    /// Outputs of the hidden layers. Default `[64, 64]`.
    pub hidden: Vec<usize>,
    /// Activation of the hidden layers: `elu`, `tanh` or `relu`. Default `elu`.
    #[serde(with = "activation_name")]
    pub activation: Activation,
    /// Its first weights; see [`Initialization`]. Default `orthogonal`.
    pub initialization: Initialization,
    /// Step length of the optimiser. Default 0.001.
    pub learning_rate: f64,
    /// Factor on its mean squared error. Default 0.5.
    pub loss_scale: f64,
    /// Whether it learns on the scale of the returns. Default true.
    pub normalize_values: bool,
    /// What this scale follows; see [`ValueMoments`]. Default `returns`.
    pub value_moments: ValueMoments,
}

/// What the scale of a critic follows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ValueMoments {
    /// The returns of each rollout.
    Returns,
    /// First its values, then its returns, both with their sample variance, as skrl's `RunningStandardScaler` does.
    Both,
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

impl Default for PolicySettings {
    fn default() -> PolicySettings {
        PolicySettings {
            hidden: vec![64, 64],
            activation: Activation::Elu,
            initialization: Initialization::Orthogonal,
            initial_log_std: -0.5,
            min_log_std: -3.0,
            max_log_std: 0.5,
            normalize_observations: true,
            observation_moments: ObservationMoments::Rollout,
        }
    }
}

impl Default for CriticSettings {
    fn default() -> CriticSettings {
        CriticSettings {
            hidden: vec![64, 64],
            activation: Activation::Elu,
            initialization: Initialization::Orthogonal,
            learning_rate: 1e-3,
            loss_scale: 0.5,
            normalize_values: true,
            value_moments: ValueMoments::Returns,
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

impl PolicySettings {
    pub(crate) fn check(&self) -> Result<(), TrainingError> {
        layer_sizes("policy.hidden", &self.hidden)?;
        self.initialization.check("policy.initialization.normal")?;
        let (low, start, high) = (self.min_log_std, self.initial_log_std, self.max_log_std);
        number("min_log_std", low)?;
        let above = "a finite number of at least `min_log_std`";
        ask("max_log_std", above, high, low <= high && high.is_finite())?;
        let inside = "a number from `min_log_std` to `max_log_std`";
        ask("initial_log_std", inside, start, (low..=high).contains(&start))
    }
}

impl CriticSettings {
    pub(crate) fn check(&self) -> Result<(), TrainingError> {
        layer_sizes("critic.hidden", &self.hidden)?;
        self.initialization.check("critic.initialization.normal")?;
        positive("critic.learning_rate", self.learning_rate)?;
        positive("critic.loss_scale", self.loss_scale)
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
