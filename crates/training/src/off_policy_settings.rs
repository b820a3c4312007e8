//! Settings that off-policy algorithms share.

use mishandle_network::Activation;
use serde::{Deserialize, Serialize};

use crate::settings::{activation_name, ask, at_least_1, layer_sizes, not_negative, positive};
use crate::{EpisodeSettings, TrainingError};

/// `[replay]`: what is remembered, and how much is learned from it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ReplaySettings {
    /// Control steps that are remembered, of all simulations together. Default 1,000,000.
    pub capacity: usize,
    /// Control steps whose rewards are summed before the critic's value takes over. Default 3.
    pub n_steps: usize,
    /// Rows of a batch. Default 256.
    pub batch_rows: usize,
    /// Environment steps with uniformly random actions, before anything is learned. Default 10,000.
    pub warmup_steps: u64,
    /// Updates for each environment step after that. Default 1/32: four for each control step of 128 simulations.
    pub updates_per_step: f64,
    /// Factor on rewards, so that values have a size that networks like. Default 0.1.
    pub reward_scale: f64,
}

/// `[policy]`: a network that chooses actions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ActorSettings {
    /// Outputs of the hidden layers. Default `[128, 128]`.
    pub hidden: Vec<usize>,
    /// Activation of the hidden layers: `elu`, `tanh` or `relu`. Default `elu`.
    #[serde(with = "activation_name")]
    pub activation: Activation,
    /// Step length of the optimiser. Default 0.0003.
    pub learning_rate: f64,
    /// Whether observations are scaled by running moments, for the critics too. Default true.
    pub normalize_observations: bool,
}

/// `[critic]`: networks that learn the value of actions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ActionValueSettings {
    /// Outputs of the hidden layers. Default `[128, 128]`.
    pub hidden: Vec<usize>,
    /// Activation of the hidden layers: `elu`, `tanh` or `relu`. Default `elu`.
    #[serde(with = "activation_name")]
    pub activation: Activation,
    /// Step length of the optimiser. Default 0.001.
    pub learning_rate: f64,
    /// Whether hidden layers are standardised before their activation. Default true.
    pub layer_norm: bool,
}

impl Default for ReplaySettings {
    fn default() -> ReplaySettings {
        ReplaySettings {
            capacity: 1_000_000,
            n_steps: 3,
            batch_rows: 256,
            warmup_steps: 10_000,
            updates_per_step: 1.0 / 32.0,
            reward_scale: 0.1,
        }
    }
}

impl Default for ActorSettings {
    fn default() -> ActorSettings {
        ActorSettings {
            hidden: vec![128, 128],
            activation: Activation::Elu,
            learning_rate: 3e-4,
            normalize_observations: true,
        }
    }
}

impl Default for ActionValueSettings {
    fn default() -> ActionValueSettings {
        ActionValueSettings {
            hidden: vec![128, 128],
            activation: Activation::Elu,
            learning_rate: 1e-3,
            layer_norm: true,
        }
    }
}

impl ReplaySettings {
    /// Control steps of each simulation before the first batch: after them each remembers at least one whole start.
    pub(crate) fn first_steps(&self) -> usize {
        self.n_steps + 2
    }

    pub(crate) fn check(&self, episodes: &EpisodeSettings) -> Result<(), TrainingError> {
        at_least_1("n_steps", self.n_steps as u64)?;
        at_least_1("batch_rows", self.batch_rows as u64)?;
        not_negative("updates_per_step", self.updates_per_step)?;
        positive("reward_scale", self.reward_scale)?;
        let wanted = "enough for `n_steps` + 3 control steps of each simulation";
        let enough = self.capacity / episodes.environments > self.first_steps();
        ask("replay.capacity", wanted, self.capacity, enough)
    }
}

impl ActorSettings {
    pub(crate) fn check(&self) -> Result<(), TrainingError> {
        layer_sizes("policy.hidden", &self.hidden)?;
        positive("policy.learning_rate", self.learning_rate)
    }
}

impl ActionValueSettings {
    pub(crate) fn check(&self) -> Result<(), TrainingError> {
        layer_sizes("critic.hidden", &self.hidden)?;
        positive("critic.learning_rate", self.learning_rate)
    }
}
