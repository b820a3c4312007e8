//! Settings that on-policy algorithms share.

use mishandle_network::Activation;
use mishandle_rollout::Seed;

use super::minibatches::{MinibatchScheme, Minibatches, check_minibatch_count};
use crate::settings::activation_name;
use crate::settings::declare::{choice, settings};
use crate::settings::setting::{
    FINITE, HISTORY, INITIALIZATION, LAYER_SIZES, NOT_NEGATIVE, POSITIVE, require,
};
use crate::{EpisodeSettings, Initialization, RewardSettings, RunSettings, ScenarioSettings, TrainingError};

/// Maximum number of rows of a rollout; see [`ARRAY_SIZE`](crate::settings::setting::ARRAY_SIZE).
const MAX_ROLLOUT_ROWS: usize = 100_000_000;

/// Index of the child seed that shuffles minibatches.
const MINIBATCHES: u64 = 3;

/// Settings that on-policy algorithms share.
pub(crate) struct OnPolicySettings<'a> {
    pub rollout_steps: usize,
    pub gamma: f64,
    pub gae_lambda: f64,
    pub minibatches: MinibatchScheme,
    pub minibatch_size: usize,
    pub minibatch_count: usize,
    pub run: &'a RunSettings,
    pub episodes: &'a EpisodeSettings,
    pub scenarios: &'a ScenarioSettings,
    pub rewards: &'a RewardSettings,
    pub policy: &'a PolicySettings,
    pub critic: &'a CriticSettings,
}

/// Returns the [`OnPolicySettings`] of an algorithm, whose fields have the same names.
macro_rules! on_policy_settings {
    ($settings:ident) => {
        $crate::on_policy::settings::OnPolicySettings {
            rollout_steps: $settings.rollout_steps,
            gamma: $settings.gamma,
            gae_lambda: $settings.gae_lambda,
            minibatches: $settings.minibatches,
            minibatch_size: $settings.minibatch_size,
            minibatch_count: $settings.minibatch_count,
            run: &$settings.run,
            episodes: &$settings.episodes,
            scenarios: &$settings.scenarios,
            rewards: &$settings.rewards,
            policy: &$settings.policy,
            critic: &$settings.critic,
        }
    };
}

pub(crate) use on_policy_settings;

impl OnPolicySettings<'_> {
    /// Checks constraints between settings.
    ///
    /// # Errors
    /// If a setting does not fit the others.
    pub fn check(&self) -> Result<(), TrainingError> {
        let rows = self.rollout_steps.saturating_mul(self.episodes.environments);
        let expected = "at most 10^8 divided by `episodes.environments`";
        require("rollout_steps", expected, self.rollout_steps as f64, rows <= MAX_ROLLOUT_ROWS)?;
        if self.minibatches == MinibatchScheme::Slices {
            check_minibatch_count(rows, self.minibatch_count)?;
        }
        self.scenarios.check_shares()?;
        self.policy.check_bounds()
    }

    /// Creates the minibatches of a rollout; `seed` is that of the training run.
    pub fn minibatches(&self, seed: Seed) -> Minibatches {
        let rows = self.rollout_steps * self.episodes.environments;
        let OnPolicySettings { minibatches, minibatch_size, minibatch_count, .. } = *self;
        Minibatches::new(minibatches, rows, minibatch_size, minibatch_count, seed.child(MINIBATCHES))
    }
}

settings! {
    /// `[policy]`: a Gaussian policy with state-independent standard deviations.
    pub struct PolicySettings in "policy." {
        /// Sizes of the hidden layers; an empty list means a linear policy.
        pub hidden: Vec<usize> = vec![64, 64], LAYER_SIZES;
        /// Activation function of the hidden layers.
        #[serde(with = "activation_name")]
        pub activation: Activation = Activation::Elu;
        /// Number of earlier control steps whose observations and own actions are inputs of policy
        /// and critic, besides the present observation. 0 means no history.
        pub history: usize = 0, HISTORY;
        /// Initialization of the network: orthogonal weights; weights and biases uniform in
        /// ±1/√inputs, the PyTorch default; or weights and biases from N(0, σ²).
        pub initialization: Initialization = Initialization::Orthogonal, INITIALIZATION;
        /// Initial log σ of each action, from `min_log_std` to `max_log_std`.
        pub initial_log_std: f64 = -0.5, FINITE;
        /// Lower bound of log σ.
        pub min_log_std: f64 = -3.0, FINITE;
        /// Upper bound of log σ.
        pub max_log_std: f64 = 0.5, FINITE;
        /// Whether policy and critic see observations normalized by running moments.
        pub normalize_observations: bool = true;
        /// Smallest standard deviation of the running moments of each number of the observation, in
        /// the unit of the observation. A number that is constant during training then stays
        /// harmless if noise changes it later. 0 means no floor.
        pub std_floor: f64 = 0.0, NOT_NEGATIVE;
        /// When the running moments are updated.
        pub observation_moments: ObservationMoments = ObservationMoments::Rollout;
    }
}

choice! {
    /// When the running moments of observations are updated.
    pub enum ObservationMoments {
        /// Once per rollout, after the updates, so that the initial probability ratios are
        /// exactly 1.
        Rollout = "rollout",
        /// Before each minibatch of the first epoch, with its sample variance, as skrl's
        /// `RunningStandardScaler` does; in TRPO also from the whole rollout before the policy
        /// step.
        Minibatches = "minibatches",
    }
}

settings! {
    /// `[critic]`: the state-value network.
    pub struct CriticSettings in "critic." {
        /// Sizes of the hidden layers; an empty list means a linear value function.
        pub hidden: Vec<usize> = vec![64, 64], LAYER_SIZES;
        /// Activation function of the hidden layers.
        #[serde(with = "activation_name")]
        pub activation: Activation = Activation::Elu;
        /// Initialization of the network, as in `policy.initialization`.
        pub initialization: Initialization = Initialization::Orthogonal, INITIALIZATION;
        /// Learning rate of Adam.
        pub learning_rate: f64 = 1e-3, POSITIVE;
        /// Whether the value function also sees what the policy cannot: the values of the episode's
        /// scenario, and the observation of the environment without noise, delays and faults.
        pub sees_scenario: bool = false;
        /// Coefficient of the mean squared error.
        pub loss_coef: f64 = 0.5, POSITIVE;
        /// Whether value targets are normalized by running moments.
        pub normalize_values: bool = true;
        /// Data of these moments.
        pub value_moments: ValueMoments = ValueMoments::Returns;
    }
}

choice! {
    /// Data of the running moments of values.
    pub enum ValueMoments {
        /// The returns of each rollout.
        Returns = "returns",
        /// First the values, then the returns, both with their sample variance, as skrl's
        /// `RunningStandardScaler` does.
        Both = "both",
    }
}

impl PolicySettings {
    /// Checks that the initial log σ lies within its bounds.
    pub(crate) fn check_bounds(&self) -> Result<(), TrainingError> {
        let low = self.min_log_std;
        let initial = self.initial_log_std;
        let high = self.max_log_std;
        require("policy.max_log_std", "a number of at least `policy.min_log_std`", high, low <= high)?;
        let expected = "a number from `policy.min_log_std` to `policy.max_log_std`";
        require("policy.initial_log_std", expected, initial, (low..=high).contains(&initial))
    }
}
