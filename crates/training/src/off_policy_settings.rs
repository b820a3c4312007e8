//! Settings that off-policy algorithms share.

use mishandle_network::Activation;
use serde::{Deserialize, Serialize};

use crate::declare::{choice, settings};
use crate::setting::{AT_LEAST_1, NOT_NEGATIVE, POSITIVE, SIZES, WEIGHTS, ask, kind};
use crate::settings::activation_name;
use crate::{EpisodeSettings, Initialization, TrainingError};

settings! {
    /// `[replay]`: what is remembered, and how much is learned from it.
    pub struct ReplaySettings in "replay." {
        /// Control steps that are remembered, of all simulations together: enough for `n_steps` + 3 of each.
        pub capacity: usize = 1_000_000;
        /// Control steps whose rewards are summed before the critic's value takes over.
        pub n_steps: usize = 3, AT_LEAST_1;
        /// Rows of a batch; without `replacement` no more than there are simulations.
        pub batch_rows: usize = 256, AT_LEAST_1;
        /// Whether a control step may come more than once in a batch.
        pub replacement: bool = true;
        /// Environment steps with uniformly random actions, before anything is learned.
        pub warmup_steps: u64 = 10_000;
        /// Updates for each step after that; 1/32 is four for each control step of 128 simulations.
        pub updates_per_step: f64 = 1.0 / 32.0, NOT_NEGATIVE;
        /// Whose steps `updates_per_step` counts.
        pub updates_count: UpdateCount = UpdateCount::EnvironmentSteps;
        /// Factor on rewards, so that values have a size that networks like.
        pub reward_scale: f64 = 0.1, POSITIVE;
    }
}

choice! {
    /// What updates are in proportion to.
    pub enum UpdateCount {
        /// Control steps times simulations.
        EnvironmentSteps = "environment-steps",
        /// Control steps, however many simulations make them at once.
        ControlSteps = "control-steps",
    }
}

settings! {
    /// `[policy]`: a network that chooses actions.
    pub struct ActorSettings in "policy." {
        /// Widths of the hidden layers; none of them if the list is empty.
        pub hidden: Vec<usize> = vec![128, 128], SIZES;
        /// Activation of the hidden layers.
        #[serde(with = "activation_name")]
        pub activation: Activation = Activation::Elu;
        /// Step length of the optimiser.
        pub learning_rate: f64 = 3e-4, POSITIVE;
        /// Whether observations are scaled by running moments, for the critics too.
        pub normalize_observations: bool = true;
        /// What its network begins with: orthogonal weights; weights and biases drawn evenly from ±1/√inputs, PyTorch's
        /// default; or drawn from N(0, σ²).
        pub initialization: Initialization = Initialization::Orthogonal, WEIGHTS;
    }
}

settings! {
    /// `[critic]`: networks that learn the value of actions.
    pub struct ActionValueSettings in "critic." {
        /// Widths of the hidden layers; none of them if the list is empty.
        pub hidden: Vec<usize> = vec![128, 128], SIZES;
        /// Activation of the hidden layers.
        #[serde(with = "activation_name")]
        pub activation: Activation = Activation::Elu;
        /// Step length of the optimiser.
        pub learning_rate: f64 = 1e-3, POSITIVE;
        /// Whether hidden layers are standardised before their activation.
        pub layer_norm: bool = true;
        /// What its networks begin with, as in `policy.initialization`.
        pub initialization: Initialization = Initialization::Orthogonal, WEIGHTS;
    }
}

/// `exploration_decay`: how exploring noise falls, linearly, in the beginning of a training.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExplorationDecay {
    /// Environment steps over which it falls.
    pub steps: u64,
    /// What is left of it then, as a share.
    pub share: f64,
}

impl ExplorationDecay {
    /// The share of the noise after `steps` environment steps.
    ///
    /// # Example
    /// ```
    /// use mishandle_training::ExplorationDecay;
    /// let decay = ExplorationDecay { steps: 1000, share: 0.25 };
    /// assert_eq!([0, 500, 1000, 5000].map(|steps| decay.share_after(steps)), [1.0, 0.625, 0.25, 0.25]);
    /// ```
    pub fn share_after(&self, steps: u64) -> f64 {
        let gone = steps.min(self.steps) as f64 / self.steps as f64;
        1.0 - gone * (1.0 - self.share)
    }
}

kind!(ExplorationDecay, "a table", decay => Some(vec![decay.steps as f64, decay.share]));

impl ReplaySettings {
    /// Updates that are due after `steps` control steps of `rows` simulations each.
    pub(crate) fn updates_due(&self, steps: u64, rows: u64) -> u64 {
        if steps < self.first_steps() as u64 {
            return 0;
        }
        let learned_from = (steps * rows).saturating_sub(self.warmup_steps) as f64;
        let counted = match self.updates_count {
            UpdateCount::EnvironmentSteps => learned_from,
            UpdateCount::ControlSteps => learned_from / rows as f64,
        };
        (counted * self.updates_per_step) as u64
    }

    /// Control steps of each simulation before the first batch: after them each remembers at least one whole start.
    pub(crate) fn first_steps(&self) -> usize {
        self.n_steps + 2
    }

    /// Checks what hangs on more than one setting.
    pub(crate) fn check_sizes(&self, episodes: &EpisodeSettings) -> Result<(), TrainingError> {
        // Before the first batch each simulation remembers one start, and maybe no more.
        let wanted = "at most `episodes.environments` without `replay.replacement`";
        let distinct = self.replacement || self.batch_rows <= episodes.environments;
        ask("replay.batch_rows", wanted, self.batch_rows, distinct)?;
        let wanted = "enough for `replay.n_steps` + 3 control steps of each simulation";
        let enough = self.capacity / episodes.environments >= self.n_steps.saturating_add(3);
        ask("replay.capacity", wanted, self.capacity, enough)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn updates_are_in_proportion_to_environment_steps_or_to_control_steps() {
        let replay = |updates_per_step, updates_count| ReplaySettings {
            n_steps: 1,
            warmup_steps: 20,
            updates_per_step,
            updates_count,
            ..ReplaySettings::default()
        };
        let due = |replay: &ReplaySettings| [2, 3, 12].map(|steps| replay.updates_due(steps, 10));
        // 120 environment steps less 20, a quarter of them.
        assert_eq!(due(&replay(0.25, UpdateCount::EnvironmentSteps)), [0, 2, 25]);
        // 12 control steps less 2.
        assert_eq!(due(&replay(1.0, UpdateCount::ControlSteps)), [0, 1, 10]);
    }

    #[test]
    fn a_batch_without_repetition_is_refused_where_there_may_be_too_few_steps() {
        let replay = ReplaySettings { replacement: false, batch_rows: 65, ..ReplaySettings::default() };
        let told = |environments| {
            let episodes = EpisodeSettings { environments, ..EpisodeSettings::default() };
            replay.check_sizes(&episodes).map_err(|refusal| refusal.to_string())
        };
        assert_eq!(told(65), Ok(()));
        let wanted = "the setting `replay.batch_rows` must be at most `episodes.environments` without `replay.replacement`";
        assert_eq!(told(64), Err(format!("{wanted}, found 65")));
    }
}
