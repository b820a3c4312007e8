//! Tasks as targets: task, controller and noise of a plan.

use std::sync::Arc;

use mishandle_controllers::guard::Meaning;
use mishandle_controllers::{ControllerFile, bytes_hash};
use mishandle_results::{Choice, Key, Remedy};
use mishandle_rollout::{Component, ReachabilityCheck};
use mishandle_tasks::{ARM_JOINTS, CONTROL_DT, Definition, EPISODE_STEPS, JOINTS, Preset, Task, TaskTarget};

use crate::error::{MishandleError, invalid, problem};
use crate::plan::Plan;
use crate::resolve::controller::{controller_of, split_task};
use crate::resolve::guard::{GuardedLoop, guarded};
use crate::resolve::import::onnx_policy_of;
use crate::resolve::policy::Identified;
use crate::resolve::training::noise;
use crate::resolve::{controller_name, is_onnx};
use crate::shipped::{EXPERT, shipped_controllers};

/// Returns the task with the name `name`.
///
/// # Errors
/// If the name is unknown; the message lists the known tasks.
pub fn task(name: &str) -> Result<&'static dyn Task, MishandleError> {
    mishandle_tasks::task(name).ok_or_else(|| MishandleError::UnknownName {
        kind: "task",
        name: name.to_string(),
        known: task_names(),
    })
}

/// Returns the names of all tasks.
pub(crate) fn task_names() -> Vec<String> {
    mishandle_tasks::tasks().iter().map(|task| task.definition().name.to_string()).collect()
}

/// Returns the task preset with the name `name`: `paper` or `code`.
///
/// # Errors
/// If the name is unknown.
pub fn preset(name: &str) -> Result<Preset, MishandleError> {
    match name {
        "paper" => Ok(Preset::Paper),
        "code" => Ok(Preset::Code),
        _ => Err(MishandleError::UnknownName {
            kind: "task preset",
            name: name.to_string(),
            known: ["paper", "code"].map(String::from).to_vec(),
        }),
    }
}

/// Looks up and checks task, controller and noise of `plan`.
///
/// # Errors
/// If a name is unknown, a file cannot be read or is for another task, or a number is out of its
/// range.
pub fn task_target(plan: &Plan) -> Result<TaskTarget, MishandleError> {
    let task = task(&plan.target)?;
    let preset = preset(&plan.preset)?;
    let noise = noise(plan);
    noise.check()?;
    if plan.controller.is_empty() {
        let known = shipped_controllers(task.definition()).join(", ");
        let text = format!("{} needs a controller; shipped are: {known}", plan.target);
        return Err(problem(text).with(Remedy::set(Key::CONTROLLER, Choice::Shape("NAME|FILE"))));
    }
    let controller = load_controller(task, &plan.controller, plan.stochastic)?;
    let guarded_loop = guarded_loop(task.definition(), controller.0.further_parts());
    let (controller, components) =
        guarded(plan, controller, guarded_loop, |name| load_controller(task, name, false))?;
    Ok(TaskTarget::new(task, preset, controller, components, noise)?)
}

/// Returns which starts of the task of an evaluation are reachable, which no controller changes;
/// `None` for another plan.
pub(crate) fn reachable_starts(plan: &Plan) -> Option<Arc<ReachabilityCheck>> {
    plan.evaluate.as_ref()?;
    mishandle_tasks::task(&plan.target)?;
    let own = Plan { preset: plan.preset.clone(), ..Plan::new(&plan.target, EXPERT) };
    task_target(&own).ok()?.target().ok()?.reachable
}

/// Returns what a guard must know about a task and a controller that reads these further parts of
/// the observation.
pub(crate) fn guarded_loop(definition: &'static Definition, further_parts: &[String]) -> GuardedLoop {
    let arm = vec![Meaning::Increment; ARM_JOINTS];
    let fingers = vec![Meaning::Grip; JOINTS - ARM_JOINTS];
    GuardedLoop {
        layout: definition.layout_with(further_parts),
        task: Some(definition),
        signals: definition.signals.iter().map(|signal| signal.name.to_string()).collect(),
        control_dt: CONTROL_DT,
        episode_steps: EPISODE_STEPS,
        action_limit: 1.0,
        meanings: Some(arm.into_iter().chain(fingers).collect()),
    }
}

/// Loads a controller: the expert, a shipped controller by name, a file of ours or an ONNX model by
/// path.
pub(crate) fn load_controller(
    task: &dyn Task,
    name: &str,
    stochastic: bool,
) -> Result<Identified, MishandleError> {
    let definition = task.definition();
    let component = |hash: String, file_hash: String| Component {
        role: "controller".to_string(),
        name: controller_name(name),
        hash,
        file_hash,
    };
    let (owner, name) = split_task(name).unwrap_or((definition, name));
    if name == EXPERT {
        if owner.name != definition.name {
            return Err(invalid(
                "the controller",
                format!("{}/{EXPERT}", owner.name),
                "a controller of the task",
            ));
        }
        if stochastic {
            return Err(invalid(
                "controller",
                "the expert",
                "a learned policy, because `stochastic` samples the policy's actions",
            ));
        }
        let controller = task.expert().map_err(|error| {
            MishandleError::from(error).of(format!("cannot build the expert of {}", definition.name))
        })?;
        return Ok((controller, vec![component(EXPERT.to_string(), String::new())]));
    }
    let shipped = controller_of(owner, name)?;
    if is_onnx(shipped.path()) {
        if stochastic {
            return Err(invalid(
                "controller",
                "an ONNX model",
                "a .safetensors file, because `stochastic` samples the policy's actions and an ONNX model is \
                           deterministic",
            ));
        }
        let policy = onnx_policy_of(&shipped, definition)?;
        return Ok((policy.controller, vec![component(policy.hash, policy.file_hash)]));
    }
    let file = shipped.controller()?;
    // A variant accepts controllers of its own and of its base task.
    let task_name = definition.variant_of.filter(|base| file.header.task == *base).unwrap_or(definition.name);
    file.check(task_name, &definition.layout_for(&file.header.layout))?;
    let file = ControllerFile { policy: file.policy.sampling(stochastic), ..file };
    let component = component(file.hash(), bytes_hash(&shipped.bytes()?));
    let ControllerFile { header, policy } = file;
    let interface = header.action_interface.as_ref();
    Ok((definition.fit(Arc::new(policy), &header.layout, interface)?, vec![component]))
}
