//! Simulators that are programs, as targets: command, controller and noise of a plan.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use mishandle_controllers::{Entry, Layout};
use mishandle_rollout::{ControlLoop, LoopPart, Target};
use mishandle_simulators::{Description, Simulator};

use crate::error::MishandleError;
use crate::plan::Plan;
use crate::resolve::check_no_task_options;
use crate::resolve::described::idle;
use crate::resolve::policy::{Identified, NeededPolicy, check_allowed, of_file};
use crate::resolve::target_file::command;
use crate::resolve::training::noise;

/// Starts the simulator of a plan and looks up its controller.
pub(crate) fn simulator_target(plan: &Plan) -> Result<Target, MishandleError> {
    let simulator = Arc::new(start(plan)?);
    let controller = controller(simulator.description(), plan)?;
    Ok(mishandle_simulators::target(simulator, controller, noise(plan))?)
}

/// As [`simulator_target`], without a controller: for a description.
pub(crate) fn described_simulator(plan: &Plan) -> Result<Target, MishandleError> {
    let simulator = Arc::new(start(plan)?);
    let policy = simulator.description().policy.as_ref();
    let controller = policy.map(|policy| {
        let size = |parts: &[LoopPart]| parts.iter().map(|part| part.size).sum();
        idle(size(&policy.observation), size(&policy.action))
    });
    Ok(mishandle_simulators::target(simulator, controller, noise(plan))?)
}

/// Returns the files of the simulator of a plan.
///
/// # Errors
/// If the program does not start, or describes itself wrongly.
pub(crate) fn simulator_files(plan: &Plan) -> Result<Vec<PathBuf>, MishandleError> {
    Ok(start(plan)?.files())
}

/// Starts the program of a plan, which the user must have typed or allowed.
fn start(plan: &Plan) -> Result<Simulator, MishandleError> {
    let command = command(&plan.target).unwrap_or_default();
    if !plan.is_typed {
        check_allowed("simulator", command)?;
    }
    let folder = if plan.folder.is_empty() { Path::new(".") } else { Path::new(&plan.folder) };
    let program = mishandle_simulators::program(command, folder.to_path_buf())?;
    Ok(Simulator::start(program, None)?)
}

/// Loads the controller of a plan, which a simulator with a policy needs.
fn controller(description: &Description, plan: &Plan) -> Result<Option<Identified>, MishandleError> {
    let Some(policy) = &description.policy else {
        check_no_task_options(plan)?;
        return Ok(None);
    };
    if plan.preset != Plan::new("", "").preset {
        let option = "a task preset other than `paper`";
        return Err(MishandleError::UnsupportedOption { target: plan.target.clone(), option });
    }
    let needed = needed(&description.name, policy);
    if !plan.controller.is_empty() {
        return of_file(&needed, Path::new(&plan.controller), [None, None], plan.stochastic).map(Some);
    }
    Err(MishandleError::InvalidValue {
        what: "the controller",
        value: "missing".to_string(),
        expected: "a path, because the simulator has a policy that Mishandle runs: --controller FILE",
    })
}

/// Returns what the policy of a simulator must fit.
fn needed(name: &str, policy: &ControlLoop) -> NeededPolicy {
    let entries = |parts: &[LoopPart]| {
        let entry =
            |part: &LoopPart| Entry { name: part.name.clone(), unit: part.unit.clone(), size: part.size };
        parts.iter().map(entry).collect()
    };
    let part = |part: &LoopPart| format!("{} ({})", part.name, part.size);
    NeededPolicy {
        name: name.to_string(),
        layout: Layout { observation: entries(&policy.observation), action: entries(&policy.action) },
        observation: policy.observation.iter().map(part).collect::<Vec<_>>().join(", "),
    }
}
