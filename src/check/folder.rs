//! The folder of a check.

use std::path::{Path, PathBuf};

use mishandle_files::{FileLock, limits, read_text_bounded, write_atomically};
use mishandle_results::{Check, Key, Versioned};
use mishandle_text::path_text;
use sha2::{Digest, Sha256};

use super::CheckSubject;
use crate::error::{MishandleError, foreign_folder};
use crate::resolve::{controller_name, is_path};

/// File of the result.
pub const RESULT: &str = "check.json";

/// Copy of the file of requirements.
pub const REQUIREMENTS: &str = "requirements.toml";

/// Folder of the run files.
const RUNS: &str = "runs";

/// Folder of the counterexamples.
pub const COUNTEREXAMPLES: &str = "counterexamples";

/// File that a check locks.
const LOCK: &str = "check.lock";

/// Creates the folder of a check, or opens the folder of an earlier one, and locks it.
///
/// # Errors
/// If another check runs in it, or it is not the folder of a check. No file is changed then.
pub(super) fn open(folder: &Path, requirements: &str) -> Result<FileLock, MishandleError> {
    if folder.exists() && !folder.is_dir() {
        let source = std::io::ErrorKind::NotADirectory.into();
        return Err(MishandleError::File { path: folder.to_path_buf(), source });
    }
    create_folder(folder)?;
    let with_path = MishandleError::file(folder);
    // A check writes its result before the reports. A kill can leave hidden temporary files.
    let is_copy = |name: &str| {
        let read = || read_text_bounded(&folder.join(name), limits::PLAN);
        name == REQUIREMENTS && read().is_ok_and(|text| text == requirements)
    };
    let is_own =
        |name: &str| [RUNS, COUNTEREXAMPLES, LOCK].contains(&name) || name.starts_with('.') || is_copy(name);
    if recorded(folder)?.is_none() {
        for entry in std::fs::read_dir(folder).map_err(with_path)? {
            let name = entry.map_err(with_path)?.file_name().to_string_lossy().into_owned();
            if !is_own(&name) {
                return Err(foreign_folder("check", folder, &name));
            }
        }
    }
    let path = folder.join(LOCK);
    let lock = FileLock::try_acquire(&path).map_err(MishandleError::write("lock file", &path))?;
    lock.ok_or_else(|| MishandleError::busy("check", folder, Key::OUT))
}

/// Returns the SHA-256 of a file of requirements.
pub fn file_digest(text: &str) -> String {
    Sha256::digest(text.as_bytes()).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Returns a name for the files of each controller.
pub(super) fn labels(subjects: &[CheckSubject]) -> Vec<String> {
    let mut labels: Vec<String> = Vec::new();
    for subject in subjects {
        let name = plain(&controller_name(&subject.plan.controller));
        let name = if name.is_empty() { "system".to_string() } else { name };
        let mut label = name.clone();
        let mut number = 1;
        // Some file systems do not distinguish upper and lower case.
        while labels.iter().any(|known| known.eq_ignore_ascii_case(&label)) {
            number += 1;
            label = format!("{name}-{number}");
        }
        labels.push(label);
    }
    labels
}

/// Returns the path of a run file. No name contains `@`, so two files never have the same path.
pub(super) fn run_file(folder: &Path, label: &str, kind: &str, name: &str) -> PathBuf {
    folder.join(RUNS).join(format!("{kind}-{}@{label}.sqlite", plain(name)))
}

/// Returns the characters that every file system allows.
fn plain(name: &str) -> String {
    name.chars().map(|c| if c.is_alphanumeric() || "-_.+".contains(c) { c } else { '-' }).collect()
}

/// Returns the path of the counterexample of a requirement.
pub(super) fn counterexample_file(folder: &Path, label: &str, name: &str) -> PathBuf {
    folder.join(COUNTEREXAMPLES).join(format!("{name}@{label}.json"))
}

/// Creates a folder with those above it.
pub(super) fn create_folder(path: &Path) -> Result<(), MishandleError> {
    std::fs::create_dir_all(path).map_err(MishandleError::write("folder", path))
}

/// Writes a file of the folder.
pub(super) fn write(path: &Path, content: &[u8]) -> Result<(), MishandleError> {
    write_atomically(path, content).map_err(MishandleError::write("file", path))
}

/// Writes the result and a copy of the file of requirements.
pub(super) fn write_result(folder: &Path, found: &Check, requirements: &str) -> Result<(), MishandleError> {
    create_folder(folder)?;
    write(&folder.join(REQUIREMENTS), requirements.as_bytes())?;
    let path = folder.join(RESULT);
    let json = to_json(found).map_err(MishandleError::file(&path))?;
    write(&path, json.as_bytes())
}

/// Returns the content of the file of a result.
///
/// # Errors
/// If a value cannot be written as JSON.
pub fn to_json(found: &Check) -> std::io::Result<String> {
    Ok(serde_json::to_string_pretty(&Versioned::new(found))?)
}

/// Returns the result of the check in a folder, with the present paths; `None` if the folder has no
/// result.
///
/// # Errors
/// If the file of the result cannot be read.
pub(super) fn finished(folder: &Path) -> Result<Option<Check>, MishandleError> {
    let Some(found) = recorded(folder)? else { return Ok(None) };
    let path = |then: &str| match Path::new(then).strip_prefix(&found.folder) {
        Ok(rest) => path_text(&folder.join(rest)),
        Err(_) => then.to_string(),
    };
    Ok(Some(moved(&found, &path_text(folder), path)))
}

fn recorded(folder: &Path) -> Result<Option<Check>, MishandleError> {
    let path = folder.join(RESULT);
    if !path.exists() {
        return Ok(None);
    }
    let text = read_text_bounded(&path, limits::RESULT).map_err(MishandleError::file(&path))?;
    let found = serde_json::from_str(&text).map_err(|error| MishandleError::file(&path)(error.into()))?;
    Ok(Some(found))
}

/// Returns the result of a check whose folder has another path now. `path` is the present one of a
/// run file or a counterexample. The commands of replays do not change.
pub fn moved(found: &Check, folder: &str, path: impl Fn(&str) -> String) -> Check {
    let mut found = Check { folder: folder.to_string(), ..found.clone() };
    for run in found.controllers.iter_mut().flat_map(|controller| &mut controller.runs) {
        run.run = path(&run.run);
    }
    for violation in found.cells.iter_mut().filter_map(|cell| cell.counterexample.as_mut()) {
        violation.run = path(&violation.run);
        violation.file = violation.file.as_deref().map(&path);
    }
    found
}

/// Returns whether a controller of a result is the one of a run's plan, where a path is absolute.
pub(super) fn is_path_of(name: &str, recorded: &str) -> bool {
    let plain = name.strip_prefix("./").unwrap_or(name);
    name == recorded || (is_path(name) && is_path(recorded) && Path::new(recorded).ends_with(plain))
}
