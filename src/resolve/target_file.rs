//! Targets that are paths or commands, which a plan keeps with absolute paths.

use std::path::{Path, PathBuf};

use mishandle_robots::RobotPolicy;
use mishandle_text::path_text;

use crate::error::MishandleError;
use crate::plan::Plan;
use crate::resolve::is_path;
use crate::resolve::simulator::{simulator_file, simulator_files};
use crate::resolve::{controller_name, robot_file};

/// Start of the name of a target that is the command of a simulator.
const COMMAND: &str = "process:";

/// Returns the command of a target that is a simulator.
pub fn command(target: &str) -> Option<&str> {
    target.strip_prefix(COMMAND)
}

/// Returns the name of the target of a command.
pub fn command_target(command: &str) -> String {
    format!("{COMMAND}{command}")
}

/// Returns whether the name of a target is the path of a target file.
pub fn is_target_file(target: &str) -> bool {
    let extension = Path::new(target).extension();
    command(target).is_none() && extension.is_some_and(|extension| extension.eq_ignore_ascii_case("toml"))
}

/// Returns whether a target is made of files of the user: a target file, or a simulator.
pub fn has_files(target: &str) -> bool {
    command(target).is_some() || is_target_file(target)
}

/// Returns whether simulations of a plan start a program: a simulator, or a policy of a target
/// file.
///
/// # Errors
/// If the target file cannot be read or is wrong.
pub(crate) fn starts_program(plan: &Plan) -> Result<bool, MishandleError> {
    if command(&plan.target).is_some() || simulator_file(plan)?.is_some() {
        return Ok(true);
    }
    let is_robot = is_target_file(&plan.target) && plan.controller.is_empty();
    Ok(is_robot && matches!(robot_file(plan)?.policy(), RobotPolicy::Program(_)))
}

/// Returns the folder of the files of a target, and the files; `None` for a target without files.
///
/// # Errors
/// If a file cannot be read or is wrong, or a simulator does not start.
pub(crate) fn files_of(plan: &Plan) -> Result<Option<(PathBuf, Vec<PathBuf>)>, MishandleError> {
    let home = match command(&plan.target) {
        Some(_) => Path::new(&plan.folder),
        None if is_target_file(&plan.target) => Path::new(&plan.target).parent().unwrap_or(Path::new("")),
        None => return Ok(None),
    };
    let files = match simulator_file(plan)? {
        Some(file) => simulator_files(plan, &file)?,
        None => robot_file(plan)?.files(),
    };
    let home = if home.as_os_str().is_empty() { Path::new(".") } else { home };
    Ok(Some((home.to_path_buf(), files)))
}

/// Returns a short name of a target for the names of files.
pub(crate) fn file_label(target: &str) -> String {
    if is_target_file(target) {
        return controller_name(target);
    }
    let Some(command) = command(target) else { return target.replace('/', "-") };
    let words =
        mishandle_simulators::program(command, ".".into()).map_or(Vec::new(), |program| program.words);
    // `python3 my_sim.py` is known by its script.
    let script = words.iter().skip(1).find(|word| Path::new(word).extension().is_some());
    let name = controller_name(script.or(words.first()).map_or("", String::as_str));
    let name: String = name.chars().filter(|c| c.is_alphanumeric() || "-_.".contains(*c)).take(60).collect();
    if name.is_empty() { "simulator".to_string() } else { name }
}

impl Plan {
    /// Returns the plan with the absolute path of its target file, of the working folder of its
    /// programs, and of the fallback of its guard.
    pub(crate) fn with_absolute_paths(&self) -> Plan {
        let absolute = |place: &mut String| {
            let present = if place.is_empty() { "." } else { place.as_str() };
            if let Ok(path) = std::path::absolute(present) {
                *place = path_text(&path);
            }
        };
        let mut plan = self.clone();
        let has_trainer = plan.harden.as_ref().is_some_and(|harden| harden.trainer.is_some());
        if has_trainer || command(&plan.target).is_some() {
            absolute(&mut plan.folder);
        }
        if is_target_file(&plan.target) {
            absolute(&mut plan.target);
        }
        if let Some(guard) = plan.guard.as_mut().filter(|guard| is_path(&guard.fallback))
            && let Ok(path) = std::path::absolute(&guard.fallback)
        {
            guard.fallback = path_text(&path);
        }
        plan
    }
}
