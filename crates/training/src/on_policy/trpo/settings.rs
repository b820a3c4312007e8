use super::Trpo;
use crate::algorithm::Algorithm;
use crate::on_policy::OnPolicy;
use crate::on_policy::settings::on_policy_settings;
use crate::settings::bases::SKRL_0_10;
use crate::settings::declare::{choice, settings};
use crate::settings::setting::{ARRAY_SIZE, AT_LEAST_1, AT_LEAST_2, FRACTION, NOT_NEGATIVE, POSITIVE};
use crate::{
    CriticSettings, EpisodeSettings, MinibatchScheme, PolicySettings, RewardSettings, RunSettings,
    ScenarioSettings, Setting, TomlSettings, TrainingError,
};

settings! {
    /// Settings of TRPO. In TOML, each field is a key and the last six are tables;
    /// [`TomlSettings`] describes missing keys.
    ///
    /// # Example
    /// ```
    /// use mishandle_training::{TomlSettings, trpo::TrpoSettings};
    /// let settings = TrpoSettings::from_toml("max_kl = 0.02\npolicy.hidden = [128, 64]")?;
    /// assert_eq!((settings.max_kl, settings.cg_iterations), (0.02, 10));
    /// assert_eq!(TrpoSettings::from_toml(&settings.to_toml())?, settings);
    /// # Ok::<(), mishandle_training::TrainingError>(())
    /// ```
    pub struct TrpoSettings in "" {
        /// Control steps per environment in a rollout.
        pub rollout_steps: usize = 32, ARRAY_SIZE;
        /// Discount factor γ per control step.
        pub gamma: f64 = 0.99, FRACTION;
        /// λ of generalized advantage estimation.
        pub gae_lambda: f64 = 0.95, FRACTION;
        /// Trust region δ: maximum mean KL divergence of the new policy from the old one.
        pub max_kl: f64 = 0.01, POSITIVE;
        /// Damping of conjugate gradients: added to the diagonal of the Fisher information matrix.
        pub cg_damping: f64 = 0.1, NOT_NEGATIVE;
        /// Maximum number of conjugate gradient iterations.
        pub cg_iterations: usize = 10, AT_LEAST_1;
        /// Squared residual norm that ends the conjugate gradient iterations.
        pub cg_tolerance: f64 = 1e-10, NOT_NEGATIVE;
        /// Subsampling factor n of the Fisher information matrix: it uses every n-th row of the
        /// rollout.
        pub fisher_subsampling: usize = 1, AT_LEAST_1;
        /// Maximum number of line search steps; each step is half as long as the previous one.
        pub line_search_steps: usize = 10, AT_LEAST_1;
        /// Minimum ratio of actual to expected improvement that the line search accepts.
        pub accept_ratio: f64 = 0.5, FRACTION;
        /// KL divergence that the line search compares with `max_kl`.
        pub line_search_kl: LineSearchKl = LineSearchKl::Exact;
        /// Expected improvement of a shortened step.
        pub expected_improvement: ExpectedImprovement = ExpectedImprovement::Proportional;
        /// Number of epochs of the critic over each rollout.
        pub epochs: usize = 5, AT_LEAST_1;
        /// Division of a rollout into the critic's minibatches.
        pub minibatches: MinibatchScheme = MinibatchScheme::Shuffled;
        /// Number of rows of a shuffled minibatch; the last one of an epoch contains the remaining
        /// rows.
        pub minibatch_size: usize = 4096, AT_LEAST_2;
        /// Number of slices, at most half the number of rows of a rollout. Each slice has (rows /
        /// `minibatch_count`) rows, rounded down.
        pub minibatch_count: usize = 2, AT_LEAST_1;
        /// Maximum norm of the critic's gradient.
        pub max_grad_norm: f64 = 1.0, POSITIVE;
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
    /// KL divergence that the line search compares with `max_kl`.
    pub enum LineSearchKl {
        /// KL(π_old ‖ π) = Σ log(σ / σ_old) + (σ_old² + (μ_old - μ)²) / (2 σ²) - ½.
        Exact = "exact",
        /// The formula of skrl 0.10.2, with log(σ_old / σ) instead of log(σ / σ_old). It is
        /// negative for steps that increase σ, which may then leave the trust region, and it
        /// shortens steps that decrease σ.
        Flipped = "flipped",
    }
}

choice! {
    /// Expected improvement of a shortened step.
    pub enum ExpectedImprovement {
        /// Proportional to the step size.
        Proportional = "proportional",
        /// The formula of skrl 0.10.2: the improvement of the full step times the product of all
        /// fractions tried so far (½, ⅛, 1/64 …), so that the condition becomes weaker with each
        /// step.
        Compounded = "compounded",
    }
}

impl TomlSettings for TrpoSettings {
    const ALGORITHM: &'static str = "trpo";

    const BASES: &'static [(&'static str, &'static str)] = &[(SKRL_0_10, include_str!("skrl-0.10.toml"))];

    fn settings() -> Vec<Setting> {
        Self::described()
    }

    fn check(&self) -> Result<(), TrainingError> {
        self.check_constraints()?;
        on_policy_settings!(self).check()
    }
}

impl Algorithm for TrpoSettings {
    const SUMMARY: &'static str =
        "trust region policy optimization: on-policy, natural gradient steps within a KL bound";

    type Learner = OnPolicy<Trpo>;

    fn run_mut(&mut self) -> &mut RunSettings {
        &mut self.run
    }

    fn scenarios_mut(&mut self) -> &mut ScenarioSettings {
        &mut self.scenarios
    }
}
