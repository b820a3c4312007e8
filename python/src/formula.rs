//! Formulas and their robustness on traces.

use std::sync::Arc;

use mishandle::stl::{Bounds, Clock, Formula, Monitor, MonitorError, OnlineMonitor, Trace, spelled};
use numpy::ndarray::ArrayView2;
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::{InvalidValueError, plain};

/// A node of the syntax tree: operator, window in samples, positions of the operands, and sides of
/// a comparison.
type Node = (Option<&'static str>, Option<(usize, Option<usize>)>, Vec<usize>, Option<[String; 2]>);

/// A parsed formula.
#[pyclass(frozen, module = "mishandle._native", name = "Formula")]
pub struct PyFormula {
    pub(crate) formula: Formula,
}

#[pymethods]
impl PyFormula {
    #[new]
    fn new(text: &str) -> PyResult<Self> {
        Ok(PyFormula { formula: Formula::parse(text).map_err(plain)? })
    }

    #[getter]
    fn signals(&self) -> Vec<String> {
        self.formula.signals().into_iter().map(String::from).collect()
    }

    #[getter]
    fn subformulas(&self) -> Vec<String> {
        self.formula.subformulas().collect()
    }

    #[getter]
    fn symbols(&self) -> String {
        self.formula.symbols().to_string()
    }

    #[getter]
    fn chains_comparisons(&self) -> bool {
        self.formula.chains_comparisons()
    }

    #[getter]
    fn unused_definitions(&self) -> Vec<String> {
        self.formula.unused_definitions().into_iter().map(String::from).collect()
    }

    /// Whether a bound is a time, so that samples need a period.
    #[getter]
    fn needs_period(&self) -> bool {
        self.formula.needs_period(false)
    }

    /// Checks the names of a trace, and returns a hint if it lacks signals of the formula.
    fn hint(&self, names: Vec<String>) -> PyResult<Option<String>> {
        match self.formula.check_names(&names) {
            Ok(()) => Ok(None),
            Err(error @ MonitorError::UnknownSignal { .. }) => Ok(error.hint()),
            Err(error) => Err(plain(error)),
        }
    }

    /// Returns the syntax tree, in the order of `subformulas`.
    fn nodes(&self, period: Option<f64>) -> PyResult<Vec<Node>> {
        let nodes = self.formula.subformula_nodes(&clock(period)?).map_err(plain)?;
        Ok(nodes.into_iter().map(|node| (node.operator, node.window, node.operands, node.sides)).collect())
    }

    fn __str__(&self) -> String {
        self.formula.to_string()
    }

    /// Returns the robustness at each sample of a trace with samples by signals.
    fn robustness_signal<'py>(
        &self,
        py: Python<'py>,
        names: Vec<String>,
        samples: PyReadonlyArray2<'py, f64>,
        period: Option<f64>,
        decided_only: bool,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let trace = trace(names.into(), samples.as_array());
        let mut monitor = Monitor::new(&self.formula, trace.names(), clock(period)?).map_err(plain)?;
        let found = py.detach(|| {
            if decided_only {
                monitor.decided_robustness_signal(&trace).map(<[f64]>::to_vec)
            } else {
                monitor.robustness_signal(&trace).map(<[f64]>::to_vec)
            }
        });
        Ok(found.map_err(plain)?.into_pyarray(py))
    }

    /// Returns the least and the greatest robustness at the first sample over all continuations of
    /// a trace that decide the formula.
    fn robustness_bounds(
        &self,
        py: Python<'_>,
        names: Vec<String>,
        samples: PyReadonlyArray2<'_, f64>,
        period: Option<f64>,
    ) -> PyResult<(f64, f64)> {
        let trace = trace(names.into(), samples.as_array());
        if trace.is_empty() {
            return Err(plain(MonitorError::EmptyTrace));
        }
        let formulas = std::slice::from_ref(&self.formula);
        let mut monitor = OnlineMonitor::new(formulas, trace.names(), clock(period)?, None).map_err(plain)?;
        monitor.state_samples(Some(monitor.needed_samples(0).0));
        py.detach(|| monitor.push_trace(&trace, 0..trace.len())).map_err(plain)?;
        let Bounds { low, high } = monitor.bounds(0);
        Ok((low, high))
    }
}

/// Returns a name as formulas spell it.
#[pyfunction(name = "spelled")]
pub fn spelled_name(name: &str) -> String {
    spelled(name).into_owned()
}

/// Returns the clock of a period in seconds, or of samples alone.
pub(crate) fn clock(period: Option<f64>) -> PyResult<Clock> {
    let Some(period) = period else { return Ok(Clock::unknown()) };
    if period.is_finite() && period > 0.0 {
        return Ok(Clock::steps(period));
    }
    Err(InvalidValueError::new_err(format!(
        "the sampling period is {period} s; it must be positive and finite"
    )))
}

/// Copies samples by signals.
pub(crate) fn trace(names: Arc<[String]>, samples: ArrayView2<'_, f64>) -> Trace {
    let (rows, columns) = samples.dim();
    let mut trace = Trace::with_capacity(names, rows);
    let mut sample = vec![0.0; columns];
    for row in samples.rows() {
        sample.iter_mut().zip(row).for_each(|(value, found)| *value = *found);
        trace.push(&sample);
    }
    trace
}
