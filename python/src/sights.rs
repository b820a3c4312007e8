//! Scenes and cameras of a task, as numbers for the kernels of `mishandle.gpu.cameras`, and as
//! images that the CPU draws.

use std::collections::BTreeMap;

use mishandle::camera::{
    Camera, CameraError, ClothRows, Output, Pose, PoseReader, Poses, SightRow, Size, StateShot, Studio,
    compression_tables,
};
use mishandle::rollout::{AxisValues, Scenario, Seed, Space};
use mishandle::sight::{CAMERA_FAULTS, MOST_DISTRACTORS, View};
use mishandle::tasks::{CAMERA_NAMES, TaskError};
use mishandle::world::{ElementKind, Model};
use mishandle::{MishandleError as Error, Plan, ResolvedPlan};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::pool::Pool;
use crate::target::Level;
use crate::{InvalidValueError, raised};

/// The scene and the cameras of a task.
#[pyclass(frozen, module = "mishandle._native")]
pub struct Sights {
    space: Space,
    model: Model,
    view: View,
    /// Indices of the cameras.
    cameras: Vec<usize>,
    cloths: ClothRows,
    pool: Pool<Workers>,
}

struct Workers {
    readers: Vec<PoseReader>,
    studio: Studio,
}

/// Shapes, lamps, sky and cameras of scenarios, a row each.
type SightArrays<'py> = [Bound<'py, PyArray2<f32>>; 4];

/// Bodies and vertices of cloths, a row per state.
type PoseArrays<'py> = (Bound<'py, PyArray2<f32>>, Bound<'py, PyArray2<f32>>);

/// Triangles and nodes of cloths, bodies and places of their vertices.
type ClothArrays<'py> = (
    Bound<'py, PyArray2<u32>>,
    Bound<'py, PyArray2<u32>>,
    Bound<'py, PyArray1<u32>>,
    Bound<'py, PyArray2<f32>>,
);

#[pymethods]
impl Sights {
    #[new]
    #[pyo3(signature = (task, *, cameras, size, space, threads))]
    fn new(
        task: &str,
        cameras: Vec<String>,
        size: [usize; 2],
        space: &str,
        threads: Option<usize>,
    ) -> PyResult<Sights> {
        let definition = mishandle::resolve::task(task).map_err(raised)?;
        if let Some(name) = space.split('+').find(|name| *name == CAMERA_FAULTS) {
            return Err(InvalidValueError::new_err(format!(
                "the space `{name}` moves images in time and changes none: choose the states that are drawn, and leave it out"
            )));
        }
        let plan = Plan { space: space.to_string(), ..Plan::new(task, "expert") };
        let space = ResolvedPlan::new(&plan).map_err(raised)?.space;
        let index = |name: &String| {
            CAMERA_NAMES.iter().position(|known| known == name).ok_or_else(|| {
                let known = CAMERA_NAMES.map(ToString::to_string).to_vec();
                raised(Error::UnknownName { kind: "camera", name: name.clone(), known })
            })
        };
        let cameras = cameras.iter().map(index).collect::<PyResult<Vec<usize>>>()?;
        let size = Size::new(size[0], size[1]).map_err(unseen)?;
        let scene_error = |source| TaskError::Scene { task: definition.definition().name, source };
        let (model, view) =
            mishandle::tasks::sight::view(definition, size).map_err(scene_error).map_err(raised)?;
        let pool = Pool::new(threads, || {
            let threads = rayon::current_num_threads();
            let readers = (0..threads).map(|_| PoseReader::new(&model)).collect();
            Workers { readers, studio: Studio::new(&model, threads) }
        })?;
        let cloths = ClothRows::new(&view.scene, &model);
        Ok(Sights { space, model, view, cameras, cloths, pool })
    }

    /// The MJCF document whose states are drawn.
    #[getter]
    fn document(&self) -> &str {
        self.model.document()
    }

    /// The names of the axes of scenarios.
    #[getter]
    fn axes(&self) -> Vec<String> {
        self.space.axes().iter().map(|axis| axis.name.clone()).collect()
    }

    /// The length of a state, which a row of an environment starts with.
    #[getter]
    fn state_size(&self) -> usize {
        self.model.state_size()
    }

    /// Returns the values of scenarios: nominal ones for axes that a scenario does not name.
    fn values<'py>(
        &self,
        py: Python<'py>,
        scenarios: Vec<BTreeMap<String, Level>>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let count = scenarios.len();
        let mut values = Vec::with_capacity(count * self.space.dimension());
        for named in scenarios {
            let mut scenario = self.space.nominal().values().to_vec();
            for (name, level) in named {
                let index = self.space.axes().iter().position(|axis| axis.name == name).ok_or_else(|| {
                    raised(Error::UnknownName { kind: "axis", name: name.clone(), known: self.axes() })
                })?;
                scenario[index] = Some(self.number(index, &level)?);
            }
            values.extend(scenario.into_iter().map(|value| value.unwrap_or(f64::NAN)));
        }
        rows(py, values, [count, self.space.dimension()])
    }

    /// Returns random scenarios from number `first` on.
    fn draw<'py>(
        &self,
        py: Python<'py>,
        seed: u64,
        first: u64,
        count: usize,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let numbers = |number: u64| self.space.sample(Seed(seed), number).values().to_vec();
        let values = (first..).take(count).flat_map(numbers).map(|value| value.unwrap_or(f64::NAN));
        rows(py, values.collect(), [count, self.space.dimension()])
    }

    /// Returns the poses of all bodies in each state, 12 numbers each, and the vertices of cloths.
    fn poses<'py>(&self, py: Python<'py>, states: PyReadonlyArray2<'_, f64>) -> PyResult<PoseArrays<'py>> {
        let states = self.states(&states)?;
        let read = |workers: &mut Workers| each_with(&mut workers.readers, &states, pose_numbers);
        let (bodies, vertices): (Vec<_>, Vec<_>) = self.pool.with(py, read)?.into_iter().unzip();
        let [body_numbers, vertex_numbers] =
            [12 * self.model.count(ElementKind::Body), 3 * self.cloths.places.len()];
        Ok((
            rows(py, bodies.concat(), [states.len(), body_numbers])?,
            rows(py, vertices.concat(), [states.len(), vertex_numbers])?,
        ))
    }

    /// Returns the rows of scenarios, whose simulations start in the states `starts`.
    fn rows<'py>(
        &self,
        py: Python<'py>,
        values: PyReadonlyArray2<'_, f64>,
        starts: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<SightArrays<'py>> {
        let scenarios = self.scenarios(&values)?;
        let starts = self.states(&starts)?;
        let shapes = self.view.scene.shapes.len() + MOST_DISTRACTORS;
        let made = self.pool.with(py, |workers| {
            each_with(&mut workers.readers, &pairs(&scenarios, &starts), |reader, (scenario, start)| {
                let view = self.under(reader, scenario, start);
                SightRow::new(&view.scene, &self.cameras_of(&view), shapes)
            })
        })?;
        let made = made.into_iter().collect::<Result<Vec<SightRow>, CameraError>>().map_err(unseen)?;
        let columns = |of: fn(&SightRow) -> &Vec<f32>| {
            let numbers: Vec<f32> = made.iter().flat_map(|row| of(row).iter().copied()).collect();
            rows(py, numbers, [made.len(), made.first().map_or(0, |row| of(row).len())])
        };
        Ok([
            columns(|row| &row.shapes)?,
            columns(|row| &row.lamps)?,
            columns(|row| &row.sky)?,
            columns(|row| &row.cameras)?,
        ])
    }

    /// The triangles of cloths.
    fn cloths<'py>(&self, py: Python<'py>) -> PyResult<ClothArrays<'py>> {
        let ClothRows { triangles, nodes, bodies, places } = self.cloths.clone();
        let counts = [triangles.len(), nodes.len(), places.len()];
        Ok((
            rows(py, triangles.into_flattened(), [counts[0], 3])?,
            rows(py, nodes.into_flattened(), [counts[1], 4])?,
            bodies.into_pyarray(py),
            rows(py, places.into_flattened(), [counts[2], 3])?,
        ))
    }

    /// The tables of the compression.
    #[staticmethod]
    fn compression_tables(py: Python<'_>) -> PyResult<Bound<'_, PyArray3<f32>>> {
        compression_tables().as_flattened().as_flattened().to_vec().into_pyarray(py).reshape([3, 8, 8])
    }

    /// Returns the images that the CPU draws, one after the other: of each state, its cameras.
    /// `sights` are the rows of `values` and `starts` of each state.
    #[expect(clippy::too_many_arguments, reason = "one row of each per image")]
    fn images<'py>(
        &self,
        py: Python<'py>,
        states: PyReadonlyArray2<'_, f64>,
        before: Option<PyReadonlyArray2<'_, f64>>,
        values: PyReadonlyArray2<'_, f64>,
        starts: PyReadonlyArray2<'_, f64>,
        sights: PyReadonlyArray1<'_, i32>,
        seeds: PyReadonlyArray1<'_, u64>,
        steps: PyReadonlyArray1<'_, u64>,
    ) -> PyResult<Bound<'py, PyArray1<u8>>> {
        let states = self.states(&states)?;
        let before = before.as_ref().map(|given| self.states(given)).transpose()?;
        let scenarios = self.scenarios(&values)?;
        let starts = self.states(&starts)?;
        let sights = sights.to_vec()?;
        let seeds = seeds.to_vec()?;
        let steps = steps.to_vec()?;
        let images = self.pool.with(py, |workers| {
            let views =
                each_with(&mut workers.readers, &pairs(&scenarios, &starts), |reader, (scenario, start)| {
                    self.under(reader, scenario, start)
                });
            let shot = |row: usize| {
                let view = &views[sights[row] as usize];
                let before = before.as_ref();
                let states = &states;
                let seed = Seed(seeds[row]);
                let step = steps[row];
                self.cameras.iter().map(move |camera| StateShot {
                    state: states[row],
                    before: before.map(|before| before[row]),
                    scene: &view.scene,
                    camera: &view.cameras[*camera],
                    seed: seed.child(*camera as u64),
                    step,
                })
            };
            let shots: Vec<StateShot<'_>> = (0..states.len()).flat_map(shot).collect();
            let size = shots.first().map_or(0, |shot| 3 * shot.camera.size.pixels());
            let mut images = vec![0; size * shots.len()];
            let output = |rgb| Output { rgb: Some(rgb), depth: None, segments: None };
            let mut outputs: Vec<Output<'_>> = images.chunks_mut(size.max(1)).map(output).collect();
            workers.studio.render(&shots, &mut outputs);
            drop(outputs);
            images
        })?;
        Ok(images.into_pyarray(py))
    }
}

impl Sights {
    /// Returns the number of a value of an axis.
    fn number(&self, index: usize, level: &Level) -> PyResult<f64> {
        let axis = &self.space.axes()[index];
        match (level, &axis.values) {
            (Level::Number(value), _) => Ok(*value),
            (Level::Name(name), AxisValues::Categorical(names)) => names
                .iter()
                .position(|known| known == name)
                .map(|place| axis.low + place as f64)
                .ok_or_else(|| {
                    raised(Error::UnknownName { kind: "value", name: name.clone(), known: names.to_vec() })
                }),
            (Level::Name(name), _) => Err(InvalidValueError::new_err(format!(
                "the axis `{}` is a number, found `{name}`",
                axis.name
            ))),
        }
    }

    fn scenarios(&self, values: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<Scenario>> {
        let check = |row: &[f64]| {
            let scenario =
                Scenario::new(row.iter().map(|value| Some(*value).filter(|v| !v.is_nan())).collect());
            self.space.check(&scenario).map(|()| scenario).map_err(raised)
        };
        whole_rows(values, "scenarios", self.space.dimension())?.into_iter().map(check).collect()
    }

    fn states<'a>(&self, states: &'a PyReadonlyArray2<'_, f64>) -> PyResult<Vec<&'a [f64]>> {
        whole_rows(states, "states", self.model.state_size())
    }

    fn under(&self, reader: &mut PoseReader, scenario: &Scenario, start: &[f64]) -> View {
        let mut poses = Poses::default();
        reader.read(start, &mut poses);
        self.view.under(&self.space, scenario, &poses)
    }

    fn cameras_of<'a>(&self, view: &'a View) -> Vec<&'a Camera> {
        self.cameras.iter().map(|camera| &view.cameras[*camera]).collect()
    }
}

/// Returns the rows of an array, which have at least `least` numbers.
fn whole_rows<'a>(
    array: &'a PyReadonlyArray2<'_, f64>,
    name: &str,
    least: usize,
) -> PyResult<Vec<&'a [f64]>> {
    let columns = array.as_array().ncols();
    if columns < least {
        return Err(InvalidValueError::new_err(format!(
            "{name} must have {least} numbers each, found {columns}"
        )));
    }
    Ok(array.as_slice()?.chunks(columns).collect())
}

fn pairs<'a>(scenarios: &'a [Scenario], starts: &[&'a [f64]]) -> Vec<(&'a Scenario, &'a [f64])> {
    scenarios.iter().zip(starts.iter().copied()).collect()
}

/// Calls `work` for each item, with one reader per thread.
fn each_with<T: Sync, R: Send>(
    readers: &mut [PoseReader],
    items: &[T],
    work: impl Fn(&mut PoseReader, &T) -> R + Sync,
) -> Vec<R> {
    let share = items.len().div_ceil(readers.len()).max(1);
    let parts = items.par_chunks(share).zip(readers);
    parts
        .flat_map_iter(|(items, reader)| items.iter().map(|item| work(reader, item)).collect::<Vec<R>>())
        .collect()
}

fn pose_numbers(reader: &mut PoseReader, state: &&[f64]) -> (Vec<f32>, Vec<f32>) {
    let mut poses = Poses::default();
    reader.read(state, &mut poses);
    let bodies = poses.bodies.iter().flat_map(Pose::numbers).collect();
    (bodies, poses.cloths.into_iter().flatten().flatten().collect())
}

fn rows<T: numpy::Element>(
    py: Python<'_>,
    numbers: Vec<T>,
    shape: [usize; 2],
) -> PyResult<Bound<'_, PyArray2<T>>> {
    numbers.into_pyarray(py).reshape(shape)
}

fn unseen(error: CameraError) -> PyErr {
    InvalidValueError::new_err(error.to_string())
}
