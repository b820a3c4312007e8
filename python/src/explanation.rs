//! Explanations and comparisons of recorded simulations as dictionaries.

use std::path::PathBuf;

use mishandle::inspect::{ComparedPair, ExplainedSimulation, FailureMode};
use mishandle::results::{PairedMeans, PairedRates};
use mishandle::store::{RunFile, RunHeader};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::campaign::estimate;
use crate::raised;

/// Returns an explanation.
pub(crate) fn explanation<'py>(
    py: Python<'py>,
    header: &RunHeader,
    explained: &ExplainedSimulation,
) -> PyResult<Bound<'py, PyDict>> {
    let found = &explained.explanation;
    let dict = PyDict::new(py);
    dict.set_item("trial", explained.recorded.trial)?;
    dict.set_item("number", explained.recorded.number)?;
    dict.set_item("robustness", found.diagnosis.robustness())?;
    dict.set_item("sentences", found.sentences(header.control_dt))?;
    let path = found.diagnosis.path.iter();
    let path = path.map(|found| (found.text.clone(), found.sample, found.window, found.robustness));
    dict.set_item("path", path.collect::<Vec<_>>())?;
    let conjuncts = found.conjuncts.iter().map(|found| (found.text.clone(), found.robustness));
    dict.set_item("conjuncts", conjuncts.collect::<Vec<_>>())?;
    let predicate = found.diagnosis.predicate.as_ref().map(|found| {
        (
            found.text.clone(),
            found.sample,
            found.sides.clone(),
            found.values,
            found.robustness,
            found.is_negated,
        )
    });
    dict.set_item("predicate", predicate)?;
    dict.set_item("decided", found.decided)?;
    let window = found.history.as_ref().map(|found| (found.window, found.violated, found.first_and_last));
    dict.set_item("window", window)?;
    Ok(dict)
}

/// A failure mode: decisive predicate, first and last decisive sample, smallest and largest value of each axis, indices of the axes
/// that matter, and trial and number of its failures, the one closest to nominal first.
type Mode = (String, (usize, usize), Vec<Option<(f64, f64)>>, Vec<usize>, Vec<(u32, u32)>);

/// Returns a failure mode.
pub(crate) fn mode(mode: FailureMode) -> Mode {
    let failures = mode.failures.iter().map(|failure| (failure.trial, failure.number)).collect();
    let predicate = mode.representative().predicate.clone();
    (predicate, mode.samples, mode.region, mode.axes, failures)
}

/// Compares two evaluations of the same scenarios and seeds.
#[pyfunction]
pub fn compare(py: Python<'_>, first: PathBuf, second: PathBuf) -> PyResult<Bound<'_, PyDict>> {
    let found = py
        .detach(|| mishandle::inspect::compare(&RunFile::open(first)?, &RunFile::open(second)?))
        .map_err(raised)?;
    let rates = |rates: &PairedRates| {
        (estimate(&rates.first), estimate(&rates.second), estimate(&rates.difference), rates.p_value)
    };
    let means = |means: &PairedMeans| (means.first, means.second, estimate(&means.difference), means.p_value);
    let pairs = |pairs: &[ComparedPair]| {
        let fields = |pair: &ComparedPair| {
            let robustness = (pair.first_robustness, pair.second_robustness);
            let succeeds = (pair.first_succeeds, pair.second_succeeds);
            (pair.trial, pair.number, pair.seed, pair.scenario.clone(), robustness, succeeds)
        };
        pairs.iter().map(fields).collect::<Vec<_>>()
    };
    let dict = PyDict::new(py);
    dict.set_item("pairs", found.pairs)?;
    dict.set_item("differences", found.differences.clone())?;
    dict.set_item("axes", found.axes.iter().map(|axis| axis.name.clone()).collect::<Vec<_>>())?;
    dict.set_item("success", rates(&found.success))?;
    dict.set_item("strict", found.strict.as_ref().map(rates))?;
    dict.set_item("robustness", means(&found.robustness))?;
    dict.set_item("dangerous_steps", found.dangerous_steps.as_ref().map(means))?;
    dict.set_item("completion_step", found.completion_step.as_ref().map(means))?;
    dict.set_item("new_failures", pairs(&found.new_failures))?;
    dict.set_item("fixed_failures", pairs(&found.fixed_failures))?;
    dict.set_item("compared", pairs(&found.compared))?;
    Ok(dict)
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
