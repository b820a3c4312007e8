//! Shipped controllers and controllers in files.

use std::sync::{Mutex, PoisonError};

use mishandle::rollout::{Controller, ControllerWorker};
use numpy::{IntoPyArray, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::{InvalidValueError, raised};

/// A learned policy. It is deterministic: its actions are the means.
#[pyclass(frozen, module = "mishandle._native", name = "Controller")]
pub struct PyController {
    worker: Mutex<Box<dyn ControllerWorker>>,
    sizes: (usize, usize),
    task: String,
    hash: String,
}

#[pymethods]
impl PyController {
    #[new]
    fn new(name: &str) -> PyResult<Self> {
        let file = mishandle::find_controller(name).and_then(|found| found.controller()).map_err(raised)?;
        let policy = file.policy;
        Ok(PyController {
            worker: Mutex::new(policy.worker()),
            sizes: (policy.observation_size(), policy.action_size()),
            task: file.header.task,
            hash: policy.hash(),
        })
    }

    #[getter]
    fn task(&self) -> &str {
        &self.task
    }

    #[getter]
    fn hash(&self) -> &str {
        &self.hash
    }

    #[getter]
    fn observation_size(&self) -> usize {
        self.sizes.0
    }

    #[getter]
    fn action_size(&self) -> usize {
        self.sizes.1
    }

    /// Returns one action per row of observations.
    fn act<'py>(
        &self,
        py: Python<'py>,
        observations: PyReadonlyArray2<'py, f32>,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let (observation_size, action_size) = self.sizes;
        let (rows, found) = observations.as_array().dim();
        if found != observation_size {
            let message =
                format!("an observation has {found} numbers; the controller takes {observation_size}");
            return Err(InvalidValueError::new_err(message));
        }
        let observations: Vec<f32> = observations.as_array().iter().copied().collect();
        let actions = py.detach(|| {
            let mut actions = vec![0.0; rows * action_size];
            let mut worker = self.worker.lock().unwrap_or_else(PoisonError::into_inner);
            worker.act(rows, &observations, &mut [], &mut actions);
            actions
        });
        actions.into_pyarray(py).reshape([rows, action_size])
    }
}
