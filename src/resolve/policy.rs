//! Policies of targets that a file or a program describes: controller files, ONNX models and
//! programs.

use std::path::Path;
use std::sync::Arc;

use mishandle_controllers::{ControllerFile, Layout, bytes_hash};
use mishandle_files::{limits, read_bounded};
use mishandle_interchange::{InterchangeError, OnnxPolicy, OnnxProblem};
use mishandle_robots::RobotError;
use mishandle_rollout::{Component, Controller};
use mishandle_simulators::ProgramPolicy;

use crate::error::{MishandleError, invalid, unsupported};
use crate::resolve::{controller_name, is_onnx};

/// A controller, and the components that identify it: first itself, then parts such as its guard.
pub(crate) type Identified = (Arc<dyn Controller>, Vec<Component>);

/// The interface that a controller must fit.
pub(crate) struct NeededPolicy {
    /// Name of the target.
    pub name: String,
    pub layout: Layout,
    /// Parts of the observation, for messages.
    pub observation: String,
}

/// Variable of the environment that allows files to start programs.
const ALLOW_PROGRAMS: &str = "MISHANDLE_ALLOW_PROGRAMS";

/// Checks that the user allowed the program that a file names: nothing else in a file is code.
pub(crate) fn check_allowed(role: &'static str, command: &str) -> Result<(), MishandleError> {
    if std::env::var_os(ALLOW_PROGRAMS).is_some_and(|value| value == "1") {
        Ok(())
    } else {
        let command = command.to_string();
        Err(MishandleError::ProgramNotAllowed { role, command, variable: ALLOW_PROGRAMS })
    }
}

/// Returns the policy of a program, which the user must have allowed: nothing else in a target file
/// is code.
pub(crate) fn of_program(
    policy: &Arc<ProgramPolicy>,
    stochastic: bool,
) -> Result<Identified, MishandleError> {
    let command = policy.command();
    if stochastic {
        return Err(not_stochastic("a program"));
    }
    check_allowed("policy", &command)?;
    policy.check()?;
    let component = Component {
        role: "controller".to_string(),
        name: command,
        hash: policy.hash()?,
        file_hash: String::new(),
    };
    Ok((policy.clone(), vec![component]))
}

/// Returns the error of a policy whose actions cannot be sampled.
pub(crate) fn not_stochastic(what: &str) -> MishandleError {
    invalid("controller", what, "a .safetensors file, because `stochastic` samples the policy's actions")
}

/// Adds the parts of the observation to the error of a model that expects another number of them.
fn with_parts(error: InterchangeError, needed: &NeededPolicy) -> MishandleError {
    match &error {
        InterchangeError::Onnx { problem: OnnxProblem::Shape { side: "observation", .. }, .. } => {
            let message = format!("{error}. The observation: {}", needed.observation);
            RobotError::Policy { message }.into()
        }
        _ => error.into(),
    }
}

/// Loads a controller from a file of ours or an ONNX model; `names` are those of the model's input
/// and output.
pub(crate) fn of_file(
    needed: &NeededPolicy,
    path: &Path,
    names: [Option<&str>; 2],
    stochastic: bool,
) -> Result<Identified, MishandleError> {
    let component = |hash: String, file_hash: String| Component {
        role: "controller".to_string(),
        name: controller_name(&path.to_string_lossy()),
        hash,
        file_hash,
    };
    if is_onnx(path) {
        if stochastic {
            return Err(not_stochastic("an ONNX model"));
        }
        let policy = OnnxPolicy::load_named(path, &[&needed.name], &needed.layout, names)
            .map_err(|error| with_parts(error, needed))?;
        let component = component(policy.hash().to_string(), policy.file_hash().to_string());
        return Ok((Arc::new(policy), vec![component]));
    }
    let (file, bytes) = controller_file(needed, path)?;
    let policy = file.policy.sampling(stochastic);
    let component = component(policy.hash(), bytes_hash(&bytes));
    Ok((Arc::new(policy), vec![component]))
}

/// Reads a controller file; returns it with its bytes.
pub(crate) fn controller_file(
    needed: &NeededPolicy,
    path: &Path,
) -> Result<(ControllerFile, Vec<u8>), MishandleError> {
    let read = |source| mishandle_controllers::ControllerError::Read { path: path.to_path_buf(), source };
    let bytes = read_bounded(path, limits::CONTROLLER).map_err(read)?;
    let wrong = |problem| mishandle_controllers::ControllerError::File { path: path.to_path_buf(), problem };
    let file = ControllerFile::from_bytes(&bytes).map_err(wrong)?;
    file.check(&needed.name, &needed.layout)?;
    if file.header.action_interface.is_some() {
        return Err(unsupported(&needed.name, "the action interface of a controller"));
    }
    Ok((file, bytes))
}
