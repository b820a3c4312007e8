//! Reading of run files.

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use mishandle::MishandleError;
use mishandle::plan::{ReportSettings, Settings};
use mishandle::replay::replay_command;
use mishandle::store::RunFile;
use mishandle_cli::words::shell_command;
use mishandle_report::{Measurement, RunReport, Samples, page};
use numpy::PyArray2;
use numpy::ndarray::Array2;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use crate::call::settings;
use crate::raised;
use crate::work::{json, signals};

/// Why a page has no simulations.
pub(crate) const NOT_SIMULATED: &str = "plan[\"report\"][\"simulations\"] is False";

/// A run file opened for reading.
#[pyclass(frozen, module = "mishandle._native", name = "Run")]
pub struct PyRun {
    run: Mutex<RunFile>,
}

#[pymethods]
impl PyRun {
    #[new]
    fn new(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let run = py.detach(|| RunFile::open(path)).map_err(raised)?;
        Ok(PyRun { run: Mutex::new(run) })
    }

    /// Returns the facts of the header.
    fn header<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let run = self.run.lock().unwrap_or_else(PoisonError::into_inner);
        let header = run.header();
        let dict = PyDict::new(py);
        for (name, text) in [
            ("target", &header.target.name),
            ("kind", &header.target.kind),
            ("space", &header.space),
            ("formula", &header.formula),
            ("search", &header.search),
            ("plan", &header.plan),
        ] {
            dict.set_item(name, text)?;
        }
        dict.set_item("seed", header.seed)?;
        dict.set_item("control_dt", header.control_dt)?;
        dict.set_item("steps", header.episode_steps)?;
        let axis = |axis: &mishandle::store::AxisRecord| {
            (axis.name.clone(), axis.unit.clone(), axis.low, axis.high, axis.values.clone())
        };
        dict.set_item("axes", header.axes.iter().map(axis).collect::<Vec<_>>())?;
        let signal = |signal: &mishandle::store::SignalRecord| (signal.name.clone(), signal.unit.clone());
        dict.set_item("signals", header.signals.iter().map(signal).collect::<Vec<_>>())?;
        let build = &header.build;
        let started = format!("mishandle {} ({})", build.program_version, build.git_commit);
        let continued = mishandle::run::continued_builds(header).map(|(_, build)| build.to_string());
        dict.set_item("builds", std::iter::once(started).chain(continued).collect::<Vec<_>>())?;
        let uncovered = header.components.iter().filter(|component| component.is_not_covered());
        let uncovered: Vec<&str> = uncovered.map(|component| component.name.as_str()).collect();
        dict.set_item("not_covered", uncovered)?;
        Ok(dict)
    }

    /// Returns the columns of all simulations: one list per column.
    fn simulations<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let run = self.run.lock().unwrap_or_else(PoisonError::into_inner);
        let header = run.header();
        let fixed = ["trial", "number", "seed", "robustness", "end", "steps"];
        let names = fixed.into_iter().map(String::from);
        let names = names
            .chain(header.axes.iter().map(|axis| axis.name.clone()))
            .chain(header.verdicts.iter().cloned());
        let columns: Vec<(String, Bound<'py, PyList>)> =
            names.map(|name| (name, PyList::empty(py))).collect();
        for simulation in run.simulations() {
            let found = simulation.map_err(raised)?;
            columns[0].1.append(found.trial)?;
            columns[1].1.append(found.number)?;
            columns[2].1.append(found.seed)?;
            columns[3].1.append(found.robustness)?;
            columns[4].1.append(found.end.name())?;
            columns[5].1.append(found.steps)?;
            let values = found.scenario.iter().chain(&found.verdicts);
            for ((_, column), value) in columns[fixed.len()..].iter().zip(values) {
                column.append(*value)?;
            }
        }
        let dict = PyDict::new(py);
        for (name, column) in columns {
            dict.set_item(name, column)?;
        }
        Ok(dict)
    }

    /// Returns the stored trace of a simulation, samples by signals; `None` if it is not stored.
    fn trace<'py>(
        &self,
        py: Python<'py>,
        trial: u32,
        number: u32,
    ) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        let run = self.run.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(trace) = run.simulation(trial, number).map_err(raised)?.trace else {
            return Ok(None);
        };
        let shape = (trace.columns.first().map_or(0, Vec::len), trace.columns.len());
        let samples = Array2::from_shape_fn(shape, |(sample, signal)| trace.columns[signal][sample]);
        Ok(Some(PyArray2::from_owned_array(py, samples)))
    }

    /// Returns the document of an explanation, with a failure at nominal on each of some axes
    /// alone. A simulation without a stored trace is simulated again, which only works for
    /// systems that this program knows. The file is read once more: a simulation gives other
    /// threads of Python their turn, and they may wait for this run.
    fn explain(&self, py: Python<'_>, trial: u32, number: u32, call: &str) -> PyResult<String> {
        let Settings { engine, report, .. } = settings(call)?;
        let path = self.run.lock().unwrap_or_else(PoisonError::into_inner).path().to_path_buf();
        let mut exception = None;
        let explained = py.detach(|| -> Result<_, MishandleError> {
            let run = RunFile::open(path)?;
            let explained = mishandle::inspect::explain(&run, trial, number, engine.moved())?;
            let mut found = explained.result(run.header(), Some(&run.path().to_string_lossy()));
            let resolve = || {
                let resolved = mishandle::resolve::recorded_plan(run.header(), engine.moved());
                resolved.map_err(|error| error.to_string())
            };
            let watch = |_, _| signals(&mut exception);
            found.axes_at_nominal = mishandle::inspect::axes_at_nominal(
                Some(&run),
                run.header(),
                &explained,
                resolve,
                report.axes,
                watch,
            )?;
            Ok(found)
        });
        match exception {
            Some(exception) => Err(exception),
            None => json(&explained.map_err(raised)?),
        }
    }

    /// Returns the document of the failure modes.
    fn failure_modes(&self, py: Python<'_>) -> PyResult<String> {
        let found = py.detach(|| {
            let run = self.run.lock().unwrap_or_else(PoisonError::into_inner);
            let modes = mishandle::inspect::failure_modes(&run)?;
            mishandle::inspect::counterexamples_result(&run, &modes)
        });
        json(&found.map_err(|error: MishandleError| raised(error))?)
    }

    /// Returns a report as HTML.
    fn report(&self, py: Python<'_>, call: &str) -> PyResult<String> {
        let contents = contents_of(call)?;
        py.detach(|| {
            let run = self.run.lock().unwrap_or_else(PoisonError::into_inner);
            let report = run_report(&run, None, contents)?;
            Ok(page(&[report]))
        })
        .map_err(|error: MishandleError| raised(error))
    }
}

/// The simulated parts of a page.
#[derive(Clone, Copy)]
pub(crate) struct Contents {
    pub samples: Samples,
    /// Whether it has a 3-D replay.
    pub has_replay: bool,
}

/// Returns what a page simulates by the settings of a call; `None`: nothing.
pub(crate) fn contents_of(call: &str) -> PyResult<Option<Contents>> {
    let ReportSettings { simulations, probes, sensitivity, repeats, replay, .. } = settings(call)?.report;
    let samples = Samples { probes, sensitivity, repeats };
    Ok(simulations.then_some(Contents { samples, has_replay: replay }))
}

/// Returns the report of a run. Without `contents`, nothing is simulated.
pub(crate) fn run_report(
    run: &RunFile,
    controller: Option<&str>,
    contents: Option<Contents>,
) -> Result<RunReport, MishandleError> {
    let mut report = RunReport::load(run, &run.path().to_string_lossy(), None, shell_command)?;
    let measured = match contents {
        Some(Contents { samples, .. }) => {
            report.measure(run, controller, samples, |_, _| ControlFlow::Continue(()))?
        }
        None => Measurement::Skipped { reason: NOT_SIMULATED.to_string() },
    };
    if let Measurement::Skipped { reason } = &measured {
        report.note_no_simulations(reason);
    } else if contents.is_some_and(|contents| contents.has_replay) {
        let watch = |_, _| ControlFlow::Continue(());
        if let Err(error) = report.record_replay(
            run,
            controller,
            None,
            |(trial, number)| replay_text(run, trial, number),
            watch,
        ) {
            report.note_no_replay(&error);
        }
    }
    Ok(report)
}

/// Returns what simulates a simulation of a run again.
pub(crate) fn replay_text(run: &RunFile, trial: u32, number: u32) -> String {
    shell_command(&replay_command(&run.header().target.kind, run.path(), trial, number))
}
