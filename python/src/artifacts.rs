//! Reports, survival curves, counterexample files and regression tests of Python systems.

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::Instant;

use mishandle::counterexample::{Counterexample, Preparation, Suite, Tested};
use mishandle::evaluation::{SurvivalCurve, lifetimes};
use mishandle::plan::RegressSettings;
use mishandle::results::Falsification;
use mishandle::run::answer_of_run;
use mishandle::store::RunFile;
use mishandle::{MishandleError as Error, ResolvedPlan};
use mishandle_cli::words::shell_command;
use mishandle_report::{Measurement, Mover, Painter, RunReport, page};
use numpy::PyReadonlyArray2;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;

use crate::call::settings;
use crate::run::{Contents, contents_of, replay_text, run_report};
use crate::target::{PyTarget, keep};
use crate::work::{self, detached, json, recorded};
use crate::{MishandleError, raised};

/// Returns a report of a run as HTML, measured with the target.
#[pyfunction]
pub fn report(py: Python<'_>, target: &PyTarget, path: PathBuf, call: &str) -> PyResult<String> {
    let Some(Contents { samples, has_replay }) = contents_of(call)? else {
        let made = || Ok(page(&[run_report(&RunFile::open(&path)?, None, None)?]));
        return py.detach(made).map_err(|error: Error| raised(error));
    };
    detached(py, target, || {
        let run = RunFile::open(&path)?;
        let resolved = recorded(target, &run)?;
        let mut report = RunReport::load(&run, &path.to_string_lossy(), Some(&resolved), shell_command)?;
        let mut painter = target.painter.as_ref().map(|painter| PythonPainter { target, painter });
        let painter = painter.as_mut().map(|painter| -> &mut dyn Painter { painter });
        let measured = report
            .measure_with(&run, &resolved, painter, samples, |_, _| work::report(target, None, 0, 0))?;
        if let Measurement::Skipped { reason } = &measured {
            report.note_no_simulations(reason);
        } else if has_replay {
            let mut mover = target.mover.as_ref().map(|mover| PythonMover { target, mover });
            let mover = mover.as_mut().map(|mover| -> &mut dyn Mover { mover });
            let command = |(trial, number)| replay_text(&run, trial, number);
            let watch = |_, _| work::report(target, None, 0, 0);
            if let Err(error) = report.record_replay_with(&run, &resolved, mover, command, watch) {
                report.note_no_replay(&error);
            }
        }
        Ok(page(&[report]))
    })
}

/// A system in Python that draws itself.
struct PythonPainter<'a> {
    target: &'a PyTarget,
    painter: &'a Py<PyAny>,
}

impl Painter for PythonPainter<'_> {
    fn begin(&mut self, samples: &[usize]) {
        let started = Python::attach(|py| self.painter.call_method1(py, "begin", (samples,)).map(drop));
        if let Err(exception) = started {
            keep(&self.target.pending, exception);
        }
    }

    fn take(&mut self) -> Result<Vec<Vec<u8>>, String> {
        let taken: PyResult<_> = Python::attach(|py| {
            let pictures = self.painter.call_method0(py, "take")?;
            let pictures: Vec<PyBackedBytes> = pictures.extract(py)?;
            Ok(pictures.iter().map(|pixels| pixels.to_vec()).collect())
        });
        // A renderer that fails, without a display for instance, costs the pictures alone.
        taken.map_err(|exception| problem(self.target, exception))
    }
}

/// A system in Python that says where its bodies are.
struct PythonMover<'a> {
    target: &'a PyTarget,
    mover: &'a Py<PyAny>,
}

impl Mover for PythonMover<'_> {
    fn begin(&mut self) {
        let started = Python::attach(|py| self.mover.call_method0(py, "begin").map(drop));
        if let Err(exception) = started {
            keep(&self.target.pending, exception);
        }
    }

    fn take(&mut self) -> Result<(String, Vec<Vec<f64>>), String> {
        let taken: PyResult<_> = Python::attach(|py| {
            let taken = self.mover.call_method0(py, "take")?;
            let (scene, poses): (String, PyReadonlyArray2<'_, f64>) = taken.extract(py)?;
            Ok((scene, poses.as_array().rows().into_iter().map(|row| row.to_vec()).collect()))
        });
        taken.map_err(|exception| problem(self.target, exception))
    }
}

/// Returns the text of an exception, and keeps one that must end the page: a mistake of the caller,
/// or one that ends programs.
fn problem(target: &PyTarget, exception: PyErr) -> String {
    let must_end = Python::attach(|py| {
        exception.is_instance_of::<MishandleError>(py) || !exception.is_instance_of::<PyException>(py)
    });
    if must_end { keep(&target.pending, exception).to_string() } else { exception.to_string() }
}

/// Steps of a survival curve, numbers of simulations at which trials were censored, and number of
/// trials.
type Survival = (Vec<(u32, f64)>, Vec<u32>, usize);

/// Returns the survival curve of the trials of a run.
#[pyfunction]
pub fn survival(py: Python<'_>, path: PathBuf) -> PyResult<Survival> {
    let found = py.detach(|| answer_of_run(&RunFile::open(&path)?, None)).map_err(raised)?;
    let found = Falsification::try_from(found).map_err(|error| raised(Error::from(error)))?;
    let lifetimes = lifetimes(&found.trials, found.budget);
    let curve = SurvivalCurve::new(&lifetimes);
    let steps = std::iter::once((0, 1.0))
        .chain(curve.steps.iter().map(|step| (step.simulations, curve.at(step.simulations))))
        .chain([(curve.last, curve.at(curve.last))]);
    let censored = lifetimes.iter().filter(|life| !life.failed).map(|life| life.simulations);
    Ok((steps.collect(), censored.collect(), lifetimes.len()))
}

/// Returns a failing simulation of a run as the text of a counterexample file.
#[pyfunction]
pub fn counterexample(py: Python<'_>, path: PathBuf, trial: u32, number: u32) -> PyResult<String> {
    let read = || Ok(Counterexample::from_run(&RunFile::open(&path)?, trial, number)?.to_json());
    py.detach(read).map_err(|error: Error| raised(error))
}

/// A document, and path and text of each file to write.
type Exported = (String, Vec<(PathBuf, String)>);

/// Returns the representatives of the failure modes of a run as counterexamples in `folder`,
/// minimized with the target if the call says so. The physics of a target of MuJoCo C is checked.
#[pyfunction]
#[pyo3(signature = (path, folder, call, *, target))]
pub fn export(
    py: Python<'_>,
    path: PathBuf,
    folder: PathBuf,
    call: &str,
    target: Option<&PyTarget>,
) -> PyResult<Exported> {
    let RegressSettings { minimize, budget, .. } = settings(call)?.regress;
    if minimize && target.is_none() {
        return Err(MishandleError::new_err(
            "a copy of a result does not know its system; minimize with the result itself",
        ));
    }
    let exported = |resolved: Option<&ResolvedPlan>, watch: &dyn Fn() -> ControlFlow<()>| {
        let run = RunFile::open(&path)?;
        let chosen = mishandle::counterexample::representatives(&run, &folder)?;
        let minimize = minimize.then_some(budget.into());
        let preparation = resolved.map(|resolved| Preparation { resolved, minimize });
        mishandle::counterexample::export(&run, chosen, preparation, |_| watch())
    };
    let found = match target {
        Some(target) if minimize || !target.target.solver_variants.is_empty() => {
            detached(py, target, || {
                let resolved = recorded(target, &RunFile::open(&path)?)?;
                exported(Some(&resolved), &|| work::report(target, None, 0, 0))
            })?
        }
        _ => py
            .detach(|| {
                let run = RunFile::open(&path)?;
                let has_physics = mishandle::resolve::has_scene(&run.header().target.kind);
                let resolved =
                    has_physics.then(|| mishandle::resolve::recorded_plan(run.header(), None)).transpose()?;
                exported(resolved.as_ref(), &|| ControlFlow::Continue(()))
            })
            .map_err(raised)?,
    };
    let text = |(path, found): (PathBuf, Counterexample)| (path, found.to_json());
    Ok((json(&found.result)?, found.files.into_iter().map(text).collect()))
}

/// Simulates the counterexamples of a folder with a target, and with the target of a baseline, each
/// `repeats` times with other seeds. Returns the document, and the report as JUnit XML.
#[pyfunction]
#[pyo3(signature = (target, folder, *, baseline, repeats))]
pub fn regress(
    py: Python<'_>,
    target: &PyTarget,
    folder: PathBuf,
    baseline: Option<&PyTarget>,
    repeats: u64,
) -> PyResult<(String, String)> {
    let max_failure_rate = target.settings.regress.max_failure_rate;
    let tested =
        Tested::Target { target: &target.target, baseline: baseline.map(|baseline| &baseline.target) };
    let suite = Suite { folder: &folder, tested, repeats, max_failure_rate };
    let found = detached(py, target, || {
        let read = Error::file(&folder);
        let mut tests = Vec::new();
        let mut times = Vec::new();
        for file in suite.files().map_err(read)? {
            let start = Instant::now();
            tests.push(suite.test(&file, |_| work::report(target, None, 0, 0)));
            times.push(start.elapsed());
        }
        Ok((suite.result(tests, true), times))
    });
    // An exception of the system of the baseline is its own.
    if let Some(exception) = baseline.and_then(PyTarget::take_exception) {
        return Err(exception);
    }
    let (found, times) = found?;
    Ok((json(&found)?, mishandle_cli::junit(&found, &times)))
}
