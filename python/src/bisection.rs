//! Bisections of controllers.

use std::ops::ControlFlow;

use mishandle::MishandleError as Error;
use mishandle::bisect::BisectionProgress;
use mishandle::results::{BisectedCandidate, Bisection};
use mishandle::store::RunFile;
use mishandle_report::{BisectionEvidence, ViolatedCounterexamples, bisection_page};
use pyo3::prelude::*;

use crate::run::run_report;
use crate::work::json;
use crate::{InvalidStateError, InvalidValueError, raised};

/// Asks the question of the words of `mishandle bisect`. Returns the document and its text.
///
/// Ctrl-C and exceptions of `progress` are raised after the running batch. What was simulated
/// remains, so that the same call continues.
#[pyfunction]
pub fn bisect(py: Python<'_>, words: Vec<String>, progress: Option<Py<PyAny>>) -> PyResult<(String, String)> {
    let mut exception = None;
    let found = py.detach(|| {
        let mut watch = |done: BisectionProgress<'_>| match report(progress.as_ref(), done) {
            Ok(()) => ControlFlow::Continue(()),
            Err(error) => {
                exception = Some(error);
                ControlFlow::Break(())
            }
        };
        mishandle_cli::ask_bisection(&words, &mut watch)
    });
    match (found, exception) {
        (_, Some(exception)) => Err(exception),
        (Ok(found), None) if found.is_complete => Ok((json(&found)?, mishandle_cli::bisection_text(&found))),
        (Ok(_), None) => Err(InvalidStateError::new_err("the bisection was interrupted")),
        (Err(error), None) => Err(match error.downcast::<Error>() {
            Ok(error) => raised(error),
            Err(error) => InvalidValueError::new_err(format!("{error:#}")),
        }),
    }
}

/// Reports the name of the candidate, the number of its simulations, and the largest number.
fn report(progress: Option<&Py<PyAny>>, done: BisectionProgress<'_>) -> PyResult<()> {
    Python::attach(|py| {
        py.check_signals()?;
        let arguments = (&done.candidate.name, done.simulations.0, done.simulations.1);
        progress.map_or(Ok(()), |progress| progress.call1(py, arguments).map(drop))
    })
}

/// Returns the page about the document of a bisection as HTML. Without `probes`, nothing is
/// simulated.
#[pyfunction]
pub fn bisection_report(
    py: Python<'_>,
    document: &str,
    probes: Option<u32>,
    sensitivity: u32,
) -> PyResult<String> {
    let found: Bisection =
        serde_json::from_str(document).map_err(|error| InvalidValueError::new_err(error.to_string()))?;
    let violated = |neighbors: [&BisectedCandidate; 2]| match probes {
        None => Some(ViolatedCounterexamples::skipped(neighbors[1], "`simulate` is False")),
        Some(_) => ViolatedCounterexamples::simulate(neighbors, || false),
    };
    py.detach(|| {
        let evidence = BisectionEvidence::collect(&found, violated, |path| -> Result<_, Error> {
            let run = RunFile::open(path)?;
            let report = run_report(&run, None, probes, sensitivity)?;
            Ok(Some((run, report)))
        });
        Ok(bisection_page(&found, &evidence?.unwrap_or_default()))
    })
    .map_err(|error: Error| raised(error))
}
