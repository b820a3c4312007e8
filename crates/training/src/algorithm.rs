//! The algorithms by their names.

use std::sync::Arc;

use mishandle_rollout::{Environment, Seed};

use crate::ddpg::{Ddpg, DdpgConfig};
use crate::learner::Learner;
use crate::off_policy::OffPolicy;
use crate::on_policy::OnPolicy;
use crate::ppo::{Ppo, PpoConfig};
use crate::sac::{Sac, SacConfig};
use crate::td3::{Td3, Td3Config};
use crate::trpo::{Trpo, TrpoConfig};
use crate::{Checkpoint, EpisodeSettings, Observer, RunSettings, Settings, Trained, TrainingError, learner};

/// Names of the algorithms.
pub const ALGORITHMS: [&str; 5] = [
    PpoConfig::ALGORITHM,
    TrpoConfig::ALGORITHM,
    SacConfig::ALGORITHM,
    Td3Config::ALGORITHM,
    DdpgConfig::ALGORITHM,
];

/// Settings of one of the algorithms.
#[derive(Clone, Debug, PartialEq)]
pub enum Config {
    /// Proximal policy optimisation.
    Ppo(PpoConfig),
    /// Trust region policy optimisation.
    Trpo(TrpoConfig),
    /// Soft actor-critic.
    Sac(SacConfig),
    /// Twin delayed deep deterministic policy gradient.
    Td3(Td3Config),
    /// Deep deterministic policy gradient.
    Ddpg(DdpgConfig),
}

/// The same for every algorithm.
macro_rules! each {
    ($config:expr, $own:ident => $what:expr) => {
        match $config {
            Config::Ppo($own) => $what,
            Config::Trpo($own) => $what,
            Config::Sac($own) => $what,
            Config::Td3($own) => $what,
            Config::Ddpg($own) => $what,
        }
    };
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
        match algorithm {
            PpoConfig::ALGORITHM => Some(PpoConfig::from_toml(text).map(Config::Ppo)),
            TrpoConfig::ALGORITHM => Some(TrpoConfig::from_toml(text).map(Config::Trpo)),
            SacConfig::ALGORITHM => Some(SacConfig::from_toml(text).map(Config::Sac)),
            Td3Config::ALGORITHM => Some(Td3Config::from_toml(text).map(Config::Td3)),
            DdpgConfig::ALGORITHM => Some(DdpgConfig::from_toml(text).map(Config::Ddpg)),
            _ => None,
        }
    }

    /// Name of the algorithm.
    pub fn algorithm(&self) -> &'static str {
        match self {
            Config::Ppo(_) => PpoConfig::ALGORITHM,
            Config::Trpo(_) => TrpoConfig::ALGORITHM,
            Config::Sac(_) => SacConfig::ALGORITHM,
            Config::Td3(_) => Td3Config::ALGORITHM,
            Config::Ddpg(_) => DdpgConfig::ALGORITHM,
        }
    }

    /// The settings as TOML, every key with its value; what has none is left out.
    pub fn to_toml(&self) -> String {
        each!(self, own => own.to_toml())
    }

    /// How long to train, and when to look.
    pub fn run(&self) -> &RunSettings {
        each!(self, own => &own.run)
    }

    /// The simulations that are learned from.
    pub fn episodes(&self) -> &EpisodeSettings {
        each!(self, own => &own.episodes)
    }

    /// How long to train, and when to look, to be set.
    pub fn run_mut(&mut self) -> &mut RunSettings {
        each!(self, own => &mut own.run)
    }

    /// Checks that every setting is in its range.
    ///
    /// # Errors
    /// If one is not; the message says what it must be.
    pub fn check(&self) -> Result<(), TrainingError> {
        each!(self, own => own.check())
    }

    /// Outputs of the hidden layers of policy and critic.
    pub(crate) fn hidden(&self) -> [&[usize]; 2] {
        each!(self, own => [&own.policy.hidden, &own.critic.hidden])
    }

    /// Why a training of some steps is not the beginning of a longer one; `None` if it is.
    pub(crate) fn hangs_on_total(&self) -> Option<&'static str> {
        each!(self, own => own.hangs_on_total())
    }

    /// Checks that a training with the same arguments could go on from a checkpoint.
    ///
    /// # Errors
    /// If a setting is out of its range, or the checkpoint is another training's.
    pub fn check_resumption(
        &self,
        environment: Arc<dyn Environment>,
        seed: Seed,
        checkpoint: &Checkpoint,
    ) -> Result<(), TrainingError> {
        learner::check_resumption(self, environment, seed, checkpoint)
    }

    /// Trains a policy in `environment`, on the threads of the current rayon pool.
    ///
    /// With a checkpoint of the same settings it goes on from there, to the same bits as if it had not been
    /// interrupted. Only `run.total_steps` may differ, and only if what is learned does not hang on it.
    ///
    /// # Errors
    /// If a setting is out of its range, the checkpoint is another training's, or the weights stop being finite.
    pub fn train(
        &self,
        environment: Arc<dyn Environment>,
        seed: Seed,
        resume: Option<&Checkpoint>,
        observer: &mut dyn Observer,
    ) -> Result<Trained, TrainingError> {
        learner::train(self, environment, seed, resume, observer)
    }

    /// The algorithm before its first iteration.
    ///
    /// # Errors
    /// If networks of these sizes cannot be made.
    pub(crate) fn learner(
        &self,
        environment: Arc<dyn Environment>,
        seed: Seed,
    ) -> Result<Box<dyn Learner>, TrainingError> {
        Ok(match self {
            Config::Ppo(own) => Box::new(OnPolicy::<Ppo>::new(environment, own, seed)?),
            Config::Trpo(own) => Box::new(OnPolicy::<Trpo>::new(environment, own, seed)?),
            Config::Sac(own) => Box::new(OffPolicy::<Sac>::new(environment, own, seed)?),
            Config::Td3(own) => Box::new(OffPolicy::<Td3>::new(environment, own, seed)?),
            Config::Ddpg(own) => Box::new(OffPolicy::<Ddpg>::new(environment, own, seed)?),
        })
    }
}
