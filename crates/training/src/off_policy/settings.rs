//! Settings that off-policy algorithms share.

use mishandle_network::Activation;
use serde::{Deserialize, Serialize};

use crate::settings::activation_name;
use crate::settings::declare::{choice, settings};
use crate::settings::setting::{
    ARRAY_SIZE, AT_LEAST_1, CAPACITY, HISTORY, INITIALIZATION, LAYER_SIZES, NOT_NEGATIVE, POSITIVE, kind,
    require,
};
use crate::{EpisodeSettings, Initialization, RewardSettings, RunSettings, ScenarioSettings, TrainingError};

/// Settings that off-policy algorithms share.
pub(crate) struct OffPolicySettings<'a> {
    pub gamma: f64,
    pub steps_per_iteration: usize,
    pub run: &'a RunSettings,
    pub episodes: &'a EpisodeSettings,
    pub scenarios: &'a ScenarioSettings,
    pub rewards: &'a RewardSettings,
    pub replay: &'a ReplayBufferSettings,
    pub policy: &'a ActorSettings,
    pub critic: &'a QCriticSettings,
}

settings! {
    /// `[replay]`: the replay buffer and the number of updates.
    pub struct ReplayBufferSettings in "replay." {
        /// Capacity in control steps of all environments together; at least `n_steps` + 3 per
        /// environment.
        pub capacity: usize = 1_000_000, CAPACITY;
        /// Number n of steps in the n-step return of the critic's target.
        pub n_steps: usize = 3, AT_LEAST_1;
        /// Batch size; without `replacement` at most the number of environments.
        pub batch_size: usize = 256, ARRAY_SIZE;
        /// Whether batches are sampled with replacement.
        pub replacement: bool = true;
        /// Number of environment steps with uniformly random actions before the first update.
        pub warmup_steps: u64 = 10_000;
        /// Number of updates per step after the warm-up; 1/32 is four per control step of 128
        /// environments.
        pub updates_per_step: f64 = 1.0 / 32.0, NOT_NEGATIVE;
        /// Unit of the steps in `updates_per_step`.
        pub updates_unit: UpdateUnit = UpdateUnit::EnvironmentSteps;
        /// Factor on the rewards that the critic sees.
        pub reward_scale: f64 = 0.1, POSITIVE;
    }
}

choice! {
    /// Unit of the steps in `updates_per_step`.
    pub enum UpdateUnit {
        /// Control steps times environments.
        EnvironmentSteps = "environment-steps",
        /// Control steps, independent of the number of environments.
        ControlSteps = "control-steps",
    }
}

settings! {
    /// `[policy]`: the policy network.
    pub struct ActorSettings in "policy." {
        /// Sizes of the hidden layers; an empty list means a linear policy.
        pub hidden: Vec<usize> = vec![128, 128], LAYER_SIZES;
        /// Activation function of the hidden layers.
        #[serde(with = "activation_name")]
        pub activation: Activation = Activation::Elu;
        /// Number of earlier control steps whose observations and own actions are inputs of policy
        /// and critics, besides the present observation. 0 means no history.
        pub history: usize = 0, HISTORY;
        /// Learning rate of Adam.
        pub learning_rate: f64 = 3e-4, POSITIVE;
        /// Whether policy and critics see observations normalized by running moments.
        pub normalize_observations: bool = true;
        /// Smallest standard deviation of the running moments of each number of the observation, in
        /// the unit of the observation. A number that is constant during training then stays
        /// harmless if noise changes it later. 0 means no floor.
        pub std_floor: f64 = 0.0, NOT_NEGATIVE;
        /// Initialization of the network: orthogonal weights; weights and biases uniform in
        /// ±1/√inputs, the PyTorch default; or weights and biases from N(0, σ²).
        pub initialization: Initialization = Initialization::Orthogonal, INITIALIZATION;
    }
}

settings! {
    /// `[critic]`: the action-value networks (Q-networks).
    pub struct QCriticSettings in "critic." {
        /// Sizes of the hidden layers; an empty list means a linear value function.
        pub hidden: Vec<usize> = vec![128, 128], LAYER_SIZES;
        /// Activation function of the hidden layers.
        #[serde(with = "activation_name")]
        pub activation: Activation = Activation::Elu;
        /// Learning rate of Adam.
        pub learning_rate: f64 = 1e-3, POSITIVE;
        /// Whether the critics also see what the policy cannot: the values of the episode's
        /// scenario, and the observation of the environment without noise, delays and faults.
        pub sees_scenario: bool = false;
        /// Whether hidden layers have layer normalization before their activation.
        pub layer_norm: bool = true;
        /// Initialization of the networks, as in `policy.initialization`.
        pub initialization: Initialization = Initialization::Orthogonal, INITIALIZATION;
    }
}

/// `exploration_decay`: linear decay of the exploration noise at the start of training.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExplorationDecay {
    /// Length of the decay in environment steps.
    pub steps: u64,
    /// Fraction of the noise that remains after the decay.
    pub share: f64,
}

impl ExplorationDecay {
    /// Returns the fraction of the noise after `steps` environment steps.
    ///
    /// # Example
    /// ```
    /// use mishandle_training::ExplorationDecay;
    /// let decay = ExplorationDecay { steps: 1000, share: 0.25 };
    /// assert_eq!([0, 500, 1000, 5000].map(|steps| decay.noise_factor(steps)), [1.0, 0.625, 0.25, 0.25]);
    /// ```
    pub fn noise_factor(&self, steps: u64) -> f64 {
        let elapsed = steps.min(self.steps) as f64 / self.steps as f64;
        1.0 - elapsed * (1.0 - self.share)
    }
}

kind!(ExplorationDecay, "a table", decay => Some(vec![decay.steps as f64, decay.share]));

impl ReplayBufferSettings {
    /// Returns the total number of updates due after `steps` control steps of `rows` environments.
    pub(crate) fn updates_due(&self, steps: u64, rows: u64) -> u64 {
        if steps < self.steps_before_updates() as u64 {
            return 0;
        }
        let environment_steps = (steps * rows).saturating_sub(self.warmup_steps) as f64;
        let counted = match self.updates_unit {
            UpdateUnit::EnvironmentSteps => environment_steps,
            UpdateUnit::ControlSteps => environment_steps / rows as f64,
        };
        (counted * self.updates_per_step) as u64
    }

    /// Returns the number of control steps per environment before the first update, after which
    /// each environment has at least one complete n-step return.
    pub(crate) fn steps_before_updates(&self) -> usize {
        self.n_steps + 2
    }

    /// Checks constraints between settings.
    ///
    /// # Errors
    /// If batch size or capacity does not fit the number of environments.
    pub(crate) fn check_sizes(&self, episodes: &EpisodeSettings) -> Result<(), TrainingError> {
        // At the first update each environment may have only one transition to sample.
        let expected = "at most `episodes.environments` without `replay.replacement`";
        let fits = self.replacement || self.batch_size <= episodes.environments;
        require("replay.batch_size", expected, self.batch_size, fits)?;
        let expected = "at least `replay.n_steps` + 3 control steps per environment";
        let fits = self.capacity / episodes.environments >= self.n_steps.saturating_add(3);
        require("replay.capacity", expected, self.capacity, fits)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn updates_are_proportional_to_environment_steps_or_to_control_steps() {
        let replay = |updates_per_step, updates_unit| ReplayBufferSettings {
            n_steps: 1,
            warmup_steps: 20,
            updates_per_step,
            updates_unit,
            ..ReplayBufferSettings::default()
        };
        let due = |replay: &ReplayBufferSettings| [2, 3, 12].map(|steps| replay.updates_due(steps, 10));
        // A quarter of 120 - 20 environment steps.
        assert_eq!(due(&replay(0.25, UpdateUnit::EnvironmentSteps)), [0, 2, 25]);
        // 12 - 2 control steps.
        assert_eq!(due(&replay(1.0, UpdateUnit::ControlSteps)), [0, 1, 10]);
    }

    #[test]
    fn batch_size_without_replacement_is_at_most_the_number_of_environments() {
        let replay =
            ReplayBufferSettings { replacement: false, batch_size: 65, ..ReplayBufferSettings::default() };
        let checked = |environments| {
            let episodes = EpisodeSettings { environments, ..EpisodeSettings::default() };
            replay.check_sizes(&episodes).map_err(|error| error.to_string())
        };
        assert_eq!(checked(65), Ok(()));
        let expected = "the setting `replay.batch_size` must be at most `episodes.environments` without `replay.replacement`";
        assert_eq!(checked(64), Err(format!("{expected}, found 65")));
    }
}
