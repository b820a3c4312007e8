//! Counterexamples without paths of the machine that made them: the files stand beside them.

use std::path::{Path, PathBuf};

use mishandle_files::{NewFolders, is_same_file, limits, read_bounded, write_atomically};
use mishandle_store::ComponentRecord;

use super::BESIDE;
use crate::error::MishandleError;
use crate::plan::{GuardPlan, Plan};
use crate::resolve::{controller_name, files_of, is_onnx, is_path, is_target_file};
use crate::shipped::shipped_controller;

/// Returns the name of a shipped controller, or `./FILE` for any other. The plan of a run has an
/// absolute path.
pub(super) fn controller(plan: &Plan, components: &[ComponentRecord]) -> String {
    if !is_path(&plan.controller) {
        return plan.controller.clone();
    }
    let name = controller_name(&plan.controller);
    let recorded = components.iter().find(|component| component.role == "controller");
    let shipped = mishandle_tasks::task(&plan.target)
        .and_then(|task| shipped_controller(task.definition(), &name)?.controller().ok())
        .map(|file| file.policy.sampling(plan.stochastic).hash());
    match (shipped, recorded) {
        (Some(hash), Some(recorded)) if hash == recorded.hash => name,
        _ => beside(&plan.controller),
    }
}

/// Returns the name of a target, or `./FILE` for a target file.
pub(super) fn target(plan: &Plan) -> String {
    if is_target_file(&plan.target) { beside(&plan.target) } else { plan.target.clone() }
}

/// Returns the guard, with `./FILE` for a fallback that is a file.
pub(super) fn guard(plan: &Plan) -> Option<GuardPlan> {
    let mut guard = plan.guard.clone()?;
    if is_path(&guard.fallback) {
        guard.fallback = beside(&guard.fallback);
    }
    Some(guard)
}

fn beside(path: &str) -> String {
    format!("{BESIDE}{}", Path::new(path).file_name().unwrap_or_default().to_string_lossy())
}

/// Copies the files of a target to the folder of its counterexamples, with the folders that they
/// have below that of the target file: target file, model, policy, and the controller
/// and the fallback of the plan.
/// Returns the files that it wrote; none for a target without files.
///
/// # Errors
/// If a file is outside the folder of the target file, cannot be read or written, or the folder has
/// another file in its place.
pub fn copy_target(plan: &Plan, folder: &Path) -> Result<Vec<PathBuf>, MishandleError> {
    let Some((home, files)) = files_of(plan)? else { return Ok(Vec::new()) };
    let home = home.canonicalize().map_err(|source| file_error(&home, source))?;
    let mut copies = Vec::new();
    for path in files.iter().flat_map(|path| with_sides(path)) {
        let path = path.canonicalize().map_err(|source| file_error(&path, source))?;
        let Ok(relative) = path.strip_prefix(&home) else {
            return Err(MishandleError::OutsideTargetFolder { path, folder: home });
        };
        copies.push((folder.join(relative), path));
    }
    let fallback = plan.guard.as_ref().map(|guard| &guard.fallback);
    for file in std::iter::once(&plan.controller).chain(fallback).filter(|file| is_path(file)) {
        let sides = with_sides(Path::new(file));
        copies.extend(sides.map(|path| (folder.join(path.file_name().unwrap_or_default()), path)));
    }
    let mut contents = Vec::new();
    for (to, from) in copies {
        let bytes = read_bounded(&from, limits::CONTROLLER).map_err(|source| file_error(&from, source))?;
        match read_bounded(&to, limits::CONTROLLER) {
            Ok(known) if known == bytes || is_same_file(&to, &from) => {}
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => contents.push((to, bytes)),
            _ => return Err(MishandleError::OtherContent { path: to }),
        }
    }
    // Written when all are known to fit.
    let mut folders = NewFolders::default();
    for (to, bytes) in &contents {
        let write = |source| MishandleError::Write { what: "file", path: to.clone(), source };
        if let Some(parent) = to.parent().filter(|parent| !parent.as_os_str().is_empty()) {
            folders.create(parent).map_err(write)?;
        }
        write_atomically(to, bytes).map_err(write)?;
    }
    Ok(contents.into_iter().map(|(to, _)| to).collect())
}

/// Returns a file, and those that belong to an ONNX model and exist.
fn with_sides(path: &Path) -> impl Iterator<Item = PathBuf> {
    let side = |extension: &str| {
        let mut name = path.as_os_str().to_owned();
        name.push(extension);
        PathBuf::from(name)
    };
    let sides = if is_onnx(path) { vec![side(".json"), side(".data")] } else { Vec::new() };
    [path.to_path_buf()].into_iter().chain(sides.into_iter().filter(|side| side.exists()))
}

fn file_error(path: &Path, source: std::io::Error) -> MishandleError {
    MishandleError::File { path: path.to_path_buf(), source }
}
