//! The controller from which a training run starts.

use mishandle_controllers::ControllerFile;
use mishandle_tasks::Definition;

use crate::error::MishandleError;
use crate::resolve::controller::{controller_of, split_task};
use crate::resolve::{is_onnx, task};
use crate::shipped::EXPERT;

/// Returns the algorithm that trained a controller of a task. `name` is a path or the name of a
/// shipped controller.
///
/// # Errors
/// If there is no such task, or no such trained controller of it.
pub fn algorithm_of(task_name: &str, name: &str) -> Result<String, MishandleError> {
    Ok(start_controller(task(task_name)?.definition(), name)?.header.algorithm)
}

/// Returns a controller from which training can start.
///
/// # Errors
/// If it cannot be read, is not a trained network, or belongs to another task.
pub(crate) fn start_controller(
    definition: &Definition,
    name: &str,
) -> Result<ControllerFile, MishandleError> {
    let expected = "a controller file of this program: training continues its network";
    let refuse = |value: &str| {
        Err(MishandleError::InvalidValue {
            what: "the controller to start from",
            value: value.to_string(),
            expected,
        })
    };
    let (owner, own_name) = split_task(name).unwrap_or((definition, name));
    if own_name == EXPERT {
        return refuse("the expert");
    }
    let shipped = controller_of(owner, own_name)?;
    if is_onnx(shipped.path()) {
        return refuse("an ONNX model");
    }
    let file = shipped.controller()?;
    file.check(definition.name, &definition.layout())?;
    Ok(file)
}
