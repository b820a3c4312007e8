//! Shipped controllers and controllers in files.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use mishandle::controllers::ControllerFile;
use mishandle::interchange::onnx_bytes;
use mishandle::resolve::is_onnx;
use mishandle::shipped::ShippedFile;

use mishandle::rollout::{Controller, ControllerWorker, Image, Seed};
use numpy::ndarray::Axis;
use numpy::{IntoPyArray, PyArray2, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray4};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::{InvalidStateError, InvalidValueError, raised};

/// A learned policy. It is deterministic: its actions are the means.
#[pyclass(frozen, module = "mishandle._native", name = "Controller")]
pub struct PyController {
    acting: Mutex<Acting>,
    sizes: (usize, usize),
    /// Images that it gets.
    sees: Vec<Image>,
    /// Length of what the controller remembers of one simulation.
    state_size: usize,
    task: String,
    hash: String,
    /// The file of a controller of ours; an ONNX model has none.
    file: Option<ControllerFile>,
}

/// The policy while it acts, and its memory of each row.
struct Acting {
    worker: Box<dyn ControllerWorker>,
    /// Empty at the start of an episode, before the first observations.
    states: Vec<f64>,
}

impl PyController {
    fn of(
        controller: &dyn Controller,
        task: String,
        hash: String,
        file: Option<ControllerFile>,
    ) -> PyController {
        PyController {
            acting: Mutex::new(Acting { worker: controller.worker(), states: Vec::new() }),
            sizes: (controller.observation_size(), controller.action_size()),
            sees: controller.sees().to_vec(),
            state_size: controller.state_size(),
            task,
            hash,
            file,
        }
    }

    fn onnx(file: &ShippedFile, task: Option<&str>) -> PyResult<PyController> {
        let policy = mishandle::resolve::onnx_policy(file, task).map_err(raised)?;
        let task = task.or(policy.task.as_deref()).unwrap_or_default().to_string();
        Ok(Self::of(&*policy.controller, task, policy.hash, None))
    }
}

#[pymethods]
impl PyController {
    #[new]
    #[pyo3(signature = (name, task=None))]
    fn new(name: &str, task: Option<&str>) -> PyResult<Self> {
        let found = mishandle::resolve::find_controller(name).map_err(raised)?;
        if is_onnx(Path::new(name)) {
            return Self::onnx(&found, task);
        }
        if is_onnx(found.path()) {
            // A shipped one: `TASK/NAME`.
            return Self::onnx(&found, task.or(name.split_once('/').map(|(own, _)| own)));
        }
        let file = found.controller().map_err(raised)?;
        if let Some(task) = task.filter(|task| *task != file.header.task) {
            let message = format!("the controller was trained for {}, not for {task}", file.header.task);
            return Err(InvalidValueError::new_err(message));
        }
        let task_name = file.header.task.clone();
        let policy: Arc<dyn Controller> = Arc::new(file.policy.clone());
        let controller = match mishandle::tasks::task(&task_name) {
            Some(task) => task
                .definition()
                .fit(policy, &file.header.layout, file.header.action_interface.as_ref())
                .map_err(raised)?,
            None => policy,
        };
        Ok(Self::of(&*controller, task_name, file.hash(), Some(file)))
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

    /// The images that it gets, in their order: name of the camera, width and height.
    #[getter]
    fn images(&self) -> Vec<(&str, usize, usize)> {
        self.sees.iter().map(|image| (image.camera.as_str(), image.width, image.height)).collect()
    }

    /// Whether actions depend on earlier observations.
    #[getter]
    fn is_recurrent(&self) -> bool {
        self.state_size > 0
    }

    /// Starts episodes: forgets all rows.
    fn reset(&self) {
        self.acting.lock().unwrap_or_else(PoisonError::into_inner).states.clear();
    }

    /// Returns one action per row of observations and images, and remembers them if it is
    /// recurrent. Each array of images has the shape (rows, height, width, 3).
    fn act<'py>(
        &self,
        py: Python<'py>,
        observations: PyReadonlyArray2<'py, f32>,
        images: Vec<PyReadonlyArray4<'py, u8>>,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let (observation_size, action_size) = self.sizes;
        let (rows, found) = observations.as_array().dim();
        if found != observation_size {
            let message =
                format!("an observation has {found} numbers; the controller takes {observation_size}");
            return Err(InvalidValueError::new_err(message));
        }
        let shapes = self.sees.iter().map(|image| (rows, image.height, image.width, 3));
        if !images.iter().map(|images| images.as_array().dim()).eq(shapes) {
            return Err(InvalidValueError::new_err(
                "the images have other shapes than those of the controller",
            ));
        }
        let seen = (0..rows).flat_map(|row| images.iter().map(move |images| (row, images)));
        let seen: Vec<u8> = seen
            .flat_map(|(row, images)| images.as_array().index_axis_move(Axis(0), row).into_iter().copied())
            .collect();
        let observations: Vec<f32> = observations.as_array().iter().copied().collect();
        let size = self.state_size;
        let acted = py.detach(|| {
            let mut acting = self.acting.lock().unwrap_or_else(PoisonError::into_inner);
            let Acting { worker, states } = &mut *acting;
            if size > 0 && states.is_empty() {
                states.resize(rows * size, 0.0);
                // Mean actions draw nothing, so the seed does not matter.
                states.chunks_exact_mut(size).for_each(|state| worker.reset(state, Seed(0)));
            } else if states.len() != rows * size {
                return Err(states.len() / size);
            }
            let mut actions = vec![0.0; rows * action_size];
            worker.look(rows, &seen);
            worker.act(rows, &observations, states, &mut actions);
            Ok(actions)
        });
        let actions = acted.map_err(|remembered| {
            InvalidStateError::new_err(format!(
                "the controller remembers {remembered} rows of observations, but {rows} were given: call `reset()` at the start of \
                 each episode"
            ))
        })?;
        actions.into_pyarray(py).reshape([rows, action_size])
    }
}
