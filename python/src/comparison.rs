//! Comparisons of two evaluations.

use std::path::PathBuf;
use std::sync::PoisonError;

use mishandle::evaluation::SizeSettings;
use mishandle::inspect::{ComparedPair, Expected, SizeQuestion};
use mishandle::plan::{ComparePlan, EvaluatePlan, Measure};
use mishandle::random::Seed;
use mishandle::store::RunFile;
use mishandle::{MishandleError, Plan};
use pyo3::prelude::*;

use crate::question::rule;
use crate::target::PyTarget;
use crate::work::{json, open_run, plan, report};
use crate::{InvalidValueError, raised};

/// Robustness in both runs, and whether both succeed.
type Pair = (Option<f64>, Option<f64>, bool, bool);

/// Compares two evaluations of the same scenarios and seeds.
#[pyfunction]
pub fn compare(py: Python<'_>, first: PathBuf, second: PathBuf) -> PyResult<String> {
    let found = py.detach(|| mishandle::inspect::compare(&RunFile::open(first)?, &RunFile::open(second)?));
    json(&found.map_err(raised)?)
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
        let found = mishandle::inspect::compare(&runs.0, &runs.1)?;
        mishandle_report::comparison_page(&found, [&runs.0, &runs.1])
    };
    py.detach(page).map_err(|error: MishandleError| raised(error))
}

/// Evaluates two versions of a system in step until a rule decides. Returns the paths of the run
/// files and whether they are complete.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "the arguments are keywords in Python")]
#[pyo3(signature = (first, second, *, until, margin, measure, robustness_bounds, episodes, batch, seed, out, resume, durable, progress))]
pub fn evaluate_pairs(
    py: Python<'_>,
    first: &PyTarget,
    second: &PyTarget,
    until: String,
    margin: Option<f64>,
    measure: &str,
    robustness_bounds: Option<[f64; 2]>,
    episodes: u64,
    batch: u32,
    seed: u64,
    out: Option<[PathBuf; 2]>,
    resume: bool,
    durable: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<([PathBuf; 2], bool)> {
    let measure = match measure {
        "success" => Measure::Success,
        "robustness" => Measure::Robustness,
        other => {
            let problem = format!("measure is {other:?}; it must be \"success\" or \"robustness\"");
            return Err(InvalidValueError::new_err(problem));
        }
    };
    let until = rule(Some(until))?.unwrap_or_default();
    let compare = ComparePlan { until, measure, margin, robustness_bounds };
    let evaluate = EvaluatePlan { episodes, batch, control: false, ..EvaluatePlan::default() };
    let of = |target: &PyTarget| Plan {
        compare: Some(compare),
        evaluate: Some(evaluate.clone()),
        ..plan(target, seed)
    };
    let plans = [of(first), of(second)];
    first.check_process()?;
    let done = py.detach(|| {
        let path = |index: usize| out.as_ref().map(|paths| paths[index].clone());
        let (a, first_run) = open_run(first, &plans[0], (path(0), resume, durable, false))?;
        let (b, second_run) = open_run(second, &plans[1], (path(1), resume, durable, false))?;
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

/// Returns the document of how many simulations or pairs a question takes.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "the arguments are keywords in Python")]
#[pyo3(signature = (*, expect, pairs, until, rate, margin, episodes, batch, replications, seed))]
pub fn sample_size(
    py: Python<'_>,
    expect: Option<f64>,
    pairs: Option<[f64; 4]>,
    until: String,
    rate: Option<f64>,
    margin: Option<f64>,
    episodes: u64,
    batch: u64,
    replications: u64,
    seed: u64,
) -> PyResult<String> {
    let expected = match (expect, pairs) {
        (_, Some(pairs)) => Expected::Pairs(pairs),
        (Some(rate), None) => Expected::Rate(rate),
        (None, None) => return Err(InvalidValueError::new_err("give the expected rate")),
    };
    let until = rule(Some(until))?.unwrap_or_default();
    let settings = SizeSettings { max: episodes, batch, replications, seed: Seed(seed) };
    let question = SizeQuestion { expected, until, rate, margin };
    json(&py.detach(|| mishandle::inspect::sample_size(&question, settings)).map_err(raised)?)
}
