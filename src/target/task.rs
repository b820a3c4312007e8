//! Tasks as targets: which task, which controller, which noise a plan names.

use std::path::Path;
use std::sync::Arc;

use mishandle_controllers::bytes_hash;
use mishandle_rollout::{Component, Controller, Noise};
use mishandle_tasks::{Preset, Task, TaskTarget};

use crate::home::controller_of;
use crate::{MishandleError, Plan, controller_name, shipped_controllers};

/// Name of the controller that is no file.
pub(crate) const EXPERT: &str = "expert";

/// The task of that name.
///
/// # Errors
/// If there is none; the message lists those there are.
pub fn task(name: &str) -> Result<&'static dyn Task, MishandleError> {
    mishandle_tasks::task(name).ok_or_else(|| MishandleError::Name {
        kind: "task",
        name: name.to_string(),
        known: task_names(),
    })
}

/// Names of all tasks.
pub(crate) fn task_names() -> Vec<String> {
    mishandle_tasks::tasks().iter().map(|task| task.definition().name.to_string()).collect()
}

/// The task preset of that name: `paper` or `code`.
///
/// # Errors
/// If there is none.
pub fn preset(name: &str) -> Result<Preset, MishandleError> {
    match name {
        "paper" => Ok(Preset::Paper),
        "code" => Ok(Preset::Code),
        _ => Err(MishandleError::Name {
            kind: "task preset",
            name: name.to_string(),
            known: ["paper", "code"].map(String::from).to_vec(),
        }),
    }
}

/// The task, controller and noise that `plan` names, looked up and checked.
///
/// # Errors
/// If a name is unknown, a file cannot be read or does not fit, or a number makes no sense.
pub fn task_target(plan: &Plan) -> Result<TaskTarget, MishandleError> {
    let task = task(&plan.target)?;
    let preset = preset(&plan.preset)?;
    let noise = Noise { action_std: plan.action_noise, observation_std: plan.observation_noise };
    noise.check()?;
    if plan.controller.is_empty() {
        return Err(MishandleError::NoController {
            target: plan.target.clone(),
            known: shipped_controllers(task.definition()),
        });
    }
    let controller = load_controller(task, &plan.controller, plan.stochastic)?;
    Ok(TaskTarget::new(task, preset, controller, noise)?)
}

/// Whether a controller is named by a path, not by the name of a shipped one.
pub(crate) fn is_path(controller: &str) -> bool {
    controller.contains(std::path::MAIN_SEPARATOR) || Path::new(controller).extension().is_some()
}

/// Loads a controller: the expert, a shipped one by name, or a file by its path.
fn load_controller(
    task: &dyn Task,
    name: &str,
    stochastic: bool,
) -> Result<(Arc<dyn Controller>, Component), MishandleError> {
    let definition = task.definition();
    let component = |hash: String, file_hash: String| Component {
        role: "controller".to_string(),
        name: controller_name(name),
        hash,
        file_hash,
    };
    if name == EXPERT {
        if stochastic {
            return Err(MishandleError::Value {
                what: "controller",
                value: "the expert".to_string(),
                wanted: "a learned policy, for its actions to be sampled",
            });
        }
        let controller = task
            .expert()
            .map_err(|source| MishandleError::Expert { task: definition.name.to_string(), source })?;
        return Ok((controller, component(EXPERT.to_string(), String::new())));
    }
    let shipped = controller_of(definition, name)?;
    let file = shipped.controller()?;
    // What a variant is given may be made for it, or for the task that it varies.
    let made_for = definition.variant_of.filter(|base| file.header.task == *base).unwrap_or(definition.name);
    file.check(made_for, &definition.layout())?;
    let policy = file.policy.sampling(stochastic);
    let component = component(policy.hash(), bytes_hash(&shipped.bytes()?));
    Ok((Arc::new(policy), component))
}
