//! A first target file for a robot with a policy of another tool.
//!
//! `facts` is what the policy's exporter says, `mjlab` and `isaac` read it, `yaml` is the subset of
//! YAML that the latter needs. `robot` is what the model says, `parts` the parts of observations
//! that have a known name, `actuators` what moves the joints, and `write` the text. `bare` has the
//! parts for a robot without a policy, or with one that says nothing.

mod actuators;
mod bare;
mod facts;
mod isaac;
mod mjlab;
mod parts;
mod robot;
mod write;
mod yaml;

use std::path::Path;

pub use facts::{PolicyFacts, PolicySizes};
pub use isaac::isaac_facts;
pub use mjlab::mjlab_facts;

use crate::error::RobotError;

/// A first target file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FirstFile {
    /// The text.
    pub text: String,
    /// Facts that nobody gave, one sentence each; the text has them as comments.
    pub unknown: Vec<String>,
    /// Values that differ between the model and the policy, and other remarks.
    pub remarks: Vec<String>,
    /// Whether nothing is known to be wrong with it.
    pub loads: bool,
}

/// Where the actions of a first target file come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FirstPolicy {
    /// The path of an ONNX model.
    Onnx(String),
    /// A program and its arguments.
    Program(Vec<String>),
    /// A law that holds the start.
    Law,
}

/// Findings of simulations of a first target file, which its final text has.
#[derive(Clone, Debug, PartialEq)]
pub struct Measured {
    /// Bound of each of the two formulas; `None` if the signal did not move.
    pub bounds: [Option<f64>; 2],
    /// Names of the axes of the first space.
    pub axes: Vec<String>,
}

/// Paths that a first target file names, relative to its folder or absolute.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Paths {
    /// The model as the file names it.
    pub model: String,
    /// The policy as the file names it.
    pub policy: FirstPolicy,
    /// Name of the target.
    pub name: String,
    /// Whether the model may refer to files outside its folder.
    pub allow_outside: bool,
}

/// Writes a first target file for the model at `model` and a policy. If the facts of the policy
/// name no joint, its actions are the controls of the actuators.
///
/// # Errors
/// If the model cannot be read, it lacks a joint of the policy, a name cannot be written, or
/// nothing of the model can be moved or has a name.
pub fn first_file(
    model: &Path,
    paths: &Paths,
    facts: &PolicyFacts,
    sizes: PolicySizes,
    measured: Option<&Measured>,
) -> Result<FirstFile, RobotError> {
    let model_facts = crate::model::plain(model, paths.allow_outside)?;
    let is_bare = facts.joints.is_empty() && facts.observed_joints.is_empty();
    let facts = &if is_bare { bare::facts_of(&model_facts) } else { robot::named_as_in(&model_facts, facts) };
    let robot = robot::RobotFacts::read(model, model_facts, facts)?;
    if is_bare && robot.joints.is_empty() && robot.model.actuators() == 0 {
        let message =
            "nothing can be moved: it has no actuator, and no hinge or slide with a name".to_string();
        return Err(RobotError::Model { path: model.to_path_buf(), message });
    }
    if robot.body.is_empty() {
        let message = "no joint and no body has a name; name what the formulas are about".to_string();
        return Err(RobotError::Model { path: model.to_path_buf(), message });
    }
    write::file(&robot, paths, facts, sizes, is_bare, measured)
}
