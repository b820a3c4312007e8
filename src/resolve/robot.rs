//! Robots that a file describes, as targets: file, controller and noise of a plan.

use std::path::Path;
use std::sync::Arc;

use mishandle_controllers::{ControllerFile, bytes_hash};
use mishandle_files::{limits, read_bounded};
use mishandle_interchange::OnnxPolicy;
use mishandle_robots::{ControlledRobot, RobotFile, RobotPolicy};
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
    let (robot, controller, noise) = parts(plan)?;
    Ok(robot.target(controller, noise)?)
}

/// As [`robot_target`], for recordings of its states.
pub(crate) fn controlled_robot(plan: &Plan) -> Result<ControlledRobot, MishandleError> {
    let (robot, (controller, _), noise) = parts(plan)?;
    Ok(robot.controlled(controller, noise)?)
}

/// A controller, and its identity.
type Identified = (Arc<dyn Controller>, Component);

fn parts(plan: &Plan) -> Result<(RobotFile, Identified, Noise), MishandleError> {
    let robot = robot_file(plan)?;
    let noise = Noise { action_std: plan.action_noise, observation_std: plan.observation_noise };
    noise.check()?;
    let controller = controller(&robot, plan)?;
    Ok((robot, controller, noise))
}

/// Loads the controller of a plan, or the one that the file names.
fn controller(robot: &RobotFile, plan: &Plan) -> Result<Identified, MishandleError> {
    if !plan.controller.is_empty() {
        return of_file(robot, Path::new(&plan.controller), plan.stochastic);
    }
    match robot.policy() {
        RobotPolicy::File { path, .. } => of_file(robot, path, plan.stochastic),
        RobotPolicy::Open => Err(MishandleError::InvalidValue {
            what: "the controller",
            value: "missing".to_string(),
            expected: "a path, because the target file has no policy: --controller FILE",
        }),
        RobotPolicy::Expression(policy) => {
            if plan.stochastic {
                return Err(not_stochastic("an expression"));
            }
            // The hash of the file covers it.
            let hash = "expression of the target file".to_string();
            let name = "expression".to_string();
            let component =
                Component { role: "controller".to_string(), name, hash, file_hash: String::new() };
            Ok((policy.clone(), component))
        }
    }
}

fn not_stochastic(what: &str) -> MishandleError {
    MishandleError::InvalidValue {
        what: "controller",
        value: what.to_string(),
        expected: "a .safetensors file, because --stochastic samples the policy's actions",
    }
}

fn of_file(robot: &RobotFile, path: &Path, stochastic: bool) -> Result<Identified, MishandleError> {
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
        let policy = OnnxPolicy::load(path, &[robot.name()], &layout)?;
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
