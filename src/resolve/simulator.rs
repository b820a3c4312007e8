//! Simulators that are programs, as targets: command, controller and noise of a plan.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use mishandle_controllers::{Entry, Layout};
use mishandle_files::{limits, read_text_bounded};
use mishandle_results::{Choice, Key, ProtocolCheck, Remedy};
use mishandle_rollout::{ControlLoop, LoopPart, Target};
use mishandle_simulators::{
    Description, FilePolicy, ProgramPolicy, ProgramSettings, Simulator, SimulatorFile,
};

use crate::error::{MishandleError, invalid, unsupported};
use crate::plan::Plan;
use crate::resolve::check_no_task_options;
use crate::resolve::described::idle;
use crate::resolve::guard::{GuardedLoop, guarded};
use crate::resolve::policy::{Identified, NeededPolicy, check_allowed, of_file, of_program};
use crate::resolve::target_file::{command, is_target_file};
use crate::resolve::training::noise;

/// Starts the simulator of a plan and looks up its controller.
pub(crate) fn simulator_target(plan: &Plan, file: &SimulatorFile) -> Result<Target, MishandleError> {
    let simulator = Arc::new(start(plan, file)?);
    let description = simulator.description();
    let mut controller = controller(description, plan, file)?;
    if let (Some(policy), Some(own)) = (&description.policy, controller.take()) {
        let needed = needed(&description.name, policy);
        let guarded_loop = GuardedLoop {
            layout: needed.layout.clone(),
            task: None,
            signals: description.signals.iter().map(|signal| signal.name.clone()).collect(),
            control_dt: policy.control_dt,
            episode_steps: policy.episode_steps,
            action_limit: policy.action_limit,
            meanings: None,
        };
        let load = |path: &str| of_file(&needed, Path::new(path), [None, None], false);
        controller = Some(guarded(plan, own, guarded_loop, load)?);
    }
    Ok(mishandle_simulators::target(simulator, controller, noise(plan))?)
}

/// As [`simulator_target`], without a controller: for a description.
pub(crate) fn described_simulator(plan: &Plan, file: &SimulatorFile) -> Result<Target, MishandleError> {
    let simulator = Arc::new(start(plan, file)?);
    let policy = simulator.description().policy.as_ref();
    let controller = policy.map(|policy| {
        let [observations, actions] = policy.sizes();
        idle(observations, actions)
    });
    Ok(mishandle_simulators::target(simulator, controller, noise(plan))?)
}

/// Checks whether the simulator of a command, which the user typed, keeps the protocol.
///
/// # Errors
/// If the command is not a list of words.
pub fn check_protocol(command: &str) -> Result<ProtocolCheck, MishandleError> {
    let program = mishandle_simulators::program(command, PathBuf::from("."))?;
    Ok(mishandle_simulators::check(program, None))
}

/// Returns the simulator that a plan names by its command or by a target file; `None` for any other
/// target.
///
/// # Errors
/// If the command has no word, or the file cannot be read or is wrong.
pub(crate) fn simulator_file(plan: &Plan) -> Result<Option<SimulatorFile>, MishandleError> {
    if let Some(command) = command(&plan.target) {
        let folder = if plan.folder.is_empty() { Path::new(".") } else { Path::new(&plan.folder) };
        let program = mishandle_simulators::program(command, folder.to_path_buf())?;
        return Ok(Some(SimulatorFile { program, time_limit: None, policy: FilePolicy::Open }));
    }
    if !is_target_file(&plan.target) {
        return Ok(None);
    }
    let path = Path::new(&plan.target);
    // The reader of robots reports a file that cannot be read.
    let Ok(text) = read_text_bounded(path, limits::SETTINGS) else { return Ok(None) };
    Ok(SimulatorFile::parse(path, &text)?)
}

/// Returns the files of a simulator, with those of its policy.
///
/// # Errors
/// If the program does not start, or describes itself wrongly.
pub(crate) fn simulator_files(plan: &Plan, file: &SimulatorFile) -> Result<Vec<PathBuf>, MishandleError> {
    let own = Some(PathBuf::from(&plan.target)).filter(|_| is_target_file(&plan.target));
    let simulator = start(plan, file)?;
    let policy = match &file.policy {
        FilePolicy::Open => Vec::new(),
        FilePolicy::File { path, .. } => vec![path.clone()],
        FilePolicy::Program(settings) => match &simulator.description().policy {
            Some(policy) => program(settings, policy, file).files(),
            None => Vec::new(),
        },
    };
    Ok(own.into_iter().chain(simulator.files()).chain(policy).collect())
}

/// Starts the program of a plan, which the user must have typed or allowed.
fn start(plan: &Plan, file: &SimulatorFile) -> Result<Simulator, MishandleError> {
    let is_typed = plan.is_typed && command(&plan.target).is_some();
    if !is_typed {
        check_allowed("simulator", &file.program.words.join(" "))?;
    }
    Ok(Simulator::start(file.program.clone(), file.time_limit)?)
}

/// Loads the controller of a plan or of a target file, which a simulator with a policy needs.
fn controller(
    description: &Description,
    plan: &Plan,
    file: &SimulatorFile,
) -> Result<Option<Identified>, MishandleError> {
    let Some(policy) = &description.policy else {
        if file.policy != FilePolicy::Open {
            return Err(invalid(
                "the table [policy] of the target file",
                "given",
                "left out, because the simulator states no `policy`: it contains its own controller",
            ));
        }
        if !plan.controller.is_empty() {
            return Err(invalid(
                "the controller",
                &plan.controller,
                "left out, because the simulator states no `policy`: it contains its own controller",
            ));
        }
        check_no_task_options(plan)?;
        return Ok(None);
    };
    if plan.preset != Plan::new("", "").preset {
        let option = "a task preset other than `paper`";
        return Err(unsupported(&plan.target, option));
    }
    let needed = needed(&description.name, policy);
    if !plan.controller.is_empty() {
        return of_file(&needed, Path::new(&plan.controller), [None, None], plan.stochastic).map(Some);
    }
    match &file.policy {
        FilePolicy::File { path, interface } => {
            let names = [0, 1].map(|index| interface[index].as_deref());
            of_file(&needed, path, names, plan.stochastic).map(Some)
        }
        FilePolicy::Program(settings) => {
            of_program(&Arc::new(program(settings, policy, file)), plan.stochastic).map(Some)
        }
        FilePolicy::Open => Err(invalid(
            "the controller",
            "missing",
            "a path, because the simulator has a policy that Mishandle runs",
        )
        .with(Remedy::set(Key::CONTROLLER, Choice::FILE))),
    }
}

/// Returns a policy that is a program.
fn program(settings: &ProgramSettings, policy: &ControlLoop, file: &SimulatorFile) -> ProgramPolicy {
    ProgramPolicy::new(settings.clone(), &file.program.folder, policy.sizes(), policy.control_dt)
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
