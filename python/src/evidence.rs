//! Folders of evidence: written and verified.

use std::path::PathBuf;

use mishandle_cli::words::shell_command;
use mishandle_evidence::{Collection, EvidenceError, Key, Signers, Verification, random_seed};
use pyo3::prelude::*;

use crate::MishandleError;
use crate::call::settings;
use crate::words::worded;
use crate::work::{json, signals};

/// Writes a folder of evidence and returns the document.
#[pyfunction]
#[pyo3(signature = (runs, out, call, *, key, force))]
pub fn evidence(
    py: Python<'_>,
    runs: Vec<PathBuf>,
    out: PathBuf,
    call: &str,
    key: Option<PathBuf>,
    force: bool,
) -> PyResult<String> {
    let engine = settings(call)?.engine;
    let mut exception = None;
    let written = py.detach(|| {
        let key = key.as_deref().map(Key::new).transpose()?;
        let collection = Collection {
            runs: &runs,
            out: &out,
            force,
            moved: engine.moved(),
            key: key.as_ref(),
            words: shell_command,
        };
        mishandle_evidence::write(&collection, || signals(&mut exception))
    });
    match exception {
        Some(exception) => Err(exception),
        None => json(&written.map_err(|error| raised(&error))?),
    }
}

/// Verifies a folder of evidence and returns the document.
#[pyfunction]
#[pyo3(signature = (folder, call, *, allowed_signers, public_key, seed))]
pub fn verify_evidence(
    py: Python<'_>,
    folder: PathBuf,
    call: &str,
    allowed_signers: Option<PathBuf>,
    public_key: Option<PathBuf>,
    seed: Option<u64>,
) -> PyResult<String> {
    let share = settings(call)?.evidence.replay;
    let mut exception = None;
    let verified = py.detach(|| {
        let signers = match (allowed_signers, public_key) {
            (Some(path), _) => Signers::Allowed(path),
            (None, Some(path)) => Signers::Key(path),
            (None, None) => Signers::Unknown,
        };
        let seed = seed.unwrap_or_else(random_seed);
        mishandle_evidence::verify(
            &Verification { folder: &folder, signers, share, seed, words: shell_command },
            |_, _| signals(&mut exception),
        )
    });
    match exception {
        Some(exception) => Err(exception),
        None => json(&verified.map_err(|error| raised(&error))?),
    }
}

fn raised(error: &EvidenceError) -> PyErr {
    MishandleError::new_err(worded(error))
}
