//! Images in the observation of an environment: their axes, and what cameras of a task see.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use mishandle::camera::Size;
use mishandle::picture::{CameraSettings, SeenEpisode, TargetCameras};
use mishandle::rollout::{Axis, Scenario, Seed, Space};
use mishandle::sight::{ImageFeed, Sight};
use numpy::{IntoPyArray, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadwriteArray3};
use pyo3::prelude::*;

use crate::target::{SPACE, document};
use crate::work::json;
use crate::{InvalidValueError, raised};

/// Returns a scenario with some values by name, the others nominal.
fn scenario(space: &Space, values: &BTreeMap<String, f64>) -> Scenario {
    let value = |axis: &Axis| values.get(&axis.name).copied().or(axis.nominal);
    space.canonical(Scenario::new(space.axes().iter().map(value).collect()))
}

/// Returns the axes of each space of a sight, with the name of the space.
fn named_axes(sight: &Sight) -> PyResult<String> {
    let spaces = sight.spaces().map_err(raised)?;
    let named =
        |space: &Space| space.axes().iter().map(|axis| (space.name().to_string(), document(axis))).collect();
    json(&spaces.iter().flat_map(|space| -> Vec<_> { named(space) }).collect::<Vec<_>>())
}

/// The images in the observations of one environment: their axes, and their effect on each episode.
#[pyclass(frozen, module = "mishandle._native")]
pub struct Images {
    sight: Sight,
    sizes: Vec<Size>,
    space: Space,
}

#[pymethods]
impl Images {
    /// Makes the axes of images with these names, widths and heights.
    #[new]
    #[pyo3(signature = (cameras, *, control_dt, episode_steps))]
    fn new(cameras: Vec<(String, usize, usize)>, control_dt: f64, episode_steps: usize) -> PyResult<Images> {
        let size = |(_, width, height): &(String, usize, usize)| Size::new(*width, *height);
        let sizes = cameras.iter().map(size).collect::<Result<_, _>>();
        let sizes = sizes.map_err(|error| InvalidValueError::new_err(error.to_string()))?;
        let names = cameras.into_iter().map(|(name, ..)| name).collect();
        let sight = Sight::of_images(names, control_dt, episode_steps);
        let axes = sight.axes().cloned().collect();
        let space = Space::new(SPACE, axes).map_err(raised)?;
        Ok(Images { sight, sizes, space })
    }

    /// The axes, each with the name of its space.
    #[getter]
    fn axes(&self) -> PyResult<String> {
        named_axes(&self.sight)
    }

    /// Names of the axes that make an episode depend on its seed.
    #[getter]
    fn random_axes(&self) -> Vec<String> {
        self.sight.random_axes().map(ToString::to_string).collect()
    }

    /// Starts an episode with some values by name, the others nominal; `None` if all are.
    fn start(&self, values: BTreeMap<String, f64>, seed: u64) -> PyResult<Option<ActiveImages>> {
        let scenario = scenario(&self.space, &values);
        if scenario.is_same(&self.space.nominal()) {
            return Ok(None);
        }
        let feed = ImageFeed::new(&self.sight, &self.sizes, &self.space, &scenario, Seed(seed));
        Ok(Some(ActiveImages(feed.map_err(raised)?)))
    }
}

/// The images of one episode. Control steps count from 0.
#[pyclass(module = "mishandle._native")]
pub struct ActiveImages(ImageFeed);

#[pymethods]
impl ActiveImages {
    /// Replaces the images of a control step, one of each camera, by those that the policy sees.
    fn observe(&mut self, step: usize, mut images: Vec<PyReadwriteArray3<'_, u8>>) -> PyResult<()> {
        let mut slices = Vec::with_capacity(images.len());
        for image in &mut images {
            slices.push(image.as_slice_mut()?);
        }
        self.0.next(step, &mut slices);
        Ok(())
    }
}

/// Returns the axes of sight of a task, each with the name of its space.
#[pyfunction]
pub fn task_sight_axes(task: &str) -> PyResult<String> {
    let task = mishandle::resolve::task(task).map_err(raised)?;
    named_axes(&mishandle::tasks::sight::sight(task.definition()))
}

/// Cameras of a task, which draw states of one episode after the other.
#[pyclass(frozen, module = "mishandle._native")]
pub struct TaskCameras {
    space: Space,
    state: Mutex<(TargetCameras, Option<SeenEpisode>)>,
}

#[pymethods]
impl TaskCameras {
    #[new]
    fn new(task: &str, names: Vec<String>, width: u16, height: u16) -> PyResult<TaskCameras> {
        let definition = mishandle::resolve::task(task).map_err(raised)?.definition();
        let axes = mishandle::tasks::sight::sight(definition).axes().cloned().collect();
        let space = Space::new(SPACE, axes).map_err(raised)?;
        let settings = CameraSettings { names, size: [width, height] };
        let cameras = TargetCameras::new(task, &space, &settings).map_err(raised)?;
        Ok(TaskCameras { space, state: Mutex::new((cameras, None)) })
    }

    /// Starts an episode with some values of axes of sight by name, the others nominal.
    fn start(
        &self,
        state: PyReadonlyArray1<'_, f64>,
        values: BTreeMap<String, f64>,
        seed: u64,
    ) -> PyResult<()> {
        if let Some(name) =
            values.keys().find(|name| self.space.axes().iter().all(|axis| axis.name != **name))
        {
            return Err(InvalidValueError::new_err(format!("there is no axis of sight `{name}`")));
        }
        let scenario = scenario(&self.space, &values);
        self.space.check(&scenario).map_err(raised)?;
        let (cameras, seen) = &mut *self.state.lock().unwrap_or_else(PoisonError::into_inner);
        *seen = cameras.start(&[state.as_slice()?.to_vec()], &scenario, Seed(seed)).map_err(raised)?;
        Ok(())
    }

    /// Draws a state of the episode: one array of the shape (height, width, 3) for each camera.
    fn images<'py>(
        &self,
        py: Python<'py>,
        state: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Vec<Bound<'py, PyArray3<u8>>>> {
        let state = [state.as_slice()?.to_vec()];
        let drawn = py.detach(|| {
            let (cameras, seen) = &mut *self.state.lock().unwrap_or_else(PoisonError::into_inner);
            let [width, height] = cameras.size();
            let count = cameras.names().count();
            let image = |camera| Some(cameras.image(seen.as_ref()?, &state, camera, 0));
            ((0..count).filter_map(image).collect::<Vec<_>>(), [height, width, 3])
        });
        let (images, shape) = drawn;
        images.into_iter().map(|image| image.into_pyarray(py).reshape(shape)).collect()
    }
}
