use std::sync::Arc;

use mishandle_controllers::WRITTEN_VERSIONS;
use mishandle_rollout::{Environment, Seed};
use mishandle_tasks::task_hash;
use mishandle_training::{Checkpoint, Config};

use crate::train::{check_places, environment, reward, settings};
use crate::{MishandleError, TrainPlan, memory, task};

/// The inputs that determine the controller of a training run and the format of its file.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainingFacts {
    /// All settings. Settings that the plan's file leaves out have their defaults.
    pub config: Config,
    /// Hash of the task as a learning controller experiences it; see [`task_hash`].
    pub task_hash: String,
    /// Hash of the layout of observations and actions.
    pub layout_hash: String,
    /// Kinds of policy, each with the format version of its controller files.
    pub formats: &'static [(&'static str, u64)],
}

/// Makes all checks of a training run before its first step, and leaves no files.
///
/// It does not detect another training run that writes to the same files.
///
/// # Errors
/// The errors of [`train`](crate::train()) before its first step.
pub fn training_facts(plan: &TrainPlan) -> Result<TrainingFacts, MishandleError> {
    let task = task(&plan.task)?;
    let config = settings(plan)?;
    let environment = Arc::new(environment(plan)?);
    memory::check(&config, &*environment)?;
    let checkpoint = plan.checkpoint();
    let resumed = plan.resume && checkpoint.exists();
    let resumed = resumed.then(|| Checkpoint::load(&checkpoint)).transpose()?;
    check_places(plan, environment.reward_terms(), resumed.as_ref())?;
    if let Some(checkpoint) = &resumed {
        config.check_resumption(&environment, Seed(plan.seed), checkpoint)?;
    }
    Ok(TrainingFacts {
        task_hash: task_hash(task, reward(&plan.reward)?)?,
        layout_hash: task.definition().layout().hash(),
        formats: &WRITTEN_VERSIONS,
        config,
    })
}
