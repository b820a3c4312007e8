//! The kind of thing that a path names, by its content, then by the ending of its name.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use anyhow::{Context, Result};
use mishandle::harden::{finished, is_hardening};
use mishandle::results::{Bisection, Check, Hardening};
use mishandle_text::{path_text, shell_path};

use crate::words::shell_command;

/// First bytes of a run file.
const SQLITE: &[u8] = b"SQLite format 3\0";

/// The kind of thing that a path names.
pub enum PathKind {
    /// A run file, also one that is missing or damaged.
    Run,
    /// An exported counterexample.
    Counterexample,
    /// A controller: a file, or `TASK/NAME`.
    Controller,
    /// The learning curve of a training.
    Curve,
    /// The folder of a check, which has this result.
    Check(Box<Check>),
    /// The folder of bisections, the last of which has this result.
    Bisection(Box<Bisection>),
    /// The folder of a hardening.
    Hardening,
    /// Another folder: of a campaign, or with run files.
    Folder,
    /// A file of another kind, or a name without a file.
    Other,
}

/// Returns what a path names. `TASK/NAME` is a shipped controller, whether or not there is a file
/// with this path; `./TASK/NAME` names that file.
///
/// # Errors
/// If the result in a folder cannot be read, or does not follow from the runs there.
pub fn of(path: &Path) -> Result<PathKind> {
    if is_controller_name(path) {
        return Ok(PathKind::Controller);
    }
    if path.is_dir() {
        return of_folder(path);
    }
    let ending = path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
    Ok(match ending.as_deref() {
        _ if is_run(path) => PathKind::Run,
        Some("sqlite") => PathKind::Run,
        _ if is_counterexample(path) => PathKind::Counterexample,
        Some("csv") => PathKind::Curve,
        Some("safetensors" | "onnx") => PathKind::Controller,
        _ => PathKind::Other,
    })
}

/// Returns whether the name of a path is one of an exported counterexample.
pub fn is_counterexample(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("json"))
}

fn of_folder(folder: &Path) -> Result<PathKind> {
    if let Some(found) = mishandle::check::verified(folder, shell_command)? {
        return Ok(PathKind::Check(Box::new(found)));
    }
    if let Some(found) = mishandle::bisect::finished(folder)? {
        return Ok(PathKind::Bisection(Box::new(found)));
    }
    Ok(if is_hardening(folder).is_some() { PathKind::Hardening } else { PathKind::Folder })
}

/// Returns the result of the hardening in a folder.
///
/// # Errors
/// If it is not finished.
pub fn hardening(folder: &Path) -> Result<Hardening> {
    finished(folder)?.with_context(|| {
        let name = shell_path(folder);
        format!("the hardening is not finished; continue it with: mishandle harden --resume {name}")
    })
}

/// Returns whether a file starts as a run file. Devices and pipes are not read.
fn is_run(path: &Path) -> bool {
    let mut start = [0; SQLITE.len()];
    path.is_file()
        && File::open(path).and_then(|mut file| file.read_exact(&mut start)).is_ok()
        && start == *SQLITE
}

/// Returns whether a path has the form `TASK/NAME`, and no other file or folder than a task's.
fn is_controller_name(path: &Path) -> bool {
    let text = path_text(path);
    let Some((task, name)) = text.split_once('/') else { return false };
    let is_task = mishandle::tasks::task(task).is_some();
    !name.contains(['/', '.']) && !task.is_empty() && task != "." && (is_task || !path.exists())
}
