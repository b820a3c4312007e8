//! Comparisons of two evaluations.

use std::path::PathBuf;

use mishandle::store::RunFile;
use pyo3::prelude::*;

use crate::raised;
use crate::work::json;

/// Robustness in both runs, and whether both succeed.
type Pair = (Option<f64>, Option<f64>, bool, bool);

/// Compares two evaluations of the same scenarios and seeds. Returns the document and all pairs.
#[pyfunction]
pub fn compare(py: Python<'_>, first: PathBuf, second: PathBuf) -> PyResult<(String, Vec<Pair>)> {
    let found = py
        .detach(|| mishandle::inspect::compare(&RunFile::open(first)?, &RunFile::open(second)?))
        .map_err(raised)?;
    let pairs = found.compared.iter();
    let pairs = pairs.map(|pair| {
        (pair.first_robustness, pair.second_robustness, pair.first_succeeds, pair.second_succeeds)
    });
    let pairs = pairs.collect();
    Ok((json(&found.result())?, pairs))
}

/// Returns how two runs differ as a document.
#[pyfunction]
pub fn diff(py: Python<'_>, first: PathBuf, second: PathBuf) -> PyResult<String> {
    let found = py
        .detach(|| mishandle::inspect::run_difference(&RunFile::open(first)?, &RunFile::open(second)?))
        .map_err(raised)?;
    json(&found)
}

/// Returns the page of a comparison as HTML.
#[pyfunction]
pub fn comparison_page(py: Python<'_>, first: PathBuf, second: PathBuf) -> PyResult<String> {
    let page = || {
        let runs = (RunFile::open(first)?, RunFile::open(second)?);
        let found = mishandle::inspect::compare(&runs.0, &runs.1)?;
        Ok(mishandle_report::comparison_page(&found, [&runs.0, &runs.1]))
    };
    py.detach(page).map_err(|error: mishandle::MishandleError| raised(error))
}
