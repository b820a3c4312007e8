//! Shipped controllers and controllers in files.

use std::path::Path;
use std::sync::{Mutex, PoisonError};

use mishandle::controllers::ControllerFile;
use mishandle::interchange::onnx_bytes;

use mishandle::rollout::{Controller, ControllerWorker};
use numpy::{IntoPyArray, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::{InvalidValueError, raised};

/// A learned policy. It is deterministic: its actions are the means.
#[pyclass(frozen, module = "mishandle._native", name = "Controller")]
pub struct PyController {
    worker: Mutex<Box<dyn ControllerWorker>>,
    sizes: (usize, usize),
    task: String,
    hash: String,
    /// Number of earlier control steps that the controller remembers.
    history: usize,
    /// The file of a controller of ours; an ONNX model has none.
    file: Option<ControllerFile>,
}

impl PyController {
    fn of(
        controller: &dyn Controller,
        task: String,
        hash: String,
        file: Option<ControllerFile>,
    ) -> PyController {
        PyController {
            worker: Mutex::new(controller.worker()),
            sizes: (controller.observation_size(), controller.action_size()),
            task,
            hash,
            history: file.as_ref().map_or(0, |file| file.policy.history().length()),
            file,
        }
    }

    fn onnx(name: &str, task: Option<&str>) -> PyResult<PyController> {
        let policy = mishandle::resolve::onnx_policy(Path::new(name), task).map_err(raised)?;
        if policy.state_size() > 0 {
            let message = "a recurrent ONNX model is not a function of the observation; run it with `mishandle evaluate` or \
                           `mishandle falsify TASK --controller FILE.onnx`";
            return Err(InvalidValueError::new_err(message));
        }
        let task = task.or(policy.task()).unwrap_or_default().to_string();
        Ok(Self::of(&policy, task, policy.hash().to_string(), None))
    }
}

#[pymethods]
impl PyController {
    #[new]
    #[pyo3(signature = (name, task=None))]
    fn new(name: &str, task: Option<&str>) -> PyResult<Self> {
        if mishandle::resolve::is_onnx(Path::new(name)) {
            return Self::onnx(name, task);
        }
        let file =
            mishandle::resolve::find_controller(name).and_then(|found| found.controller()).map_err(raised)?;
        if let Some(task) = task.filter(|task| *task != file.header.task) {
            let message = format!("the controller was trained for {}, not for {task}", file.header.task);
            return Err(InvalidValueError::new_err(message));
        }
        let policy = file.policy.clone();
        Ok(Self::of(&policy, file.header.task.clone(), policy.hash(), Some(file)))
    }

    /// Returns the bytes of an ONNX model of the controller.
    fn onnx_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let file =
            self.file.as_ref().ok_or_else(|| InvalidValueError::new_err("this is an ONNX model already"))?;
        Ok(PyBytes::new(py, &onnx_bytes(file, mishandle::build::VERSION)))
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
        if self.history > 0 {
            let message = format!(
                "the controller remembers its last {} observations and actions, so it is not a function of one observation; \
                 run it with `mishandle evaluate` or `mishandle falsify`, or export it with `to_onnx`, whose model returns \
                 what it remembers",
                self.history
            );
            return Err(InvalidValueError::new_err(message));
        }
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
