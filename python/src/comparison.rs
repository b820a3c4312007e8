//! Comparisons of two evaluations.

use std::path::PathBuf;
use std::sync::PoisonError;

use mishandle::MishandleError;
use mishandle::evaluation::SizeSettings;
use mishandle::inspect::{ComparedPair, Expected, SizeQuestion};
use mishandle::plan::SizePlan;
use mishandle::random::Seed;
use mishandle::store::RunFile;
use mishandle_cli::words::shell_command;
use mishandle_report::FlippedPairs;
use pyo3::prelude::*;

use crate::call::Call;
use crate::target::PyTarget;
use crate::work::{json, open_run, report};
use crate::{InvalidValueError, raised};

/// Robustness in both runs, and whether both succeed.
type Pair = (Option<f64>, Option<f64>, bool, bool);

/// Compares two evaluations of the same scenarios and seeds. Returns the document and its text.
#[pyfunction]
pub fn compare(py: Python<'_>, first: PathBuf, second: PathBuf) -> PyResult<(String, String)> {
    let found = py.detach(|| {
        mishandle::inspect::compare(&RunFile::open(first)?, &RunFile::open(second)?, shell_command)
    });
    let found = found.map_err(raised)?;
    Ok((json(&found)?, mishandle_cli::verdict_text(&mishandle::verdict::comparison(&found))))
}

/// Returns the pairs of a comparison.
#[pyfunction]
pub fn compared_pairs(py: Python<'_>, first: PathBuf, second: PathBuf) -> PyResult<Vec<Pair>> {
    let pairs = || {
        let runs = (RunFile::open(first)?, RunFile::open(second)?);
        let pairs = mishandle::inspect::compared_pairs(&runs.0, &runs.1)?;
        let values =
            |ComparedPair { robustness: [a, b], succeeds: [first, second], .. }| (a, b, first, second);
        pairs.map(|pair| pair.map(values)).collect::<Result<Vec<Pair>, MishandleError>>()
    };
    py.detach(pairs).map_err(raised)
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
        let found = mishandle::inspect::compare(&runs.0, &runs.1, shell_command)?;
        let flipped = FlippedPairs::simulate(&found, [&runs.0, &runs.1], false, || false);
        mishandle_report::comparison_page(&found, [&runs.0, &runs.1], &flipped)
    };
    py.detach(page).map_err(|error: MishandleError| raised(error))
}

/// Evaluates two versions of a system in step until a rule decides. Returns the paths of the run
/// files and whether they are complete.
#[pyfunction]
#[pyo3(signature = (first, second, *, out, resume, progress))]
pub fn evaluate_pairs(
    py: Python<'_>,
    first: &PyTarget,
    second: &PyTarget,
    out: Option<[PathBuf; 2]>,
    resume: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<([PathBuf; 2], bool)> {
    first.check_process()?;
    let done = py.detach(|| {
        let path = |index: usize| out.as_ref().map(|paths| paths[index].clone());
        let (a, first_run, _) = open_run(first, path(0), resume)?;
        let (b, second_run, _) = open_run(second, path(1), resume)?;
        let paths = [&first_run, &second_run].map(|run| run.file().path().to_path_buf());
        let answers = mishandle::run::evaluate_pairs([&a, &b], [first_run, second_run], |done, total| {
            report(first, progress.as_ref(), done, total)
        })?;
        Ok((paths, answers.iter().all(|answer| answer.is_complete)))
    });
    let take = |target: &PyTarget| target.pending.lock().unwrap_or_else(PoisonError::into_inner).take();
    match take(first).or_else(|| take(second)) {
        Some(exception) => Err(exception),
        None => done.map_err(|error: MishandleError| raised(error)),
    }
}

/// Returns the document of how many simulations, or pairs, the rule of a call takes: with a success
/// rate, or with the rates of both versions.
#[pyfunction]
pub fn sample_size(py: Python<'_>, call: &str, rates: Vec<f64>) -> PyResult<String> {
    let Call { plan, settings, .. } = Call::read(call)?;
    let SizePlan { both, batch, replications } = settings.size;
    let expected = match (&rates[..], both) {
        ([rate], _) => Expected::Rate(*rate),
        ([first, second], None) => Expected::independent(*first, *second),
        ([first, second], Some(both)) => {
            Expected::Pairs([both, first - both, second - both, 1.0 - first - second + both])
        }
        _ => return Err(InvalidValueError::new_err("give one expected rate, or two")),
    };
    let evaluate = plan.evaluate.unwrap_or_default();
    let compare = plan.compare.unwrap_or_default();
    let until = evaluate.until.or(plan.compare.map(|compare| compare.until)).unwrap_or_default();
    let settings = SizeSettings { max: evaluate.episodes, batch, replications, seed: Seed(plan.seed) };
    let question = SizeQuestion { expected, until, rate: evaluate.rate, margin: compare.margin };
    json(&py.detach(|| mishandle::inspect::sample_size(&question, settings)).map_err(raised)?)
}
