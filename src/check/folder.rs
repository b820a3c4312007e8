//! The folder of a check.

use std::path::{Path, PathBuf};

use mishandle_files::{FileLock, limits, read_text_bounded, write_atomically};
use mishandle_results::{Check, Versioned};
use mishandle_text::path_text;
use sha2::{Digest, Sha256};

use super::{CheckSubject, create_folder};
use crate::error::MishandleError;
use crate::resolve::controller_name;

/// File of the result.
pub const RESULT: &str = "check.json";

/// Folder of the run files.
const RUNS: &str = "runs";

/// Folder of the counterexamples.
pub(super) const COUNTEREXAMPLES: &str = "counterexamples";

/// File that a check locks.
const LOCK: &str = "check.lock";

/// Creates the folder of a check, or opens that of an earlier one, and locks it.
///
/// # Errors
/// If another check runs in it, or it is not that of a check: then its files stay as they are.
pub(super) fn open(folder: &Path) -> Result<FileLock, MishandleError> {
    if folder.exists() && !folder.is_dir() {
        let source = std::io::ErrorKind::NotADirectory.into();
        return Err(MishandleError::File { path: folder.to_path_buf(), source });
    }
    create_folder(folder)?;
    let with_path = |source| MishandleError::File { path: folder.to_path_buf(), source };
    // A check writes its result before the reports. A kill can leave hidden temporary files.
    let is_own = |name: &str| [RUNS, COUNTEREXAMPLES, LOCK].contains(&name) || name.starts_with('.');
    if finished(folder)?.is_none() {
        for entry in std::fs::read_dir(folder).map_err(with_path)? {
            let name = entry.map_err(with_path)?.file_name().to_string_lossy().into_owned();
            if !is_own(&name) {
                return Err(MishandleError::NotACheck { path: folder.to_path_buf(), name });
            }
        }
    }
    let path = folder.join(LOCK);
    let lock = FileLock::try_acquire(&path).map_err(|source| MishandleError::Write {
        what: "lock file",
        path: path.clone(),
        source,
    })?;
    lock.ok_or_else(|| MishandleError::CheckRuns { path: folder.to_path_buf() })
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

/// Writes a file of the folder.
pub(super) fn write(path: &Path, content: &[u8]) -> Result<(), MishandleError> {
    write_atomically(path, content).map_err(|source| MishandleError::Write {
        what: "file",
        path: path.to_path_buf(),
        source,
    })
}

/// Writes the result.
pub(super) fn write_result(folder: &Path, found: &Check) -> Result<(), MishandleError> {
    create_folder(folder)?;
    let path = folder.join(RESULT);
    let json = serde_json::to_vec_pretty(&Versioned::new(found));
    let json = json.map_err(|error| MishandleError::File { path: path.clone(), source: error.into() })?;
    write(&path, &json)
}

/// Returns the result of the check in a folder; `None` if the folder has no result.
///
/// # Errors
/// If the file of the result cannot be read.
pub fn finished(folder: &Path) -> Result<Option<Check>, MishandleError> {
    let path = folder.join(RESULT);
    if !path.exists() {
        return Ok(None);
    }
    let with_path = |source| MishandleError::File { path: path.clone(), source };
    let text = read_text_bounded(&path, limits::RESULT).map_err(with_path)?;
    let found: Check = serde_json::from_str(&text).map_err(|error| with_path(error.into()))?;
    Ok(Some(Check { folder: path_text(folder), ..found }))
}
