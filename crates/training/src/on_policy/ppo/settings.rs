use super::Ppo;
use crate::algorithm::Algorithm;
use crate::on_policy::OnPolicy;
use crate::on_policy::settings::on_policy_settings;
use crate::settings::bases::SKRL_0_10;
use crate::settings::declare::{choice, settings};
use crate::settings::setting::{
    ARRAY_SIZE, AT_LEAST_1, AT_LEAST_2, FINITE, FRACTION, POSITIVE, POSITIVE_RANGE, require,
};
use crate::{
    CriticSettings, EpisodeSettings, MinibatchScheme, PolicySettings, RewardSettings, RunSettings,
    ScenarioSettings, Setting, TomlSettings, TrainingError,
};

settings! {
    /// Settings of PPO. In TOML, each field is a key and the last six are tables; [`TomlSettings`]
    /// describes missing keys.
    ///
    /// # Example
    /// ```
    /// use mishandle_training::{TomlSettings, ppo::PpoSettings};
    /// let settings = PpoSettings::from_toml("gamma = 0.97\npolicy.hidden = [128, 64]")?;
    /// assert_eq!((settings.gamma, settings.epochs), (0.97, 5));
    /// assert_eq!(PpoSettings::from_toml(&settings.to_toml())?, settings);
    /// # Ok::<(), mishandle_training::TrainingError>(())
    /// ```
    pub struct PpoSettings in "" {
        /// Control steps per environment in a rollout.
        pub rollout_steps: usize = 32, ARRAY_SIZE;
        /// Number of epochs over each rollout.
        pub epochs: usize = 5, AT_LEAST_1;
        /// Division of a rollout into minibatches.
        pub minibatches: MinibatchScheme = MinibatchScheme::Shuffled;
        /// Number of rows of a shuffled minibatch; the last one of an epoch contains the remaining
        /// rows.
        pub minibatch_size: usize = 4096, AT_LEAST_2;
        /// Number of slices, at most half the number of rows of a rollout. Each slice has (rows /
        /// `minibatch_count`) rows, rounded down.
        pub minibatch_count: usize = 2, AT_LEAST_1;
        /// Discount factor γ per control step.
        pub gamma: f64 = 0.99, FRACTION;
        /// λ of generalized advantage estimation.
        pub gae_lambda: f64 = 0.95, FRACTION;
        /// Rows over which advantages are normalized to mean 0 and standard deviation 1.
        pub advantage_normalization: AdvantageNormalization = AdvantageNormalization::Minibatch;
        /// PPO clip range ε.
        pub clip_epsilon: f64 = 0.2, POSITIVE;
        /// Clip range of the value loss: the critic's output is clipped to this distance from its
        /// output at the time of the rollout, and beyond it the gradient is 0. In units of the
        /// normalized values; no clipping if not set.
        pub value_clip: Option<f64> = None, POSITIVE;
        /// Coefficient of the entropy bonus.
        pub entropy_coef: f64 = 0.0, FINITE;
        /// Reduction of the entropy over action dimensions.
        pub entropy_reduction: EntropyReduction = EntropyReduction::Sum;
        /// Maximum gradient norm.
        pub max_grad_norm: f64 = 1.0, POSITIVE;
        /// Gradients that are clipped together.
        pub grad_clipping: GradientClipping = GradientClipping::Separate;
        /// Initial learning rate of the policy; with the adaptive schedule within
        /// `learning_rate_range`.
        pub learning_rate: f64 = 1e-3, POSITIVE;
        /// Whether the critic uses the policy's learning rate instead of its own.
        pub shared_learning_rate: bool = false;
        /// Learning rate schedule.
        pub learning_rate_schedule: LearningRateSchedule = LearningRateSchedule::Adaptive;
        /// Target KL divergence of the adaptive schedule. The learning rate is divided by 1.5 after
        /// an epoch with a KL divergence above twice the target, and multiplied by 1.5 below half
        /// the target.
        pub target_kl: f64 = 0.01, POSITIVE;
        /// Smallest and largest learning rate of the adaptive schedule.
        pub learning_rate_range: [f64; 2] = [1e-5, 1e-2], POSITIVE_RANGE;
        /// KL divergence of a minibatch that ends the epoch before its gradient step; no such limit
        /// if not set.
        pub kl_threshold: Option<f64> = None, POSITIVE;
    } tables {
        /// Length of the training run, validation, checkpoints.
        pub run: RunSettings = RunSettings::default();
        /// The parallel environments.
        pub episodes: EpisodeSettings = EpisodeSettings::default();
        /// The scenarios of the episodes.
        pub scenarios: ScenarioSettings = ScenarioSettings::default();
        /// Reward terms for the manner.
        pub rewards: RewardSettings = RewardSettings::default();
        /// The policy.
        pub policy: PolicySettings = PolicySettings::default();
        /// The critic.
        pub critic: CriticSettings = CriticSettings::default();
    }
}

choice! {
    /// Rows over which advantages are normalized.
    pub enum AdvantageNormalization {
        /// The rows of each minibatch.
        Minibatch = "minibatch",
        /// All rows of the rollout.
        Rollout = "rollout",
    }
}

choice! {
    /// Reduction over action dimensions.
    pub enum EntropyReduction {
        /// Sum.
        Sum = "sum",
        /// Mean.
        Mean = "mean",
    }
}

choice! {
    /// Gradients that are clipped together.
    pub enum GradientClipping {
        /// Policy and critic separately.
        Separate = "separate",
        /// Policy and critic as one vector.
        Joint = "joint",
    }
}

choice! {
    /// Schedule of the policy's learning rate.
    pub enum LearningRateSchedule {
        /// Constant learning rate.
        Constant = "constant",
        /// Linear annealing to 0 at the end, also of the critic's learning rate.
        Linear = "linear",
        /// Adaptation to the KL divergence of the new policy from the old one.
        Adaptive = "adaptive",
    }
}

impl TomlSettings for PpoSettings {
    const ALGORITHM: &'static str = "ppo";

    const BASES: &'static [(&'static str, &'static str)] = &[(SKRL_0_10, include_str!("skrl-0.10.toml"))];

    fn settings() -> Vec<Setting> {
        Self::described()
    }

    fn check(&self) -> Result<(), TrainingError> {
        self.check_constraints()?;
        if self.learning_rate_schedule == LearningRateSchedule::Adaptive {
            let [low, high] = self.learning_rate_range;
            let initial = self.learning_rate;
            let expected = "a number within `learning_rate_range`, since the schedule is adaptive";
            require("learning_rate", expected, initial, (low..=high).contains(&initial))?;
        }
        on_policy_settings!(self).check()
    }

    fn depends_on_total_steps(&self) -> Option<&'static str> {
        let is_linear = self.learning_rate_schedule == LearningRateSchedule::Linear;
        is_linear.then_some("`learning_rate_schedule = \"linear\"` anneals the learning rate to 0 at the end")
    }
}

impl Algorithm for PpoSettings {
    const SUMMARY: &'static str = "proximal policy optimization: on-policy, a clipped surrogate objective";

    type Learner = OnPolicy<Ppo>;

    fn run_mut(&mut self) -> &mut RunSettings {
        &mut self.run
    }

    fn scenarios_mut(&mut self) -> &mut ScenarioSettings {
        &mut self.scenarios
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check_error(text: &str, expected: &str) {
        let error = PpoSettings::from_toml(text).unwrap_err().to_string();
        assert!(error.contains(expected) && !error.contains('\n'), "{error}");
    }

    #[test]
    fn settings_without_a_default_round_trip_through_toml() {
        let mut settings = PpoSettings::default();
        settings.run.stop_success = Some(0.99);
        settings.episodes.time_limit = Some(150);
        assert_eq!(PpoSettings::from_toml(&settings.to_toml()).unwrap(), settings);
    }

    #[test]
    fn errors_for_unknown_keys_name_table_and_line() {
        check_error(
            "gamma = 0.9\nlamda = 0.9",
            "line 2: ppo has no setting `lamda`; settings outside of tables: rollout_steps, ",
        );
        let expected =
            "line 2: ppo has no setting `run.steps`; settings of [run]: total_steps, from, critic_steps, ";
        check_error("[run]\nsteps = 9", expected);
        check_error("polices.hidden = [9]", "line 1: ppo has no setting `polices`");
        check_error("run = 3", "line 1: the setting `run` must be a table, as [run], found 3");
    }

    #[test]
    fn errors_for_wrong_values_name_the_allowed_values() {
        for (text, expected) in [
            ("epochs = -1", "line 1: the setting `epochs` must be a whole number from 1 to 10^12, found -1"),
            ("epochs = 9223372036854775808", "10^12, found 9223372036854775808"),
            (
                "epochs = 1e1",
                "line 1: the setting `epochs` must be a whole number from 1 to 10^12, found 1e1",
            ),
            ("\ngamma = \"a\"", "line 2: the setting `gamma` must be a number from 0 to 1, found \"a\""),
            ("gamma = nan", "line 1: the setting `gamma` must be a number from 0 to 1, found NaN"),
            (
                "policy.activation = \"swish\"",
                "`policy.activation` must be \"elu\", \"tanh\", \"relu\" or \"leaky_relu\", found",
            ),
            (
                "learning_rate_schedule = \"cosine\"",
                "`learning_rate_schedule` must be \"constant\", \"linear\" or \"adaptive\", found \"cosine\"",
            ),
            ("learning_rate = 0.0", "line 1: the setting `learning_rate` must be a number above 0, found 0"),
            (
                "learning_rate = 0.1",
                "line 1: the setting `learning_rate` must be a number within `learning_rate_range`, since",
            ),
            (
                "learning_rate_range = [0.1]",
                "`learning_rate_range` must be two numbers above 0 in ascending order",
            ),
            (
                "[policy]\ninitial_log_std = 3.0",
                "line 2: the setting `policy.initial_log_std` must be a number from `policy.min_log_std` to \
                 `policy.max_log_std`, found 3",
            ),
            ("policy.initialization = { normal = 0 }", "{ normal = σ } with σ above 0, found 0"),
            (
                "[critic]\nhidden = [8, 0]",
                "line 2: the setting `critic.hidden` must be a list of up to 100 whole numbers",
            ),
            (
                "episodes.environments = 0",
                "line 1: the setting `episodes.environments` must be a whole number from",
            ),
            ("run.stop_success = 1.1", "line 1: the setting `run.stop_success` must be a number from 0 to 1"),
            ("gamma = { a = 1 }", "`gamma` must be a number from 0 to 1, found a table of a"),
            ("gamma 0.9", "line 1: invalid TOML: "),
            ("gamma = 0.9\ngamma = 0.9", "line 2: invalid TOML: duplicate key"),
        ] {
            check_error(text, expected);
        }
        // A default that violates a constraint has no line.
        let error =
            PpoSettings::from_toml("minibatches = \"slices\"\nrollout_steps = 1\nepisodes.environments = 2")
                .unwrap_err();
        assert!(error.to_string().starts_with("the setting `minibatch_count` must be "), "{error}");
    }
}
