use super::Ppo;
use crate::algorithm::Algorithm;
use crate::declare::{choice, settings};
use crate::on_policy::OnPolicy;
use crate::on_policy_settings::setup_of;
use crate::presets::SKRL_0_10;
use crate::setting::{AT_LEAST_1, AT_LEAST_2, FINITE, POSITIVE, RISING, SHARE, ask};
use crate::{
    CriticSettings, Division, EpisodeSettings, PolicySettings, RunSettings, Setting, Settings, TrainingError,
};

settings! {
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
    pub struct PpoConfig in "" {
        /// Control steps of each simulation between two updates.
        pub rollout_steps: usize = 32, AT_LEAST_1;
        /// Passes over each rollout.
        pub epochs: usize = 5, AT_LEAST_1;
        /// How a rollout is divided into minibatches.
        pub minibatches: Division = Division::Shuffled;
        /// Rows of a shuffled minibatch; the last of an epoch has what is left.
        pub minibatch_rows: usize = 4096, AT_LEAST_2;
        /// Number of slices, at most half as many as rows of a rollout; each of rows of the rollout / `slices`, rounded down.
        pub slices: usize = 2, AT_LEAST_1;
        /// γ, the discount of a control step.
        pub gamma: f64 = 0.99, SHARE;
        /// λ of generalised advantage estimation.
        pub gae_lambda: f64 = 0.95, SHARE;
        /// Over which rows advantages are brought to mean 0 and deviation 1.
        pub advantages: Standardized = Standardized::Minibatch;
        /// ε, how far a ratio may leave 1 with profit.
        pub clip_epsilon: f64 = 0.2, POSITIVE;
        /// How far the critic's output may leave what it was when the rollout was made: in the loss it is held there, and
        /// nothing is learned from beyond. In units of the critic's scale; without limit if left out.
        pub value_clip: Option<f64> = None, POSITIVE;
        /// Weight of the policy's entropy.
        pub entropy_coef: f64 = 0.0, FINITE;
        /// What the entropy is over the numbers of an action.
        pub entropy: Reduction = Reduction::Sum;
        /// Largest norm of a gradient.
        pub max_grad_norm: f64 = 1.0, POSITIVE;
        /// Which gradients it limits.
        pub grad_norm: GradNorm = GradNorm::Separate;
        /// Step length of the policy's optimiser, at the start; in the adaptive schedule within `learning_rate_range`.
        pub learning_rate: f64 = 1e-3, POSITIVE;
        /// Whether the critic's optimiser always has the policy's step length instead of its own.
        pub shared_learning_rate: bool = false;
        /// How `learning_rate` changes.
        pub learning_rate_schedule: Schedule = Schedule::Adaptive;
        /// Divergence (KL) that the adaptive schedule steers to: after an epoch with more than twice as much the step length is
        /// divided by 1.5, with less than half as much multiplied.
        pub target_kl: f64 = 0.01, POSITIVE;
        /// Smallest and largest step length of the adaptive schedule.
        pub learning_rate_range: [f64; 2] = [1e-5, 1e-2], RISING;
        /// Divergence of a minibatch that ends the epoch before it is learned from; never if left out.
        pub kl_threshold: Option<f64> = None, POSITIVE;
    } tables {
        /// How long, and when to look.
        pub run: RunSettings = RunSettings::default();
        /// The simulations.
        pub episodes: EpisodeSettings = EpisodeSettings::default();
        /// The policy.
        pub policy: PolicySettings = PolicySettings::default();
        /// The critic.
        pub critic: CriticSettings = CriticSettings::default();
    }
}

choice! {
    /// Over which rows advantages are brought to mean 0 and deviation 1.
    pub enum Standardized {
        /// Those of each minibatch.
        Minibatch = "minibatch",
        /// Those of the whole rollout.
        Rollout = "rollout",
    }
}

choice! {
    /// What becomes of numbers that there are one of for each action.
    pub enum Reduction {
        /// Their sum.
        Sum = "sum",
        /// Their mean.
        Mean = "mean",
    }
}

choice! {
    /// Which gradients a largest norm limits.
    pub enum GradNorm {
        /// Those of policy and critic each.
        Separate = "separate",
        /// Both as one.
        Joint = "joint",
    }
}

choice! {
    /// How the step length of the policy's optimiser changes.
    pub enum Schedule {
        /// Not at all.
        Constant = "constant",
        /// It falls evenly, to 0 at the end, the critic's too.
        Linear = "linear",
        /// It is steered by the divergence of the new policy from the old one.
        Adaptive = "adaptive",
    }
}

impl Settings for PpoConfig {
    const ALGORITHM: &'static str = "ppo";

    const PRESETS: &'static [(&'static str, &'static str)] = &[(SKRL_0_10, include_str!("skrl-0.10.toml"))];

    fn settings() -> Vec<Setting> {
        Self::described()
    }

    fn check(&self) -> Result<(), TrainingError> {
        self.check_rules()?;
        if self.learning_rate_schedule == Schedule::Adaptive {
            let ([low, high], start) = (self.learning_rate_range, self.learning_rate);
            let inside = "a number within `learning_rate_range`, since the schedule is adaptive";
            ask("learning_rate", inside, start, (low..=high).contains(&start))?;
        }
        setup_of!(self).check()
    }

    fn hangs_on_total(&self) -> Option<&'static str> {
        let is_linear = self.learning_rate_schedule == Schedule::Linear;
        is_linear.then_some("`learning_rate_schedule = \"linear\"` takes the step length to 0 at the end")
    }
}

impl Algorithm for PpoConfig {
    const SUMMARY: &'static str = "proximal policy optimization: on-policy, a clipped surrogate objective";

    type Learner = OnPolicy<Ppo>;

    fn run_mut(&mut self) -> &mut RunSettings {
        &mut self.run
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
    fn unknown_keys_are_refused_by_their_table_and_line() {
        check_refusal(
            "gamma = 0.9\nlamda = 0.9",
            "line 2: ppo has no setting `lamda`; outside of tables there are",
        );
        let told = "line 2: ppo has no setting `run.steps`; [run] has: total_steps, validation_every, ";
        check_refusal("[run]\nsteps = 9", told);
        check_refusal("polices.hidden = [9]", "line 1: ppo has no setting `polices`");
        check_refusal("run = 3", "line 1: the setting `run` must be a table, as [run], found 3");
    }

    #[test]
    fn wrong_values_are_refused_with_what_is_allowed() {
        for (text, told) in [
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
                "`policy.activation` must be \"elu\", \"tanh\" or \"relu\", found",
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
            ("learning_rate_range = [0.1]", "`learning_rate_range` must be two finite numbers, above 0 and"),
            (
                "[policy]\ninitial_log_std = 3.0",
                "line 2: the setting `policy.initial_log_std` must be a number from `policy.min_log_std` to \
                 `policy.max_log_std`, found 3",
            ),
            ("policy.initialization = { normal = 0 }", "σ being a number above 0, found 0"),
            (
                "[critic]\nhidden = [8, 0]",
                "line 2: the setting `critic.hidden` must be a list of whole numbers",
            ),
            (
                "episodes.environments = 0",
                "line 1: the setting `episodes.environments` must be a whole number from",
            ),
            ("run.stop_success = 1.1", "line 1: the setting `run.stop_success` must be a number from 0 to 1"),
            ("gamma = { a = 1 }", "`gamma` must be a number from 0 to 1, found a table of a"),
            ("gamma 0.9", "line 1: this is not TOML: "),
            ("gamma = 0.9\ngamma = 0.9", "line 2: this is not TOML: duplicate key"),
        ] {
            check_refusal(text, told);
        }
        // What no line states is the default's, or the preset's.
        let refusal =
            PpoConfig::from_toml("minibatches = \"slices\"\nrollout_steps = 1\nepisodes.environments = 2")
                .unwrap_err();
        assert!(refusal.to_string().starts_with("the setting `slices` must be "), "{refusal}");
    }
}
