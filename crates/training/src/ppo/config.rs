use serde::{Deserialize, Serialize};

use crate::minibatches::check_slices;
use crate::presets::SKRL_0_10;
use crate::settings::{ask, at_least_1, number, positive, share};
use crate::{
    CriticSettings, Division, EpisodeSettings, PolicySettings, RunSettings, Settings, TrainingError,
};

/// Settings of PPO. As TOML, each is a key of its name, the last four are tables; see [`Settings`] for keys left out.
///
/// # Example
/// ```
/// use mishandle_training::{Settings, ppo::PpoConfig};
/// let config = PpoConfig::from_toml("gamma = 0.97\npolicy.hidden = [128, 64]")?;
/// assert_eq!((config.gamma, config.epochs), (0.97, 5));
/// assert_eq!(PpoConfig::from_toml(&config.to_toml())?, config);
/// # Ok::<(), mishandle_training::TrainingError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PpoConfig {
    /// Control steps of each simulation between two updates. Default 32.
    pub rollout_steps: usize,
    /// Passes over each rollout. Default 5.
    pub epochs: usize,
    /// How a rollout is divided into minibatches: `shuffled` or `slices`; see [`Division`]. Default `shuffled`.
    pub minibatches: Division,
    /// Rows of a shuffled minibatch; the last of an epoch has what is left. Default 4096.
    pub minibatch_rows: usize,
    /// Number of slices, each of rows of the rollout / `slices`, rounded down. Default 2.
    pub slices: usize,
    /// γ, the discount of a control step. Default 0.99.
    pub gamma: f64,
    /// λ of generalised advantage estimation. Default 0.95.
    pub gae_lambda: f64,
    /// What advantages are standardised over: each `minibatch`, or the whole `rollout`. Default `minibatch`.
    pub advantages: Standardized,
    /// ε, how far a ratio may leave 1 with profit. Default 0.2.
    pub clip_epsilon: f64,
    /// How far the critic's output may leave what it was when the rollout was made: in the loss it is held there, and
    /// nothing is learned from beyond. In units of the critic's scale; without limit if left out.
    pub value_clip: Option<f64>,
    /// Weight of the policy's entropy. Default 0.
    pub entropy_coef: f64,
    /// What the entropy is over the actions: their `sum`, or their `mean`. Default `sum`.
    pub entropy: Reduction,
    /// Largest norm of a gradient. Default 1.
    pub max_grad_norm: f64,
    /// What this limits: the gradients of policy and critic each (`separate`), or both as one (`joint`). Default
    /// `separate`.
    pub grad_norm: GradNorm,
    /// Step length of the policy's optimiser, at the start. Default 0.001.
    pub learning_rate: f64,
    /// Whether the critic's optimiser always has this step length, too, instead of its own. Default false.
    pub shared_learning_rate: bool,
    /// How it changes: `constant`, `linear` (to 0 at the end, the critic's too), or `adaptive`. Default `adaptive`.
    pub learning_rate_schedule: Schedule,
    /// Divergence that the adaptive schedule steers to: after an epoch with more than twice as much the step length is
    /// divided by 1.5, with less than half as much multiplied. Default 0.01.
    pub target_kl: f64,
    /// Smallest and largest step length of the adaptive schedule. Default `[1e-5, 1e-2]`.
    pub learning_rate_range: [f64; 2],
    /// Divergence of a minibatch that ends the epoch before it is learned from; never if left out.
    pub kl_threshold: Option<f64>,
    /// How long, and when to look.
    pub run: RunSettings,
    /// The simulations.
    pub episodes: EpisodeSettings,
    /// The policy.
    pub policy: PolicySettings,
    /// The critic.
    pub critic: CriticSettings,
}

/// Over which rows advantages are brought to mean 0 and deviation 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Standardized {
    /// Those of each minibatch.
    Minibatch,
    /// Those of the whole rollout.
    Rollout,
}

/// What becomes of numbers that there are one of for each action.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Reduction {
    /// Their sum.
    Sum,
    /// Their mean.
    Mean,
}

/// Which gradients a largest norm limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum GradNorm {
    /// Those of policy and critic each.
    Separate,
    /// Both as one.
    Joint,
}

/// How the step length of the policy's optimiser changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Schedule {
    /// Not at all.
    Constant,
    /// It falls evenly, to 0 at the end.
    Linear,
    /// It is steered by the divergence of the new policy from the old one.
    Adaptive,
}

impl Default for PpoConfig {
    fn default() -> PpoConfig {
        PpoConfig {
            rollout_steps: 32,
            epochs: 5,
            minibatches: Division::Shuffled,
            minibatch_rows: 4096,
            slices: 2,
            gamma: 0.99,
            gae_lambda: 0.95,
            advantages: Standardized::Minibatch,
            clip_epsilon: 0.2,
            value_clip: None,
            entropy_coef: 0.0,
            entropy: Reduction::Sum,
            max_grad_norm: 1.0,
            grad_norm: GradNorm::Separate,
            learning_rate: 1e-3,
            shared_learning_rate: false,
            learning_rate_schedule: Schedule::Adaptive,
            target_kl: 0.01,
            learning_rate_range: [1e-5, 1e-2],
            kl_threshold: None,
            run: RunSettings::default(),
            episodes: EpisodeSettings::default(),
            policy: PolicySettings::default(),
            critic: CriticSettings::default(),
        }
    }
}

impl Settings for PpoConfig {
    const ALGORITHM: &'static str = "ppo";

    const PRESETS: &'static [(&'static str, &'static str)] = &[(SKRL_0_10, include_str!("skrl-0.10.toml"))];

    fn check(&self) -> Result<(), TrainingError> {
        at_least_1("rollout_steps", self.rollout_steps as u64)?;
        at_least_1("epochs", self.epochs as u64)?;
        ask("minibatch_rows", "at least 2", self.minibatch_rows, self.minibatch_rows >= 2)?;
        share("gamma", self.gamma)?;
        share("gae_lambda", self.gae_lambda)?;
        positive("clip_epsilon", self.clip_epsilon)?;
        positive("value_clip", self.value_clip.unwrap_or(1.0))?;
        number("entropy_coef", self.entropy_coef)?;
        positive("max_grad_norm", self.max_grad_norm)?;
        positive("learning_rate", self.learning_rate)?;
        positive("target_kl", self.target_kl)?;
        let [low, high] = self.learning_rate_range;
        let two = "two finite numbers, above 0 and not falling";
        let found = format!("{:?}", self.learning_rate_range);
        ask("learning_rate_range", two, found, 0.0 < low && low <= high && high.is_finite())?;
        positive("kl_threshold", self.kl_threshold.unwrap_or(1.0))?;
        self.run.check()?;
        self.episodes.check()?;
        check_slices(self.rollout_steps * self.episodes.environments, self.slices)?;
        self.policy.check()?;
        self.critic.check()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check_refusal(text: &str, told: &str) {
        let refusal = PpoConfig::from_toml(text).unwrap_err().to_string();
        assert!(refusal.contains(told) && !refusal.contains('\n'), "{refusal}");
    }

    #[test]
    fn what_has_no_default_comes_back_from_its_text() {
        let mut config = PpoConfig::default();
        config.run.stop_success = Some(0.99);
        config.episodes.time_limit = Some(150);
        assert_eq!(PpoConfig::from_toml(&config.to_toml()).unwrap(), config);
    }

    #[test]
    fn unknown_keys_and_wrong_values_are_refused() {
        check_refusal("gamma = 0.9\nlamda = 0.9", "line 2: unknown field `lamda`, expected one of");
        check_refusal("[run]\nsteps = 9", "line 2: unknown field `steps`, expected one of");
        check_refusal("epochs = -1", "line 1: ");
        check_refusal("policy.activation = \"swish\"", "activation `swish` is not known");
        check_refusal("learning_rate_schedule = \"cosine\"", "unknown variant `cosine`");
        check_refusal("gamma = nan", "the setting `gamma` must be a number from 0 to 1, found NaN");
        check_refusal("learning_rate = 0.0", "the setting `learning_rate` must be a number above 0, found 0");
        check_refusal(
            "policy.initial_log_std = 3.0",
            "must be a number from `min_log_std` to `max_log_std`, found 3",
        );
        check_refusal("episodes.environments = 0", "the setting `environments` must be at least 1, found 0");
    }
}
