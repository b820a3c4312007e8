//! Monitors that get one sample after the other.

use mishandle::stl::{Formula, OnlineMonitor};
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyUntypedArray};
use pyo3::PyTypeInfo;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyFloat, PyList, PyString, PyTuple};

use crate::formula::{PyFormula, clock};
use crate::{InvalidTypeError, InvalidValueError, plain};

/// An online monitor and the sample that Python passes. `mishandle.OnlineMonitor` is a subclass, so
/// that a push is one call.
#[pyclass(subclass, module = "mishandle._native", name = "OnlineMonitor")]
pub struct PyOnlineMonitor {
    monitor: OnlineMonitor,
    formulas: usize,
    names: Vec<Py<PyString>>,
    sample: Vec<f64>,
}

#[pymethods]
impl PyOnlineMonitor {
    #[new]
    #[pyo3(signature = (formulas, signals, period, samples))]
    fn new(
        py: Python<'_>,
        formulas: Vec<Py<PyFormula>>,
        signals: Vec<String>,
        period: Option<f64>,
        samples: Option<usize>,
    ) -> PyResult<Self> {
        let formulas: Vec<Formula> = formulas.iter().map(|formula| formula.get().formula.clone()).collect();
        let monitor = OnlineMonitor::new(&formulas, &signals, clock(period)?, samples).map_err(plain)?;
        Ok(PyOnlineMonitor {
            monitor,
            formulas: formulas.len(),
            names: signals.iter().map(|name| PyString::intern(py, name).unbind()).collect(),
            sample: vec![0.0; signals.len()],
        })
    }

    #[getter]
    fn signals(&self, py: Python<'_>) -> Vec<Py<PyString>> {
        self.names.iter().map(|name| name.clone_ref(py)).collect()
    }

    /// Adds a sample.
    fn push(&mut self, sample: &Bound<'_, PyAny>) -> PyResult<()> {
        // The usual types first: reading an array costs as much as ten numbers of a tuple.
        if let Ok(values) = sample.cast_exact::<PyTuple>() {
            self.read(values.len(), values.iter())?;
        } else if let Ok(values) = sample.cast_exact::<PyList>() {
            self.read(values.len(), values.iter())?;
        } else if let Ok(value) = sample.cast_exact::<PyFloat>() {
            self.check_length(1)?;
            self.sample[0] = value.value();
        } else if let Ok(values) = sample.cast::<PyDict>() {
            self.read_dictionary(values)?;
        } else if sample.get_type().is(PyUntypedArray::type_object(sample.py()))
            && let Ok(values) = sample.extract::<PyReadonlyArray1<'_, f64>>()
        {
            // An array of another class can have more than data, such as a mask.
            let values = values.as_array();
            self.check_length(values.len())?;
            self.sample.iter_mut().zip(values).for_each(|(target, value)| *target = *value);
        } else {
            // Names count before places; Python knows the types of other packages.
            let py = sample.py();
            let values =
                py.import("mishandle.logs.online")?.call_method1("values_of", (sample, self.signals(py)))?;
            let values = values.extract::<Vec<Bound<'_, PyAny>>>()?;
            self.read(values.len(), values.iter())?;
        }
        self.monitor.push(&self.sample).map_err(plain)
    }

    /// Adds the rows of an array.
    fn push_many(&mut self, py: Python<'_>, samples: PyReadonlyArray2<'_, f64>) -> PyResult<()> {
        let samples = samples.as_array();
        self.check_length(samples.ncols())?;
        py.detach(|| {
            for row in samples.rows() {
                self.sample.iter_mut().zip(row).for_each(|(target, value)| *target = *value);
                self.monitor.push(&self.sample)?;
            }
            Ok::<(), mishandle::stl::MonitorError>(())
        })
        .map_err(plain)
    }

    /// Returns the least and the greatest robustness at the first sample over all continuations.
    #[pyo3(signature = (formula = 0))]
    fn bounds(&mut self, formula: usize) -> PyResult<(f64, f64)> {
        let bounds = self.monitor.bounds(self.index(formula)?);
        Ok((bounds.low, bounds.high))
    }

    /// Returns the verdict at the first sample, or `None` while it depends on later samples.
    #[pyo3(signature = (formula = 0))]
    fn verdict(&mut self, formula: usize) -> PyResult<Option<bool>> {
        Ok(self.monitor.verdict(self.index(formula)?))
    }

    /// Returns the sample that the last push decided and its robustness, or `None`.
    #[pyo3(signature = (formula = 0))]
    fn decided(&mut self, formula: usize) -> PyResult<Option<(usize, f64)>> {
        Ok(self.monitor.decided(self.index(formula)?))
    }

    /// Forgets all samples.
    fn reset(&mut self) {
        self.monitor.reset();
    }

    fn __len__(&self) -> usize {
        self.monitor.len()
    }
}

impl PyOnlineMonitor {
    fn index(&self, formula: usize) -> PyResult<usize> {
        if formula < self.formulas {
            return Ok(formula);
        }
        let formulas = self.formulas;
        Err(InvalidValueError::new_err(format!(
            "the monitor has {formulas} formulas; the index is {formula}"
        )))
    }

    fn check_length(&self, found: usize) -> PyResult<()> {
        let expected = self.sample.len();
        if found == expected {
            return Ok(());
        }
        Err(InvalidValueError::new_err(format!(
            "a sample must have {expected} values, one per signal; got {found}"
        )))
    }

    /// Copies numbers of Python into the sample.
    fn read<'py>(
        &mut self,
        length: usize,
        values: impl Iterator<Item = impl std::borrow::Borrow<Bound<'py, PyAny>>>,
    ) -> PyResult<()> {
        self.check_length(length)?;
        for (target, value) in self.sample.iter_mut().zip(values) {
            *target = number(value.borrow())?;
        }
        Ok(())
    }

    fn read_dictionary(&mut self, values: &Bound<'_, PyDict>) -> PyResult<()> {
        let py = values.py();
        for (target, name) in self.sample.iter_mut().zip(&self.names) {
            let Some(value) = values.get_item(name.bind(py))? else {
                return Err(InvalidValueError::new_err(format!(
                    "the sample lacks the signal {}",
                    name.bind(py)
                )));
            };
            *target = number(&value)?;
        }
        Ok(())
    }
}

fn number(value: &Bound<'_, PyAny>) -> PyResult<f64> {
    value
        .extract()
        .map_err(|_| InvalidTypeError::new_err(format!("a value of a sample is no number: {value}")))
}
