//! Settings that off-policy algorithms share.

use mishandle_network::Activation;
use serde::{Deserialize, Serialize};

use crate::settings::{activation_name, ask, at_least_1, layer_sizes, not_negative, positive, share};
use crate::{EpisodeSettings, Initialization, TrainingError};

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
    /// Whether a control step may come more than once in a batch. Default true.
    pub replacement: bool,
    /// Environment steps with uniformly random actions, before anything is learned. Default 10,000.
    pub warmup_steps: u64,
    /// Updates for each step after that. Default 1/32: four for each control step of 128 simulations.
    pub updates_per_step: f64,
    /// Whose steps `updates_per_step` counts: `environment-steps`, each simulation's, or `control-steps`, those that all
    /// simulations make at once. Default `environment-steps`.
    pub updates_count: UpdateCount,
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
    /// What the network begins with: `"orthogonal"`, `"uniform"` or `{ normal = σ }`. Default `"orthogonal"`.
    pub initialization: Initialization,
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
    /// What the networks begin with: `"orthogonal"`, `"uniform"` or `{ normal = σ }`. Default `"orthogonal"`.
    pub initialization: Initialization,
}

/// What updates are in proportion to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum UpdateCount {
    /// Control steps times simulations.
    #[default]
    EnvironmentSteps,
    /// Control steps, however many simulations make them at once.
    ControlSteps,
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

    pub(crate) fn check(&self) -> Result<(), TrainingError> {
        at_least_1("exploration_decay.steps", self.steps)?;
        share("exploration_decay.share", self.share)
    }
}

impl Default for ReplaySettings {
    fn default() -> ReplaySettings {
        ReplaySettings {
            capacity: 1_000_000,
            n_steps: 3,
            batch_rows: 256,
            replacement: true,
            warmup_steps: 10_000,
            updates_per_step: 1.0 / 32.0,
            updates_count: UpdateCount::default(),
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
            initialization: Initialization::Orthogonal,
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
            initialization: Initialization::Orthogonal,
        }
    }
}

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

    pub(crate) fn check(&self, episodes: &EpisodeSettings) -> Result<(), TrainingError> {
        at_least_1("n_steps", self.n_steps as u64)?;
        at_least_1("batch_rows", self.batch_rows as u64)?;
        not_negative("updates_per_step", self.updates_per_step)?;
        positive("reward_scale", self.reward_scale)?;
        // Before the first batch each simulation remembers one start, and maybe no more.
        let wanted = "at most `episodes.environments` without `replacement`";
        let distinct = self.replacement || self.batch_rows <= episodes.environments;
        ask("replay.batch_rows", wanted, self.batch_rows, distinct)?;
        let wanted = "enough for `n_steps` + 3 control steps of each simulation";
        let enough = self.capacity / episodes.environments > self.first_steps();
        ask("replay.capacity", wanted, self.capacity, enough)
    }
}

impl ActorSettings {
    pub(crate) fn check(&self) -> Result<(), TrainingError> {
        layer_sizes("policy.hidden", &self.hidden)?;
        self.initialization.check("policy.initialization.normal")?;
        positive("policy.learning_rate", self.learning_rate)
    }
}

impl ActionValueSettings {
    pub(crate) fn check(&self) -> Result<(), TrainingError> {
        layer_sizes("critic.hidden", &self.hidden)?;
        self.initialization.check("critic.initialization.normal")?;
        positive("critic.learning_rate", self.learning_rate)
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
            replay.check(&episodes).map_err(|refusal| refusal.to_string())
        };
        assert_eq!(told(65), Ok(()));
        let wanted =
            "the setting `replay.batch_rows` must be at most `episodes.environments` without `replacement`";
        assert_eq!(told(64), Err(format!("{wanted}, found 65")));
    }
}
