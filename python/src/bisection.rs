//! Bisections of controllers.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use mishandle::bisect::{BisectionPlan, BisectionProgress, BisectionTest};
use mishandle::plan::RegressSettings;
use mishandle::results::{BisectedCandidate, Bisection};
use mishandle::store::RunFile;
use mishandle::{MishandleError as Error, Plan};
use mishandle_cli::words::shell_command;
use mishandle_report::{BisectionEvidence, ViolatedCounterexamples, bisection_page};
use pyo3::prelude::*;

use crate::call::Call;
use crate::run::{Contents, NOT_SIMULATED, contents_of, run_report};
use crate::work::json;
use crate::{InvalidStateError, InvalidValueError, raised};

/// Finds the first bad one of the controllers in a folder, by counterexamples or by a rate, the key
/// `regress.rate` of the call. Returns the document and its text.
///
/// Ctrl-C and exceptions of `progress` are raised after the running batch. What was simulated
/// remains, so that the same call continues.
#[pyfunction]
pub fn bisect(
    py: Python<'_>,
    call: &str,
    controllers: PathBuf,
    counterexamples: Option<PathBuf>,
    out: PathBuf,
    progress: Option<Py<PyAny>>,
) -> PyResult<(String, String)> {
    let Call { plan, settings, stated } = Call::read(call)?;
    let RegressSettings { rate, every, .. } = settings.regress;
    let is_about_plan = stated.iter().any(|key| key != "regress.every");
    let test = match (counterexamples, rate) {
        (Some(_), _) if is_about_plan => Err(InvalidValueError::new_err(
            "`counterexamples` is a test of its own: leave out `rate`, `seed` and all of `plan` but \
             plan[\"regress\"][\"every\"]",
        )),
        (Some(path), _) => Ok(BisectionTest::Counterexamples(path)),
        (None, None) => Err(InvalidValueError::new_err("give a test: `counterexamples` or `rate`")),
        (None, Some(_)) if plan.target.is_empty() => {
            Err(InvalidValueError::new_err("`rate` needs a target: give plan={\"target\": TARGET}"))
        }
        (None, Some(rate)) => BisectionTest::rate(Plan { is_typed: true, ..plan }, rate).map_err(raised),
    }?;
    let asked = BisectionPlan { controllers, test, every, folder: out, command: String::new() };
    let asked = BisectionPlan { command: mishandle_cli::bisection_command(&asked), ..asked };
    let mut exception = None;
    let found = py.detach(|| {
        let mut watch = |done: BisectionProgress<'_>| match report(progress.as_ref(), done) {
            Ok(()) => ControlFlow::Continue(()),
            Err(error) => {
                exception = Some(error);
                ControlFlow::Break(())
            }
        };
        mishandle::bisect::bisect(&asked, &mut watch)
    });
    match (found, exception) {
        (_, Some(exception)) => Err(exception),
        (Ok(found), None) if found.is_complete => Ok((json(&found)?, mishandle_cli::bisection_text(&found))),
        (Ok(_), None) => Err(InvalidStateError::new_err("the bisection was interrupted")),
        (Err(error), None) => Err(raised(error)),
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

/// Returns the page about the document of a bisection as HTML.
#[pyfunction]
pub fn bisection_report(py: Python<'_>, document: &str, call: &str) -> PyResult<String> {
    let contents = contents_of(call)?;
    let found: Bisection =
        serde_json::from_str(document).map_err(|error| InvalidValueError::new_err(error.to_string()))?;
    let violated = |neighbors: [&BisectedCandidate; 2]| match contents {
        None => Some(ViolatedCounterexamples::skipped(neighbors[1], NOT_SIMULATED)),
        Some(Contents { has_replay, .. }) => {
            ViolatedCounterexamples::simulate(neighbors, has_replay, || false)
        }
    };
    py.detach(|| {
        let read = |path: &Path| -> Result<_, Error> {
            let run = RunFile::open(path)?;
            let report = run_report(&run, None, contents)?;
            Ok(Some((run, report)))
        };
        let evidence = BisectionEvidence::collect(&found, violated, read, shell_command);
        Ok(bisection_page(&found, &evidence?.unwrap_or_default(), shell_command))
    })
    .map_err(|error: Error| raised(error))
}
