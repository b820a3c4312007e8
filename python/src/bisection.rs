//! Bisections of controllers.

use std::ops::ControlFlow;
use std::path::PathBuf;

use mishandle::bisect::{BisectionPlan, BisectionProgress, BisectionTest};
use mishandle::files::{limits, read_text_bounded};
use mishandle::plan::{Settings, Values, set};
use mishandle::results::{BisectedCandidate, Bisection};
use mishandle::store::RunFile;
use mishandle::{MishandleError as Error, Plan};
use mishandle_report::{BisectionEvidence, ViolatedCounterexamples, bisection_page};
use pyo3::prelude::*;
use toml::Table;

use crate::run::run_report;
use crate::work::json;
use crate::{InvalidStateError, InvalidValueError, raised};

/// Finds the first bad one of the controllers in a folder, by counterexamples or by a rate, the key
/// `regress.rate`. `keys` are keys of plans with their texts; they override the file `plan`.
/// Returns the document and its text.
///
/// Ctrl-C and exceptions of `progress` are raised after the running batch. What was simulated
/// remains, so that the same call continues.
#[pyfunction]
pub fn bisect(
    py: Python<'_>,
    controllers: PathBuf,
    counterexamples: Option<PathBuf>,
    keys: Vec<(String, String)>,
    plan: Option<PathBuf>,
    out: PathBuf,
    progress: Option<Py<PyAny>>,
) -> PyResult<(String, String)> {
    let (test, every) = test(counterexamples, &keys, plan)?;
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

/// Returns the test, and whether every candidate takes it.
fn test(
    counterexamples: Option<PathBuf>,
    keys: &[(String, String)],
    plan: Option<PathBuf>,
) -> PyResult<(BisectionTest, bool)> {
    let has = |name: &str| keys.iter().any(|(key, _)| key == name);
    let is_about_plan = plan.is_some() || keys.iter().any(|(key, _)| key != "regress.every");
    let mut table = match &plan {
        Some(path) => {
            let with_path = |source| raised(Error::File { path: path.clone(), source });
            let text = read_text_bounded(path, limits::PLAN).map_err(with_path)?;
            mishandle::plan::table(&text, Values::One).map_err(raised)?
        }
        None => Table::new(),
    };
    for (key, text) in keys {
        set(&mut table, key, text, Values::One).map_err(raised)?;
    }
    let regress = Settings::take(&mut table).map_err(raised)?.regress;
    let wrong = |message: &str| Err(InvalidValueError::new_err(message.to_string()));
    let test = match (counterexamples, regress.rate) {
        (Some(_), _) if is_about_plan => {
            return wrong(
                "`counterexamples` is a test of its own: leave out `rate`, `target`, `space`, `action_noise`, `episodes`, `plan` and \
                 `seed`",
            );
        }
        (Some(path), _) => BisectionTest::Counterexamples(path),
        (None, None) => return wrong("give a test: `counterexamples` or `rate`"),
        (None, Some(_)) if !table.contains_key("target") => {
            return wrong("`rate` needs a target: give `target` or `plan`");
        }
        (None, Some(rate)) => {
            // The working folder is one of the file's own target.
            if has("target") {
                table.remove("folder");
            }
            let plan = Plan::from_toml(&table.to_string()).map_err(raised)?;
            BisectionTest::rate(Plan { is_typed: has("target"), ..plan }, rate).map_err(raised)?
        }
    };
    Ok((test, regress.every))
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
