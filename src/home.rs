//! Where the repository's data files are: shipped controllers and training settings.

use std::path::{Path, PathBuf};

use mishandle_tasks::Definition;

use crate::subject::{EXPERT, is_path};
use crate::{MishandleError, task};

/// The folder that holds `controllers/` and `experiments/training/`: `MISHANDLE_HOME` if it is set, else the first such folder
/// at or above the working directory or the program's own.
pub fn home() -> PathBuf {
    if let Some(home) = std::env::var_os("MISHANDLE_HOME") {
        return home.into();
    }
    let here = std::env::current_dir().unwrap_or_default();
    let program = std::env::current_exe().unwrap_or_default();
    here.ancestors()
        .chain(program.ancestors())
        .find(|folder| folder.join("controllers").is_dir() && folder.join("experiments/training").is_dir())
        .map_or(here.clone(), PathBuf::from)
}

/// The task whose controllers and settings a task takes: of a variant, the task that it varies.
fn base(definition: &Definition) -> &'static str {
    definition.variant_of.unwrap_or(definition.name)
}

fn controllers_of(definition: &Definition) -> PathBuf {
    home().join("controllers").join(base(definition))
}

/// Where the picture of a task is.
pub fn picture_path(task: &str) -> PathBuf {
    home().join("docs").join("tasks").join(format!("{task}.png"))
}

/// Checks that `MISHANDLE_HOME`, if it is set, has the folder `wanted`.
pub(crate) fn check_home(wanted: &'static str) -> Result<(), MishandleError> {
    match std::env::var_os("MISHANDLE_HOME") {
        Some(path) if !Path::new(&path).join(wanted).is_dir() => {
            Err(MishandleError::Home { path: path.into(), wanted })
        }
        _ => Ok(()),
    }
}

/// Where the shipped controller of that name for a task is.
pub fn controller_path(definition: &Definition, name: &str) -> PathBuf {
    controllers_of(definition).join(format!("{name}.safetensors"))
}

/// The file of a controller: a path, or `TASK/NAME` for a shipped one.
///
/// # Errors
/// If there is no such file, nor such a shipped controller.
pub fn find_controller(name: &str) -> Result<PathBuf, MishandleError> {
    let path = Path::new(name);
    let shipped = name.split_once('/').filter(|_| path.extension().is_none() && !path.exists());
    let Some((task_name, name)) = shipped else {
        return if is_path(name) { Ok(path.to_path_buf()) } else { Err(no_controller(name)) };
    };
    let definition = task(task_name)?.definition();
    let path = controller_path(definition, name);
    if path.is_file() {
        return Ok(path);
    }
    check_home("controllers")?;
    if name == EXPERT {
        return Err(MishandleError::Value {
            what: "the controller",
            value: name.to_string(),
            wanted: "one that was trained; the expert is a program of the task's and has no file",
        });
    }
    let known = shipped_controllers(definition).into_iter().filter(|known| known != EXPERT).collect();
    Err(MishandleError::Name { kind: "controller file", name: name.to_string(), known })
}

fn no_controller(name: &str) -> MishandleError {
    let wanted = "a file, as ./FILE, or TASK/NAME for a shipped one, as point-reaching/ppo";
    MishandleError::Value { what: "the controller", value: name.to_string(), wanted }
}

/// What a controller is called: its name, or that of its file without folder and extension.
pub fn controller_name(controller: &str) -> String {
    Path::new(controller).file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// Where the training settings of an algorithm for a task are.
pub fn settings_path(definition: &Definition, algorithm: &str) -> PathBuf {
    home().join("experiments").join("training").join(base(definition)).join(format!("{algorithm}.toml"))
}

/// Names of the shipped controllers of a task, in alphabetical order; the expert comes last.
pub fn shipped_controllers(definition: &Definition) -> Vec<String> {
    let mut names: Vec<String> = std::fs::read_dir(controllers_of(definition))
        .into_iter()
        .flatten()
        .filter_map(|entry| {
            let path = entry.ok()?.path();
            let name = path.file_stem()?.to_str()?.to_string();
            // A name with a point would be taken for a path, as that of a training's last controller.
            (path.extension()? == "safetensors" && !name.contains('.')).then_some(name)
        })
        .collect();
    names.sort();
    names.push(EXPERT.to_string());
    names
}
