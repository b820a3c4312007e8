use serde::Serialize;

use crate::{Number, Seed};

/// A controller file.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Controller {
    /// Task.
    pub task: String,
    /// Training algorithm.
    pub algorithm: String,
    /// Task preset.
    pub preset: String,
    /// Reward.
    pub reward: String,
    /// Seed of the training run.
    pub seed: Seed,
    /// Number of control steps of the training run until this policy.
    pub environment_steps: u64,
    /// Wall-clock time of the training run, s.
    pub wall_clock_secs: Number,
    /// Git commit of the program; empty if it is unknown.
    pub git_commit: String,
    /// Command of the training run; empty if it is unknown.
    pub command: String,
    /// Validation of the policy during training; `null` without one.
    pub validation: Option<Validation>,
    /// Kind of policy.
    pub policy: String,
    /// Layer sizes.
    pub sizes: Vec<u64>,
    /// How its actions become joint targets; `null` if they move the targets directly.
    pub action_interface: Option<ActionInterface>,
    /// Hash of what the controller does.
    pub controller_hash: String,
    /// Hash of the task.
    pub task_hash: String,
    /// Hash of the layout of observations and actions.
    pub layout_hash: String,
    /// The training settings, as TOML.
    pub settings: String,
    /// Known weaknesses of a shipped controller `TASK/NAME`, from the notes on its task.
    pub weaknesses: Vec<String>,
}

/// Action interface of a controller: an action of 1 asks for the largest velocity of a joint.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct ActionInterface {
    /// Largest commanded velocity of each joint, rad/s.
    pub velocity: Vec<Number>,
    /// Largest commanded acceleration of each joint, rad/s².
    pub acceleration: Vec<Number>,
    /// Largest velocity of the target of each joint, rad/s.
    pub target_velocity: Vec<Number>,
    /// Distance of the targets from the ends of the joints' ranges, rad.
    pub margin: Number,
    /// Time by which the targets lead the commanded motion, s.
    pub lead: Number,
}

/// Validation of a policy during training.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Validation {
    /// Number of episodes.
    pub episodes: u64,
    /// Success rate.
    pub success_rate: Number,
    /// Strict success rate.
    pub strict_success_rate: Number,
}

/// An exported controller.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct ControllerExport {
    /// The ONNX file.
    pub file: String,
    /// Task.
    pub task: String,
    /// Training algorithm.
    pub algorithm: String,
    /// Hash of the controller.
    pub controller_hash: String,
    /// Number of values of an observation.
    pub observation_size: u64,
    /// Number of values of an action.
    pub action_size: u64,
}

/// A controller made from the weights of another tool.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct ControllerImport {
    /// The controller file.
    pub file: String,
    /// Its task.
    pub task: String,
    /// The imported file and the library that wrote it.
    pub source: String,
    /// Layer sizes.
    pub sizes: Vec<u64>,
    /// Activation of the hidden layers.
    pub hidden_activation: String,
    /// Activation of the last layer.
    pub output_activation: String,
    /// Whether it has layer normalization.
    pub layer_norm: bool,
    /// Whether it normalizes observations.
    pub normalized: bool,
    /// Limit of normalized observations; `null` without one.
    pub observation_clip: Option<f64>,
    /// Hash of the controller.
    pub controller_hash: String,
}
