//! Names and paths of controllers.

use std::path::{Path, PathBuf};

use mishandle_tasks::Definition;

use crate::error::{MishandleError, invalid};
use crate::plan::Plan;
use crate::resolve::training::not_a_start;
use crate::resolve::{is_target_file, task};
use crate::shipped::{CONTROLLERS, EXPERT, ShippedFile, check_home, shipped_controller, shipped_controllers};

/// Returns whether `controller` is a path rather than the name of a shipped controller, `NAME` or
/// `TASK/NAME`.
pub(crate) fn is_path(controller: &str) -> bool {
    let looks_like_path =
        controller.contains(std::path::MAIN_SEPARATOR) || Path::new(controller).extension().is_some();
    looks_like_path && split_task(controller).is_none()
}

/// Splits `TASK/NAME`, the name of a shipped controller with its task. Whether a file has this path
/// does not matter, so that the working directory cannot replace a shipped controller.
pub(crate) fn split_task(controller: &str) -> Option<(&'static Definition, &str)> {
    let (task, name) = controller.split_once('/')?;
    let is_name = !name.contains('/') && Path::new(name).extension().is_none();
    let task = mishandle_tasks::task(task).filter(|_| is_name)?;
    Some((task.definition(), name))
}

/// Returns the file of a task's controller. `name` is a path or the name of a shipped controller.
pub(crate) fn controller_of(definition: &Definition, name: &str) -> Result<ShippedFile, MishandleError> {
    if is_path(name) {
        return Ok(ShippedFile::Path(name.into()));
    }
    if let Some(file) = shipped_controller(definition, name) {
        return Ok(file);
    }
    check_home(CONTROLLERS)?;
    Err(MishandleError::UnknownName {
        kind: "controller",
        name: name.to_string(),
        known: shipped_controllers(definition),
    })
}

/// Returns the file of the controller of a plan for a task or a target file.
///
/// # Errors
/// If the task or the name is unknown, it is that of an expert, or the plan names none.
pub(crate) fn shipped_file(plan: &Plan) -> Result<ShippedFile, MishandleError> {
    if plan.controller.is_empty() {
        let what = "the controller";
        let value = "missing".to_string();
        let expected = "a name or a path: the policy of a target file is no file of its own";
        return Err(invalid(what, value, expected));
    }
    if is_target_file(&plan.target) {
        return Ok(ShippedFile::Path((&plan.controller).into()));
    }
    let definition = task(&plan.target)?.definition();
    let (owner, own_name) = split_task(&plan.controller).unwrap_or((definition, &plan.controller));
    if own_name == EXPERT {
        return Err(not_a_start("the expert"));
    }
    controller_of(owner, own_name)
}

/// Ends of the names of the files that belong to an ONNX model: its description and its weights.
pub(crate) const ONNX_SIDES: [&str; 2] = [".json", ".data"];

/// Returns the path of a file that belongs to an ONNX model.
pub(crate) fn onnx_side(path: &Path, end: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(end);
    PathBuf::from(name)
}

/// Returns the file of a controller. `name` is a path, or `TASK/NAME` for a shipped controller,
/// whether or not the working directory has a file at that path. `./TASK/NAME` names that file.
///
/// # Errors
/// If `name` is neither a path nor a shipped controller.
pub fn find_controller(name: &str) -> Result<ShippedFile, MishandleError> {
    let Some((definition, own_name)) = split_task(name) else {
        let path = Path::new(name);
        return match name.split_once('/') {
            // A misspelled task, or a missing file.
            Some((task_name, _)) if path.extension().is_none() && !path.exists() => match task(task_name) {
                Err(error) if !error.remedies().is_empty() => Err(error),
                _ => Err(no_controller(name)),
            },
            _ if is_path(name) => Ok(ShippedFile::Path(path.into())),
            _ => Err(no_controller(name)),
        };
    };
    if let Some(file) = shipped_controller(definition, own_name) {
        return Ok(file);
    }
    check_home(CONTROLLERS)?;
    if own_name == EXPERT {
        return Err(invalid(
            "the controller",
            name,
            "a trained controller; the expert is part of the task and has no file",
        ));
    }
    let known = shipped_controllers(definition).into_iter().filter(|known| known != EXPERT).collect();
    Err(MishandleError::UnknownName { kind: "controller file", name: own_name.to_string(), known })
}

fn no_controller(name: &str) -> MishandleError {
    let expected =
        "a file that exists, such as ./FILE, or a shipped controller TASK/NAME such as point-reaching/ppo";
    invalid("the controller", name, expected)
}

/// Returns the name of a controller. The name of a path is its file name without extension.
pub fn controller_name(controller: &str) -> String {
    Path::new(controller).file_stem().unwrap_or_default().to_string_lossy().into_owned()
}
