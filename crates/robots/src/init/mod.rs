//! A first target file for a robot with a policy of another tool.
//!
//! `facts` is what the policy's exporter says, `mjlab` and `isaac` read it, `yaml` is the subset of
//! YAML that the latter needs. `robot` is what the model says, `parts` the parts of observations
//! that have a known name, `actuators` what moves the joints, and `write` the text.

mod actuators;
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
}

/// Paths that a first target file names, relative to its folder or absolute.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Paths {
    /// The model as the file names it.
    pub model: String,
    /// The policy as the file names it.
    pub policy: String,
    /// Name of the target.
    pub name: String,
    /// Whether the model may refer to files outside its folder.
    pub allow_outside: bool,
}

/// Writes a first target file for the model at `model` and a policy.
///
/// # Errors
/// If the model cannot be read, it lacks a joint of the policy, or a name cannot be written.
pub fn first_file(
    model: &Path,
    paths: &Paths,
    facts: &PolicyFacts,
    sizes: PolicySizes,
) -> Result<FirstFile, RobotError> {
    let model_facts = crate::model::plain(model, paths.allow_outside)?;
    let facts = &robot::named_as_in(&model_facts, facts);
    let robot = robot::RobotFacts::read(model, model_facts, facts)?;
    write::file(&robot, paths, facts, sizes)
}
