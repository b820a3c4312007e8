use serde::Serialize;

use crate::{Named, Number, Seed};

/// A finished training run.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Training {
    /// Task.
    pub task: String,
    /// Training algorithm.
    pub algorithm: String,
    /// Device of the physics of the training episodes: `cpu` or `gpu`.
    pub device: String,
    /// Seed of the training run.
    pub seed: Seed,
    /// Number of parallel environments.
    pub environments: u64,
    /// Number of control steps over all environments.
    pub environment_steps: u64,
    /// Number of these until the best policy.
    pub best_environment_steps: u64,
    /// Wall-clock time, s.
    pub wall_clock_secs: Number,
    /// Whether the validation criterion stopped the training run early.
    pub stopped_early: bool,
    /// That criterion in words; `null` if it did not stop the training run.
    pub stop_condition: Option<String>,
    /// Time until the return converged; `null` if it did not converge, or without `--csv`.
    pub training_time: Option<TrainingTime>,
    /// Why there is no training time; `null` with one.
    pub no_training_time: Option<String>,
    /// Success rate of the best policy in validation, on random starts without disturbances; `null`
    /// without validation, and if no episode has a verdict.
    pub success_rate: Option<Number>,
    /// Strict success rate of the best policy in the same validation; `null` without
    /// validation, and if no episode has a verdict.
    pub strict_success_rate: Option<Number>,
    /// Its validation on random scenarios of the space; `null` without a space, and
    /// without a verdict.
    pub space: Option<ScenarioRates>,
    /// Its validation at corners of the space; `null` without a space, and without a
    /// verdict.
    pub corners: Option<ScenarioRates>,
    /// Hash of the best policy.
    pub controller_hash: String,
    /// Path of the best controller.
    pub best: String,
    /// Path of the last controller.
    pub last: String,
    /// Path of the learning curve; `null` without `--csv`.
    pub csv: Option<String>,
    /// Path of the folder for TensorBoard; `null` without `--tensorboard`.
    pub tensorboard: Option<String>,
}

/// Rates of a validation on scenarios.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct ScenarioRates {
    /// Success rate.
    pub success_rate: Number,
    /// Strict success rate.
    pub strict_success_rate: Number,
    /// Mean undiscounted return.
    pub mean_return: Number,
}

/// Time until the return of a training run converged.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct TrainingTime {
    /// Number of control steps over all environments.
    pub environment_steps: u64,
    /// Number of control steps per environment.
    pub control_steps: u64,
    /// Wall-clock time, s.
    pub secs: Number,
}

/// A checked plan of a training run, which was not started.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct TrainingPlan {
    /// Task.
    pub task: String,
    /// Training algorithm.
    pub algorithm: String,
    /// Reward.
    pub reward: String,
    /// Device of the physics of the training episodes: `cpu` or `gpu`.
    pub device: String,
    /// Seed of the training run.
    pub seed: Seed,
    /// Number of control steps over all environments, rounded up to whole iterations.
    pub environment_steps: u64,
    /// Command of the training run.
    pub command: String,
    /// All settings, as TOML.
    pub settings: String,
    /// Hash of the task.
    pub task_hash: String,
    /// Hash of its layout of observations and actions.
    pub layout_hash: String,
    /// Format version of controller files by kind of policy.
    pub formats: Named<u64>,
}
