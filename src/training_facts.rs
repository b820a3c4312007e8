use std::sync::Arc;

use mishandle_controllers::WRITTEN_VERSIONS;
use mishandle_rollout::{Environment, Seed};
use mishandle_tasks::task_hash;
use mishandle_training::{Checkpoint, Config};

use crate::train::{check_places, environment, reward, settings};
use crate::{MishandleError, TrainPlan, memory, task};

/// What decides which controller a training gives, and how its file will look.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainingFacts {
    /// All settings, those that the plan's file leaves out with their defaults.
    pub config: Config,
    /// Hash of what the task is to a controller that learns it; see [`task_hash`].
    pub task_hash: String,
    /// Hash of the layout of observations and actions.
    pub layout_hash: String,
    /// Kinds of policy, and the version of the format that a controller with each is written in.
    pub formats: &'static [(&'static str, u64)],
}

/// Looks up and checks what `plan` names, without training and without a trace: what would keep the training from
/// beginning, but for another one that writes to the same files just then.
///
/// # Errors
/// As [`train`](crate::train()), before its first step.
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
