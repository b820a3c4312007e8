//! Robots that a file describes, as targets: file, controller and noise of a plan.

use std::path::Path;
use std::sync::Arc;

use mishandle_controllers::{ControllerFile, bytes_hash};
use mishandle_files::{limits, read_bounded};
use mishandle_interchange::{InterchangeError, OnnxPolicy, OnnxProblem};
use mishandle_robots::{RobotError, RobotFile, RobotPolicy};
use mishandle_rollout::{Component, Controller, Noise, Target};

use crate::error::MishandleError;
use crate::plan::Plan;
use crate::resolve::{controller_name, is_onnx};

/// Returns whether the name of a target is the path of a target file.
pub fn is_robot_file(target: &str) -> bool {
    Path::new(target).extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"))
}

/// Reads the target file of a plan.
///
/// # Errors
/// If a file cannot be read or is wrong.
pub fn robot_file(plan: &Plan) -> Result<RobotFile, MishandleError> {
    Ok(RobotFile::read(Path::new(&plan.target))?)
}

/// Looks up and checks the file, the controller and the noise of `plan`.
pub(crate) fn robot_target(plan: &Plan) -> Result<Target, MishandleError> {
    if plan.preset != Plan::new("", "").preset {
        let option = "a task preset other than `paper`";
        return Err(MishandleError::UnsupportedOption { target: plan.target.clone(), option });
    }
    let robot = robot_file(plan)?;
    let noise = Noise { action_std: plan.action_noise, observation_std: plan.observation_noise };
    noise.check()?;
    let controller = controller(&robot, plan)?;
    Ok(robot.target(controller, noise)?)
}

/// Loads the controller of a plan, or the one that the file names.
fn controller(robot: &RobotFile, plan: &Plan) -> Result<(Arc<dyn Controller>, Component), MishandleError> {
    if !plan.controller.is_empty() {
        return of_file(robot, Path::new(&plan.controller), [None, None], plan.stochastic);
    }
    match robot.policy() {
        RobotPolicy::File { path, interface } => {
            let names = [0, 1].map(|index| interface[index].as_deref());
            of_file(robot, path, names, plan.stochastic)
        }
        RobotPolicy::Open => Err(MishandleError::InvalidValue {
            what: "the controller",
            value: "missing".to_string(),
            expected: "a path, because the target file has no policy: --controller FILE",
        }),
        RobotPolicy::Expression(policy) => of_the_file(policy, "expression", plan),
        RobotPolicy::BuiltIn(policy) => of_the_file(policy, "task-space", plan),
    }
}

/// Returns a controller that the target file defines; its hash is that of the file.
fn of_the_file(
    policy: &Arc<dyn Controller>,
    name: &str,
    plan: &Plan,
) -> Result<(Arc<dyn Controller>, Component), MishandleError> {
    if plan.stochastic {
        return Err(not_stochastic(name));
    }
    let hash = format!("{name} of the target file");
    let component =
        Component { role: "controller".to_string(), name: name.to_string(), hash, file_hash: String::new() };
    Ok((policy.clone(), component))
}

fn not_stochastic(what: &str) -> MishandleError {
    MishandleError::InvalidValue {
        what: "controller",
        value: what.to_string(),
        expected: "a .safetensors file, because --stochastic samples the policy's actions",
    }
}

/// Returns the warnings about the policy of a plan whose target is a file; none for other targets.
///
/// # Errors
/// If no episode can start with this policy.
pub(crate) fn contract_warnings(plan: &Plan) -> Result<Vec<String>, MishandleError> {
    if !is_robot_file(&plan.target) {
        return Ok(Vec::new());
    }
    let robot = robot_file(plan)?;
    let (controller, _) = controller(&robot, plan)?;
    Ok(robot.check_contract(&*controller)?)
}

/// Adds the parts of the observation to the error of a model that expects another number of them.
fn with_parts(error: InterchangeError, robot: &RobotFile) -> MishandleError {
    match &error {
        InterchangeError::Onnx { problem: OnnxProblem::Shape { side: "observation", .. }, .. } => {
            let parts = robot.observation_text();
            let message = format!("{error}. The observation of the file: {parts}");
            RobotError::Policy { message }.into()
        }
        _ => error.into(),
    }
}

fn of_file(
    robot: &RobotFile,
    path: &Path,
    names: [Option<&str>; 2],
    stochastic: bool,
) -> Result<(Arc<dyn Controller>, Component), MishandleError> {
    let component = |hash: String, file_hash: String| Component {
        role: "controller".to_string(),
        name: controller_name(&path.to_string_lossy()),
        hash,
        file_hash,
    };
    let layout = robot.layout();
    if is_onnx(path) {
        if stochastic {
            return Err(not_stochastic("an ONNX model"));
        }
        let policy = OnnxPolicy::load_named(path, &[robot.name()], &layout, names)
            .map_err(|error| with_parts(error, robot))?;
        let component = component(policy.hash().to_string(), policy.file_hash().to_string());
        return Ok((Arc::new(policy), component));
    }
    let read = |source| mishandle_controllers::ControllerError::Read { path: path.to_path_buf(), source };
    let bytes = read_bounded(path, limits::CONTROLLER).map_err(read)?;
    let wrong = |problem| mishandle_controllers::ControllerError::File { path: path.to_path_buf(), problem };
    let file = ControllerFile::from_bytes(&bytes).map_err(wrong)?;
    file.check(robot.name(), &layout)?;
    let policy = file.policy.sampling(stochastic);
    let component = component(policy.hash(), bytes_hash(&bytes));
    Ok((Arc::new(policy), component))
}
