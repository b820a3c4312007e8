use std::fmt::Display;

use mishandle_network::Activation;
use serde::{Deserialize, Serialize};

use crate::TrainingError;

/// Settings of PPO. As TOML, each is a key of its name; a key that is left out has its default, one that is not known
/// is an error.
///
/// # Example
/// ```
/// use mishandle_training::ppo::PpoConfig;
/// let config = PpoConfig::from_toml("gamma = 0.97\npolicy_hidden = [128, 64]")?;
/// assert_eq!((config.gamma, config.epochs), (0.97, 5));
/// assert_eq!(PpoConfig::from_toml(&config.to_toml())?, config);
/// # Ok::<(), mishandle_training::TrainingError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PpoConfig {
    /// Simulations that run side by side. Default 512.
    pub environments: usize,
    /// Control steps of each between two updates. Default 32.
    pub rollout_steps: usize,
    /// Environment steps (control steps times simulations) of the whole training. Default 20,000,000.
    pub total_steps: u64,
    /// Control steps after which the clock ends a training episode; default the environment's.
    pub episode_steps: Option<usize>,
    /// Whether first episodes have only a random part of their time, so that the simulations are not in step.
    /// Default true.
    pub staggered: bool,
    /// Standard deviation of noise on each clipped action while training. Default 0.
    pub action_noise: f64,

    /// Passes over each rollout. Default 5.
    pub epochs: usize,
    /// Rows of a minibatch; the last of an epoch has what is left. Default 4096.
    pub minibatch_rows: usize,
    /// γ, the discount of a control step. Default 0.99.
    pub gamma: f64,
    /// λ of generalised advantage estimation. Default 0.95.
    pub gae_lambda: f64,
    /// ε, how far a ratio may leave 1 with profit. Default 0.2.
    pub clip_epsilon: f64,
    /// Weight of the policy's entropy. Default 0.
    pub entropy_coef: f64,
    /// Largest norm of a gradient, of policy and critic each. Default 1.
    pub max_grad_norm: f64,

    /// Step length of the policy's optimiser, at the start. Default 0.001.
    pub learning_rate: f64,
    /// How it changes: `constant`, `linear` (to 0 at the end), or `adaptive`. Default `adaptive`.
    pub learning_rate_schedule: Schedule,
    /// Divergence that the adaptive schedule steers to: after an epoch with more than twice as much the step length is
    /// divided by 1.5, with less than half as much multiplied, within [1e-5, 1e-2]. Default 0.01.
    pub target_kl: f64,
    /// Step length of the critic's optimiser; falls to 0 too if the schedule is `linear`. Default 0.001.
    pub value_learning_rate: f64,

    /// Outputs of the policy's hidden layers. Default `[64, 64]`.
    pub policy_hidden: Vec<usize>,
    /// Outputs of the critic's hidden layers. Default `[64, 64]`.
    pub value_hidden: Vec<usize>,
    /// Activation of hidden layers: `elu`, `tanh` or `relu`. Default `elu`.
    #[serde(with = "activation_name")]
    pub activation: Activation,
    /// log σ of each action at the start. Default -0.5.
    pub initial_log_std: f64,
    /// Smallest log σ. Default -3.
    pub min_log_std: f64,
    /// Largest log σ. Default 0.5.
    pub max_log_std: f64,
    /// Whether observations are scaled by running moments. Default true.
    pub normalize_observations: bool,
    /// Whether the critic learns on the scale of the returns. Default true.
    pub normalize_values: bool,

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
            environments: 512,
            rollout_steps: 32,
            total_steps: 20_000_000,
            episode_steps: None,
            staggered: true,
            action_noise: 0.0,
            epochs: 5,
            minibatch_rows: 4096,
            gamma: 0.99,
            gae_lambda: 0.95,
            clip_epsilon: 0.2,
            entropy_coef: 0.0,
            max_grad_norm: 1.0,
            learning_rate: 1e-3,
            learning_rate_schedule: Schedule::Adaptive,
            target_kl: 0.01,
            value_learning_rate: 1e-3,
            policy_hidden: vec![64, 64],
            value_hidden: vec![64, 64],
            activation: Activation::Elu,
            initial_log_std: -0.5,
            min_log_std: -3.0,
            max_log_std: 0.5,
            normalize_observations: true,
            normalize_values: true,
            validation_every: 20,
            validation_episodes: 200,
            stop_success: None,
            stop_strict: None,
            stop_validations: 3,
            checkpoint_every: 50,
        }
    }
}

impl PpoConfig {
    /// The settings that a TOML text states.
    ///
    /// # Errors
    /// If it is not TOML, a key is not known, or a value is of another type or out of its range.
    pub fn from_toml(text: &str) -> Result<PpoConfig, TrainingError> {
        let config: PpoConfig = toml::from_str(text).map_err(|error| {
            let start = error.span().map_or(0, |span| span.start).min(text.len());
            let line = 1 + text.as_bytes()[..start].iter().filter(|byte| **byte == b'\n').count();
            TrainingError::Settings { line, message: error.message().replace('\n', ", ") }
        })?;
        config.check()?;
        Ok(config)
    }

    /// The settings as TOML, every key with its value; what has none is left out.
    ///
    /// # Panics
    /// Never: the settings are plain data.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("the settings are numbers, names and lists of numbers")
    }

    /// Checks that every setting is in its range.
    ///
    /// # Errors
    /// If one is not; the message says what it must be.
    pub fn check(&self) -> Result<(), TrainingError> {
        let at_least_1 = "at least 1";
        let positive = "a number above 0";
        let not_negative = "a number of at least 0";
        let share = "a number from 0 to 1";
        let number = "a finite number";
        let is_positive = |x: f64| x > 0.0 && x.is_finite();
        let is_share = |x: f64| (0.0..=1.0).contains(&x);
        let is_rate = |x: Option<f64>| x.is_none_or(is_share);
        let rate = |x: Option<f64>| x.map_or(String::new(), |x| x.to_string());
        ask("environments", at_least_1, self.environments, self.environments >= 1)?;
        ask("rollout_steps", at_least_1, self.rollout_steps, self.rollout_steps >= 1)?;
        ask("total_steps", at_least_1, self.total_steps, self.total_steps >= 1)?;
        let episode_steps = self.episode_steps.unwrap_or(1);
        ask("episode_steps", at_least_1, episode_steps, episode_steps >= 1)?;
        let noise = self.action_noise;
        ask("action_noise", not_negative, noise, noise >= 0.0 && noise.is_finite())?;
        ask("epochs", at_least_1, self.epochs, self.epochs >= 1)?;
        ask("minibatch_rows", "at least 2", self.minibatch_rows, self.minibatch_rows >= 2)?;
        ask("gamma", share, self.gamma, is_share(self.gamma))?;
        ask("gae_lambda", share, self.gae_lambda, is_share(self.gae_lambda))?;
        ask("clip_epsilon", positive, self.clip_epsilon, is_positive(self.clip_epsilon))?;
        let entropy_coef = self.entropy_coef;
        ask("entropy_coef", number, entropy_coef, entropy_coef.is_finite())?;
        ask("max_grad_norm", positive, self.max_grad_norm, is_positive(self.max_grad_norm))?;
        ask("learning_rate", positive, self.learning_rate, is_positive(self.learning_rate))?;
        ask("target_kl", positive, self.target_kl, is_positive(self.target_kl))?;
        let value_learning_rate = self.value_learning_rate;
        ask("value_learning_rate", positive, value_learning_rate, is_positive(value_learning_rate))?;
        let sizes = |name, hidden: &[usize]| {
            ask(name, "sizes of at least 1", format!("{hidden:?}"), !hidden.contains(&0))
        };
        sizes("policy_hidden", &self.policy_hidden)?;
        sizes("value_hidden", &self.value_hidden)?;
        let (low, start, high) = (self.min_log_std, self.initial_log_std, self.max_log_std);
        ask("min_log_std", number, low, low.is_finite())?;
        ask(
            "max_log_std",
            "a finite number of at least `min_log_std`",
            high,
            low <= high && high.is_finite(),
        )?;
        let inside = "a number from `min_log_std` to `max_log_std`";
        ask("initial_log_std", inside, start, (low..=high).contains(&start))?;
        ask("validation_every", at_least_1, self.validation_every, self.validation_every >= 1)?;
        ask("validation_episodes", at_least_1, self.validation_episodes, self.validation_episodes >= 1)?;
        ask("stop_success", share, rate(self.stop_success), is_rate(self.stop_success))?;
        ask("stop_strict", share, rate(self.stop_strict), is_rate(self.stop_strict))?;
        ask("stop_validations", at_least_1, self.stop_validations, self.stop_validations >= 1)?;
        ask("checkpoint_every", at_least_1, self.checkpoint_every, self.checkpoint_every >= 1)
    }

    /// Environment steps of one iteration.
    pub fn iteration_steps(&self) -> u64 {
        self.environments as u64 * self.rollout_steps as u64
    }

    /// Iterations of the whole training: enough for all its steps.
    pub fn iterations(&self) -> u64 {
        self.total_steps.div_ceil(self.iteration_steps())
    }
}

fn ask(
    name: &'static str,
    wanted: &'static str,
    found: impl Display,
    right: bool,
) -> Result<(), TrainingError> {
    if right { Ok(()) } else { Err(TrainingError::Setting { name, wanted, found: found.to_string() }) }
}

/// An activation as its name.
mod activation_name {
    use mishandle_network::Activation;
    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    pub fn serialize<S: Serializer>(activation: &Activation, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(activation)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Activation, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(D::Error::custom)
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
    fn the_defaults_come_back_from_their_text() {
        let config = PpoConfig { stop_success: Some(0.99), episode_steps: Some(150), ..PpoConfig::default() };
        assert_eq!(PpoConfig::from_toml(&config.to_toml()).unwrap(), config);
        assert_eq!(PpoConfig::from_toml("").unwrap(), PpoConfig::default());
    }

    #[test]
    fn unknown_keys_and_wrong_values_are_refused() {
        check_refusal("gamma = 0.9\nlamda = 0.9", "line 2: unknown field `lamda`, expected one of");
        check_refusal("epochs = -1", "line 1: ");
        check_refusal("activation = \"swish\"", "activation `swish` is not known");
        check_refusal("learning_rate_schedule = \"cosine\"", "unknown variant `cosine`");
        check_refusal("gamma = nan", "the setting `gamma` must be a number from 0 to 1, found NaN");
        check_refusal("learning_rate = 0.0", "the setting `learning_rate` must be a number above 0, found 0");
        check_refusal(
            "initial_log_std = 3.0",
            "must be a number from `min_log_std` to `max_log_std`, found 3",
        );
        check_refusal("environments = 0", "the setting `environments` must be at least 1, found 0");
    }

    #[test]
    fn the_last_iteration_may_go_over() {
        let config = PpoConfig { environments: 8, rollout_steps: 4, total_steps: 65, ..PpoConfig::default() };
        assert_eq!(config.iterations(), 3);
    }
}
