//! Statements of the exporter of a policy about robot, observation and action.

use crate::error::RobotError;

/// Facts about a policy. Whatever is not given is unknown.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PolicyFacts {
    /// Where they are from, for comments.
    pub(crate) source: String,
    pub(crate) tool: Tool,
    /// The joints that the actions move, in the order of the actions.
    pub(crate) joints: Vec<String>,
    /// The joints that the observation has, if they are others.
    pub(crate) observed_joints: Vec<String>,
    /// Default position of each observed joint, or of each joint.
    pub(crate) default: Vec<(String, f64)>,
    /// Factor of each action, or one for all.
    pub(crate) scale: Vec<f64>,
    /// Position of each joint for an action of 0, if it is not the default position.
    pub(crate) offset: Option<Vec<f64>>,
    /// Stiffness and damping of the joints that have an actuator.
    pub(crate) gains: Option<[Vec<f64>; 2]>,
    pub(crate) action: ActionKind,
    pub(crate) parts: Vec<PartFacts>,
    /// Armature of the joints, kg m² or kg.
    pub(crate) armature: Vec<(String, f64)>,
    /// Duration of a control step and of a physics step, s.
    pub(crate) period: Option<f64>,
    pub(crate) timestep: Option<f64>,
    /// Whether numbers were rounded to three decimals.
    pub(crate) is_rounded: bool,
    /// Statements that this program does not follow.
    pub(crate) remarks: Vec<String>,
}

/// The tool that exported a policy.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Tool {
    #[default]
    Unknown,
    Mjlab,
    Isaac,
}

/// Meaning of the actions.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) enum ActionKind {
    #[default]
    Unknown,
    /// Targets of joint positions.
    Position,
    /// Forces or torques.
    Effort,
}

/// A part of the observation.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct PartFacts {
    pub name: String,
    pub size: Option<usize>,
    /// Factors, one for all or one for each number; empty: 1.
    pub scale: Vec<f64>,
    pub clip: Option<[f64; 2]>,
    /// Number of control steps that the part remembers.
    pub history: usize,
    /// Joints of the part in their order, if they are given.
    pub joints: Vec<String>,
    /// Whether its positions are relative to the default positions; `None` if that is not said.
    pub is_relative: Option<bool>,
    /// Whether it has statements that this program does not follow, such as modifiers.
    pub is_unclear: bool,
}

/// Number of inputs and outputs of a policy, where its file says it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PolicySizes {
    /// Length of the observation.
    pub observation: Option<usize>,
    /// Length of the action.
    pub action: Option<usize>,
}

impl PolicyFacts {
    /// Returns the facts with this text before the name of each joint.
    pub(crate) fn with_prefix(&self, prefix: &str) -> PolicyFacts {
        let long = |name: &String| format!("{prefix}{name}");
        let longs = |names: &[String]| names.iter().map(long).collect();
        let values = |values: &[(String, f64)]| values.iter().map(|(name, x)| (long(name), *x)).collect();
        let part = |part: &PartFacts| PartFacts { joints: longs(&part.joints), ..part.clone() };
        PolicyFacts {
            joints: longs(&self.joints),
            observed_joints: longs(&self.observed_joints),
            default: values(&self.default),
            armature: values(&self.armature),
            parts: self.parts.iter().map(part).collect(),
            ..self.clone()
        }
    }

    /// Returns the default position of a joint.
    pub(crate) fn default_of(&self, joint: &str) -> Option<f64> {
        self.default.iter().find(|(name, _)| name == joint).map(|(_, value)| *value)
    }
}

/// Returns the error of a description that contradicts itself.
pub(crate) fn wrong(source: &str, message: impl std::fmt::Display) -> RobotError {
    RobotError::Policy { message: format!("{source}: {message}") }
}

/// Checks that a list has a number for each name.
pub(crate) fn check_length(source: &str, what: &str, found: usize, names: usize) -> Result<(), RobotError> {
    if found == names {
        Ok(())
    } else {
        Err(wrong(source, format!("`{what}` has {found} numbers, but there are {names} joints")))
    }
}
