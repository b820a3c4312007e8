//! Settings that on-policy algorithms share.

use mishandle_network::Activation;
use mishandle_rollout::Seed;
use serde::{Deserialize, Serialize};

use crate::minibatches::Minibatches;
use crate::settings::{activation_name, ask, layer_sizes, number, positive};
use crate::{Division, EpisodeSettings, Initialization, TrainingError};

/// The child of the training's seed that shuffles minibatches.
const MINIBATCHES: u64 = 3;

/// Settings that an on-policy algorithm shares with the others.
pub(crate) struct Setup<'a> {
    pub rollout_steps: usize,
    pub gamma: f64,
    pub gae_lambda: f64,
    pub minibatches: Division,
    pub minibatch_rows: usize,
    pub slices: usize,
    pub episodes: &'a EpisodeSettings,
    pub policy: &'a PolicySettings,
    pub critic: &'a CriticSettings,
}

/// The [`Setup`] in the settings of an algorithm, whose fields have the same names.
macro_rules! setup_of {
    ($config:ident) => {
        $crate::on_policy_settings::Setup {
            rollout_steps: $config.rollout_steps,
            gamma: $config.gamma,
            gae_lambda: $config.gae_lambda,
            minibatches: $config.minibatches,
            minibatch_rows: $config.minibatch_rows,
            slices: $config.slices,
            episodes: &$config.episodes,
            policy: &$config.policy,
            critic: &$config.critic,
        }
    };
}

pub(crate) use setup_of;

impl Setup<'_> {
    /// The minibatches of each rollout.
    pub fn minibatches(&self, seed: Seed) -> Minibatches {
        let rows = self.rollout_steps * self.episodes.environments;
        let Setup { minibatches, minibatch_rows, slices, .. } = *self;
        Minibatches::new(minibatches, rows, minibatch_rows, slices, seed.child(MINIBATCHES))
    }
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
