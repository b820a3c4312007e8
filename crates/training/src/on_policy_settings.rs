//! Settings that on-policy algorithms share.

use mishandle_network::Activation;
use mishandle_rollout::Seed;

use crate::declare::{choice, settings};
use crate::minibatches::{Minibatches, check_slices};
use crate::setting::{FINITE, POSITIVE, SIZES, WEIGHTS, ask};
use crate::settings::activation_name;
use crate::{Division, EpisodeSettings, Initialization, RunSettings, TrainingError};

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
    pub run: &'a RunSettings,
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
            run: &$config.run,
            episodes: &$config.episodes,
            policy: &$config.policy,
            critic: &$config.critic,
        }
    };
}

pub(crate) use setup_of;

impl Setup<'_> {
    /// Checks what hangs on more than one setting.
    ///
    /// # Errors
    /// If it is not right; the message says what the one that is named must be.
    pub fn check(&self) -> Result<(), TrainingError> {
        if self.minibatches == Division::Slices {
            check_slices(self.rollout_steps.saturating_mul(self.episodes.environments), self.slices)?;
        }
        self.policy.check_bounds()
    }

    /// The minibatches of each rollout.
    pub fn minibatches(&self, seed: Seed) -> Minibatches {
        let rows = self.rollout_steps * self.episodes.environments;
        let Setup { minibatches, minibatch_rows, slices, .. } = *self;
        Minibatches::new(minibatches, rows, minibatch_rows, slices, seed.child(MINIBATCHES))
    }
}

settings! {
    /// `[policy]`: a Gaussian policy whose deviations do not depend on what is seen.
    pub struct PolicySettings in "policy." {
        /// Widths of the hidden layers; none of them if the list is empty.
        pub hidden: Vec<usize> = vec![64, 64], SIZES;
        /// Activation of the hidden layers.
        #[serde(with = "activation_name")]
        pub activation: Activation = Activation::Elu;
        /// What its network begins with: orthogonal weights; weights and biases drawn evenly from ±1/√inputs, PyTorch's
        /// default; or drawn from N(0, σ²).
        pub initialization: Initialization = Initialization::Orthogonal, WEIGHTS;
        /// log σ of each action at the start: from `min_log_std` to `max_log_std`.
        pub initial_log_std: f64 = -0.5, FINITE;
        /// Smallest log σ.
        pub min_log_std: f64 = -3.0, FINITE;
        /// Largest log σ.
        pub max_log_std: f64 = 0.5, FINITE;
        /// Whether observations are scaled by running moments, for the critic too.
        pub normalize_observations: bool = true;
        /// When these moments follow what is seen.
        pub observation_moments: ObservationMoments = ObservationMoments::Rollout;
    }
}

choice! {
    /// When the moments that scale observations follow what is seen.
    pub enum ObservationMoments {
        /// Once for each rollout, after it was learned from, so that the first ratios are exactly 1.
        Rollout = "rollout",
        /// With each minibatch of the first epoch, before it is learned from, and with its sample variance, as skrl's
        /// `RunningStandardScaler` does; in TRPO with the whole rollout before the step of the policy, too.
        Minibatches = "minibatches",
    }
}

settings! {
    /// `[critic]`: a network that learns the value of observations.
    pub struct CriticSettings in "critic." {
        /// Widths of the hidden layers; none of them if the list is empty.
        pub hidden: Vec<usize> = vec![64, 64], SIZES;
        /// Activation of the hidden layers.
        #[serde(with = "activation_name")]
        pub activation: Activation = Activation::Elu;
        /// What its network begins with, as in `policy.initialization`.
        pub initialization: Initialization = Initialization::Orthogonal, WEIGHTS;
        /// Step length of the optimiser.
        pub learning_rate: f64 = 1e-3, POSITIVE;
        /// Factor on its mean squared error.
        pub loss_scale: f64 = 0.5, POSITIVE;
        /// Whether it learns on the scale of the returns.
        pub normalize_values: bool = true;
        /// What this scale follows.
        pub value_moments: ValueMoments = ValueMoments::Returns;
    }
}

choice! {
    /// What the scale of a critic follows.
    pub enum ValueMoments {
        /// The returns of each rollout.
        Returns = "returns",
        /// First its values, then its returns, both with their sample variance, as skrl's `RunningStandardScaler` does.
        Both = "both",
    }
}

impl PolicySettings {
    /// Checks what hangs on more than one setting.
    pub(crate) fn check_bounds(&self) -> Result<(), TrainingError> {
        let (low, start, high) = (self.min_log_std, self.initial_log_std, self.max_log_std);
        ask("policy.max_log_std", "a number of at least `policy.min_log_std`", high, low <= high)?;
        let inside = "a number from `policy.min_log_std` to `policy.max_log_std`";
        ask("policy.initial_log_std", inside, start, (low..=high).contains(&start))
    }
}
