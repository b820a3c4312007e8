//! The requirements of a file, checked on a Python target.

use std::path::{Path, PathBuf};

use mishandle::check::{CheckCost, CheckProgress, CheckSubject, Requirements};
use mishandle::files::{limits, read_text_bounded};
use mishandle::rollout::NamedFormula;
use mishandle::stl::Formula;
use mishandle_cli::words::shell_command;
use mishandle_requirements::RequirementFile;
use pyo3::prelude::*;

use crate::target::PyTarget;
use crate::work::{detached, json, report};
use crate::{InvalidStateError, InvalidValueError, MishandleError};

fn read(path: &Path) -> PyResult<(RequirementFile, String)> {
    let problem =
        |error: String| InvalidValueError::new_err(format!("requirements {}: {error}", path.display()));
    let text = read_text_bounded(path, limits::PLAN).map_err(|error| problem(error.to_string()))?;
    let file = RequirementFile::from_toml(&text).map_err(|error| problem(error.to_string()))?;
    Ok((file, text))
}

/// Returns the names of the requirements of a file with their formulas.
#[pyfunction]
pub fn requirement_formulas(path: PathBuf) -> PyResult<Vec<(String, String)>> {
    let (file, _) = read(&path)?;
    Ok(file.requirements.iter().map(|found| (found.name.clone(), found.timed_formula())).collect())
}

/// Checks the requirements of a file. Returns the document, its text, and the exit code of the
/// command.
#[pyfunction]
#[pyo3(signature = (target, *, requirements, out, progress))]
pub fn check(
    py: Python<'_>,
    target: &PyTarget,
    requirements: PathBuf,
    out: PathBuf,
    progress: Option<Py<PyAny>>,
) -> PyResult<(String, String, u8)> {
    let (file, text) = read(&requirements)?;
    let requirements = Requirements { file: &file, path: &requirements, text: &text, words: shell_command };
    let mut under_test = target.target.clone();
    // An evaluation has the first formula as its requirement, so the target must have its signals.
    let signals = under_test.signal_names();
    let is_known = |text: &str| {
        let reads_known =
            |formula: Formula| formula.signals().iter().all(|name| signals.iter().any(|known| known == name));
        Formula::parse(text).is_ok_and(reads_known)
    };
    under_test.formulas.retain(|formula| is_known(&formula.text));
    if under_test.formulas.is_empty() {
        let stated = file.requirements.iter().map(|found| (&found.name, found.timed_formula()));
        let first = stated.into_iter().find(|(_, text)| is_known(text));
        let named = |(name, text): (&String, String)| NamedFormula { name: name.clone(), text };
        under_test.formulas.extend(first.map(named));
    }
    let subject = CheckSubject { plan: target.plan.clone(), target: Some(under_test) };
    let found = detached(py, target, || {
        let mut watch = |done: &CheckProgress| {
            report(
                target,
                progress.as_ref(),
                done.done,
                done.largest.map_or(done.all, CheckCost::simulations),
            )
        };
        mishandle::check::check(&[subject], &requirements, &target.settings.check, &out, &mut watch)
    })?;
    let found = found.ok_or_else(|| InvalidStateError::new_err("the check was interrupted"))?;
    mishandle_cli::write_check_reports(&found, &out, &mut || py.check_signals().is_err())
        .map_err(|error| MishandleError::new_err(format!("{error:#}")))?;
    Ok((json(&found)?, mishandle_cli::check_text(&found), found.exit_code()))
}
