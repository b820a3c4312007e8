use serde::{Deserialize, Serialize};

use crate::minibatches::check_slices;
use crate::presets::SKRL_0_10;
use crate::settings::{ask, at_least_1, not_negative, positive, share};
use crate::{
    CriticSettings, Division, EpisodeSettings, PolicySettings, RunSettings, Settings, TrainingError,
};

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
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrpoConfig {
    /// Control steps of each simulation between two updates. Default 32.
    pub rollout_steps: usize,
    /// γ, the discount of a control step. Default 0.99.
    pub gamma: f64,
    /// λ of generalised advantage estimation. Default 0.95.
    pub gae_lambda: f64,
    /// δ, the largest mean divergence of the new policy from the old one. Default 0.01.
    pub max_kl: f64,
    /// What is added to the diagonal of the Fisher information. Default 0.1.
    pub damping: f64,
    /// Largest number of iterations of conjugate gradients. Default 10.
    pub cg_iterations: usize,
    /// Squared residual at which they end. Default 1e-10.
    pub cg_tolerance: f64,
    /// Every how manieth row of the rollout the Fisher information is taken over. Default 1: all of them.
    pub fisher_every: usize,
    /// How many steps are tried, each half as long as the last. Default 10.
    pub backtracks: usize,
    /// Share of the improvement expected from the gradient that a step has to bring. Default 0.5.
    pub accept_ratio: f64,
    /// How the line search measures how far a step goes: `exact`, or `flipped`, with the sign of log σ turned, as in
    /// skrl; see [`Distance`]. Default `exact`.
    pub distance: Distance,
    /// The improvement expected of a shorter step: its share of the longest one's (`proportional`), or the product of
    /// all shares tried so far (`compounded`: ½, ⅛, 1/64 …), so that a shorter step is accepted ever more easily, as in
    /// skrl. Default `proportional`.
    pub expected_improvement: Expected,
    /// Passes of the critic over each rollout. Default 5.
    pub epochs: usize,
    /// How a rollout is divided into the critic's minibatches: `shuffled` or `slices`; see [`Division`]. Default
    /// `shuffled`.
    pub minibatches: Division,
    /// Rows of a shuffled minibatch; the last of an epoch has what is left. Default 4096.
    pub minibatch_rows: usize,
    /// Number of slices, each of rows of the rollout / `slices`, rounded down. Default 2.
    pub slices: usize,
    /// Largest norm of the critic's gradient. Default 1.
    pub max_grad_norm: f64,
    /// How long, and when to look.
    pub run: RunSettings,
    /// The simulations.
    pub episodes: EpisodeSettings,
    /// The policy.
    pub policy: PolicySettings,
    /// The critic.
    pub critic: CriticSettings,
}

/// How the line search measures how far the new policy is from the old one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Distance {
    /// By the divergence KL(π_old ‖ π) = Σ log(σ / σ_old) + (σ_old² + (μ_old - μ)²) / (2 σ²) - ½.
    Exact,
    /// By the same, but with log(σ_old / σ). It is not a distance: it is below 0 for steps that widen the policy, which
    /// may then leave the trust region, and it shortens those that make it narrower.
    Flipped,
}

/// The improvement that the line search expects of a step that is shorter than the longest one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Expected {
    /// In proportion to its length.
    Proportional,
    /// The longest one's, times all lengths tried so far as shares of the longest.
    Compounded,
}

impl Default for TrpoConfig {
    fn default() -> TrpoConfig {
        TrpoConfig {
            rollout_steps: 32,
            gamma: 0.99,
            gae_lambda: 0.95,
            max_kl: 0.01,
            damping: 0.1,
            cg_iterations: 10,
            cg_tolerance: 1e-10,
            fisher_every: 1,
            backtracks: 10,
            accept_ratio: 0.5,
            distance: Distance::Exact,
            expected_improvement: Expected::Proportional,
            epochs: 5,
            minibatches: Division::Shuffled,
            minibatch_rows: 4096,
            slices: 2,
            max_grad_norm: 1.0,
            run: RunSettings::default(),
            episodes: EpisodeSettings::default(),
            policy: PolicySettings::default(),
            critic: CriticSettings::default(),
        }
    }
}

impl Settings for TrpoConfig {
    const ALGORITHM: &'static str = "trpo";

    const PRESETS: &'static [(&'static str, &'static str)] = &[(SKRL_0_10, include_str!("skrl-0.10.toml"))];

    fn check(&self) -> Result<(), TrainingError> {
        at_least_1("rollout_steps", self.rollout_steps as u64)?;
        share("gamma", self.gamma)?;
        share("gae_lambda", self.gae_lambda)?;
        positive("max_kl", self.max_kl)?;
        not_negative("damping", self.damping)?;
        at_least_1("cg_iterations", self.cg_iterations as u64)?;
        not_negative("cg_tolerance", self.cg_tolerance)?;
        at_least_1("fisher_every", self.fisher_every as u64)?;
        at_least_1("backtracks", self.backtracks as u64)?;
        share("accept_ratio", self.accept_ratio)?;
        at_least_1("epochs", self.epochs as u64)?;
        ask("minibatch_rows", "at least 2", self.minibatch_rows, self.minibatch_rows >= 2)?;
        positive("max_grad_norm", self.max_grad_norm)?;
        self.run.check()?;
        self.episodes.check()?;
        check_slices(self.rollout_steps * self.episodes.environments, self.slices)?;
        self.policy.check()?;
        self.critic.check()
    }
}
