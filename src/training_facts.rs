use mishandle_controllers::WRITTEN_VERSIONS;
use mishandle_tasks::task_hash;

use crate::train::{reward, settings};
use crate::{MishandleError, TrainPlan, task};

/// What decides which controller a training gives, and how its file will look.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainingFacts {
    /// All settings, as TOML, those that the plan's file leaves out with their defaults.
    pub settings: String,
    /// Hash of what the task is to a controller that learns it; see [`task_hash`].
    pub task_hash: String,
    /// Hash of the layout of observations and actions.
    pub layout_hash: String,
    /// Kinds of policy, and the version of the format that a controller with each is written in.
    pub formats: &'static [(&'static str, u64)],
}

/// Looks up and checks what `plan` names, without training.
///
/// # Errors
/// If a name is unknown or the settings are wrong.
pub fn training_facts(plan: &TrainPlan) -> Result<TrainingFacts, MishandleError> {
    let task = task(&plan.task)?;
    let reward = reward(&plan.reward)?;
    Ok(TrainingFacts {
        settings: settings(plan)?.to_toml(),
        task_hash: task_hash(task, reward)?,
        layout_hash: task.definition().layout().hash(),
        formats: &WRITTEN_VERSIONS,
    })
}
