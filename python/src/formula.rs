//! Formulas and their robustness on traces.

use mishandle::stl::{Clock, Formula, Monitor, Trace};
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::plain;

/// A parsed formula.
#[pyclass(frozen, module = "mishandle._native", name = "Formula")]
pub struct PyFormula {
    formula: Formula,
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

    fn __str__(&self) -> String {
        self.formula.to_string()
    }

    /// Returns the robustness at each sample of a trace with samples by signals.
    fn robustness_signal<'py>(
        &self,
        py: Python<'py>,
        names: Vec<String>,
        samples: PyReadonlyArray2<'py, f64>,
        period: f64,
        decided_only: bool,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        if !(period.is_finite() && period > 0.0) {
            return Err(PyValueError::new_err(format!(
                "the sampling period is {period} s; it must be positive and finite"
            )));
        }
        let mut trace = Trace::with_capacity(names.into(), samples.as_array().nrows());
        for row in samples.as_array().rows() {
            trace.push(&row.to_vec());
        }
        let mut monitor = Monitor::new(&self.formula, trace.names(), Clock::steps(period)).map_err(plain)?;
        let found = py.detach(|| match decided_only {
            true => monitor.decided_robustness_signal(&trace).map(<[f64]>::to_vec),
            false => monitor.robustness_signal(&trace).map(<[f64]>::to_vec),
        });
        Ok(found.map_err(plain)?.into_pyarray(py))
    }
}
