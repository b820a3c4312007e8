use super::Trpo;
use crate::algorithm::Algorithm;
use crate::declare::{choice, settings};
use crate::on_policy::OnPolicy;
use crate::on_policy_settings::setup_of;
use crate::presets::SKRL_0_10;
use crate::setting::{AT_LEAST_1, AT_LEAST_2, NOT_NEGATIVE, POSITIVE, SHARE};
use crate::{
    CriticSettings, Division, EpisodeSettings, PolicySettings, RunSettings, Setting, Settings, TrainingError,
};

settings! {
    /// Settings of TRPO. As TOML, each is a key of its name, the last four are tables; see [`Settings`] for keys left out.
    ///
    /// # Example
    /// ```
    /// use mishandle_training::{Settings, trpo::TrpoConfig};
    /// let config = TrpoConfig::from_toml("max_kl = 0.02\npolicy.hidden = [128, 64]")?;
    /// assert_eq!((config.max_kl, config.cg_iterations), (0.02, 10));
    /// assert_eq!(TrpoConfig::from_toml(&config.to_toml())?, config);
    /// # Ok::<(), mishandle_training::TrainingError>(())
    /// ```
    pub struct TrpoConfig in "" {
        /// Control steps of each simulation between two updates.
        pub rollout_steps: usize = 32, AT_LEAST_1;
        /// γ, the discount of a control step.
        pub gamma: f64 = 0.99, SHARE;
        /// λ of generalised advantage estimation.
        pub gae_lambda: f64 = 0.95, SHARE;
        /// δ, the largest mean divergence of the new policy from the old one.
        pub max_kl: f64 = 0.01, POSITIVE;
        /// What is added to the diagonal of the Fisher information.
        pub damping: f64 = 0.1, NOT_NEGATIVE;
        /// Largest number of iterations of conjugate gradients.
        pub cg_iterations: usize = 10, AT_LEAST_1;
        /// Squared residual at which they end.
        pub cg_tolerance: f64 = 1e-10, NOT_NEGATIVE;
        /// The Fisher information is taken over every row of the rollout that is a multiple of this; 1 for all of them.
        pub fisher_every: usize = 1, AT_LEAST_1;
        /// How many steps are tried, each half as long as the last.
        pub backtracks: usize = 10, AT_LEAST_1;
        /// Share of the improvement expected from the gradient that a step has to bring.
        pub accept_ratio: f64 = 0.5, SHARE;
        /// How the line search measures how far a step goes.
        pub distance: Distance = Distance::Exact;
        /// The improvement that the line search expects of a step that is shorter than the longest one.
        pub expected_improvement: Expected = Expected::Proportional;
        /// Passes of the critic over each rollout.
        pub epochs: usize = 5, AT_LEAST_1;
        /// How a rollout is divided into the critic's minibatches.
        pub minibatches: Division = Division::Shuffled;
        /// Rows of a shuffled minibatch; the last of an epoch has what is left.
        pub minibatch_rows: usize = 4096, AT_LEAST_2;
        /// Number of slices, at most half as many as rows of a rollout; each of rows of the rollout / `slices`, rounded down.
        pub slices: usize = 2, AT_LEAST_1;
        /// Largest norm of the critic's gradient.
        pub max_grad_norm: f64 = 1.0, POSITIVE;
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
    /// How the line search measures how far the new policy is from the old one.
    pub enum Distance {
        /// By the divergence KL(π_old ‖ π) = Σ log(σ / σ_old) + (σ_old² + (μ_old - μ)²) / (2 σ²) - ½.
        Exact = "exact",
        /// As skrl does: by the same, but with log(σ_old / σ). It is not a distance: it is below 0 for steps that widen the policy, which
        /// may then leave the trust region, and it shortens those that make it narrower.
        Flipped = "flipped",
    }
}

choice! {
    /// The improvement that the line search expects of a step that is shorter than the longest one.
    pub enum Expected {
        /// In proportion to its length.
        Proportional = "proportional",
        /// As in skrl: the longest one's, times all lengths tried so far as shares of the longest (½, ⅛, 1/64 …), so that a
        /// shorter step is accepted ever more easily.
        Compounded = "compounded",
    }
}

impl Settings for TrpoConfig {
    const ALGORITHM: &'static str = "trpo";

    const PRESETS: &'static [(&'static str, &'static str)] = &[(SKRL_0_10, include_str!("skrl-0.10.toml"))];

    fn settings() -> Vec<Setting> {
        Self::described()
    }

    fn check(&self) -> Result<(), TrainingError> {
        self.check_rules()?;
        setup_of!(self).check()
    }
}

impl Algorithm for TrpoConfig {
    const SUMMARY: &'static str =
        "trust region policy optimization: on-policy, natural gradient steps within a KL bound";

    type Learner = OnPolicy<Trpo>;

    fn run_mut(&mut self) -> &mut RunSettings {
        &mut self.run
    }
}
