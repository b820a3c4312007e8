//! Folders of evidence: written and verified.

use std::path::PathBuf;

use mishandle::resolve::Moved;
use mishandle_evidence::{Collection, EvidenceError, Key, Signers, Verification, random_seed};
use pyo3::prelude::*;

use crate::MishandleError;
use crate::words::worded;
use crate::work::{json, signals};

/// Writes a folder of evidence and returns the document.
#[pyfunction]
#[pyo3(signature = (runs, out, *, key, force, controller, target))]
pub fn evidence(
    py: Python<'_>,
    runs: Vec<PathBuf>,
    out: PathBuf,
    key: Option<PathBuf>,
    force: bool,
    controller: Option<String>,
    target: Option<String>,
) -> PyResult<String> {
    let mut exception = None;
    let written = py.detach(|| {
        let key = key.as_deref().map(Key::new).transpose()?;
        let moved = Moved { controller: controller.as_deref(), target: target.as_deref() };
        let collection = Collection { runs: &runs, out: &out, force, moved, key: key.as_ref() };
        mishandle_evidence::write(&collection, || signals(&mut exception))
    });
    match exception {
        Some(exception) => Err(exception),
        None => json(&written.map_err(|error| raised(&error))?),
    }
}

/// Verifies a folder of evidence and returns the document.
#[pyfunction]
#[pyo3(signature = (folder, *, allowed_signers, public_key, share, seed))]
pub fn verify_evidence(
    py: Python<'_>,
    folder: PathBuf,
    allowed_signers: Option<PathBuf>,
    public_key: Option<PathBuf>,
    share: f64,
    seed: Option<u64>,
) -> PyResult<String> {
    let mut exception = None;
    let verified = py.detach(|| {
        let signers = match (allowed_signers, public_key) {
            (Some(path), _) => Signers::Allowed(path),
            (None, Some(path)) => Signers::Key(path),
            (None, None) => Signers::Unknown,
        };
        let seed = seed.unwrap_or_else(random_seed);
        mishandle_evidence::verify(&Verification { folder: &folder, signers, share, seed }, |_, _| {
            signals(&mut exception)
        })
    });
    match exception {
        Some(exception) => Err(exception),
        None => json(&verified.map_err(|error| raised(&error))?),
    }
}

fn raised(error: &EvidenceError) -> PyErr {
    MishandleError::new_err(worded(error))
}
