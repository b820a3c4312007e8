//! Simulations of a task that Python resets and steps together.

use std::sync::Arc;

use mishandle::rollout::{CpuBatch, Environment, Samples, Scenario, Seed, StepStatus};
use mishandle::tasks::{MANNER, Preset, TaskEnvironment};
use mishandle::world::Size;
use numpy::ndarray::Dimension;
use numpy::{
    Element, IntoPyArray, PyArray1, PyArray2, PyArray4, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyReadwriteArray, PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use crate::camera::{Camera, framed_states};
use crate::pool::{Pool, actions as checked_actions, check_range};
use crate::{InvalidValueError, MishandleError, raised};

/// Largest number of simulations.
const MAX_ROWS: usize = 1_000_000;

/// Observations, reward terms, signals, and whether each row is terminated and diverged.
type Arrays<'py> = (
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<bool>>,
);

/// Simulations of one task, stepped together without the interpreter lock.
#[pyclass(frozen, module = "mishandle._native")]
pub struct Simulator {
    environment: Arc<TaskEnvironment>,
    preset: Preset,
    rows: usize,
    pool: Pool<Stage>,
}

/// State that the threads change.
struct Stage {
    batch: CpuBatch<TaskEnvironment>,
    /// Created by the first picture.
    camera: Option<Camera>,
}

#[pymethods]
impl Simulator {
    #[new]
    #[pyo3(signature = (task, rows, *, preset, reward, threads, manner = false))]
    fn new(
        task: &str,
        rows: usize,
        preset: &str,
        reward: &str,
        threads: Option<usize>,
        manner: bool,
    ) -> PyResult<Self> {
        check_range("the number of environments", rows, MAX_ROWS)?;
        let preset = mishandle::resolve::preset(preset).map_err(raised)?;
        let reward = mishandle::train::reward(reward).map_err(raised)?;
        let task = mishandle::resolve::task(task).map_err(raised)?;
        let environment = TaskEnvironment::new(task, preset, reward).map_err(raised)?;
        let environment = Arc::new(if manner { environment.with_manner() } else { environment });
        let stage = || Stage { batch: CpuBatch::new(environment.clone(), rows), camera: None };
        let pool = Pool::new(threads, stage)?;
        Ok(Simulator { environment, preset, rows, pool })
    }

    /// Returns new arrays for the results of `reset` and `step`, all zero: observations, reward
    /// terms, signals, terminated and diverged.
    fn arrays<'py>(&self, py: Python<'py>) -> Arrays<'py> {
        let rows = self.rows;
        let environment = &self.environment;
        (
            PyArray2::zeros(py, [rows, environment.observation_size()], false),
            PyArray2::zeros(py, [rows, environment.reward_terms().len()], false),
            PyArray2::zeros(py, [rows, environment.signals().len()], false),
            PyArray1::zeros(py, [rows], false),
            PyArray1::zeros(py, [rows], false),
        )
    }

    /// Starts a new simulation in each row of `mask`. A value of NaN in `scenarios` is drawn with
    /// the seed of its row.
    ///
    /// Writes observations, reward terms (0 after a reset) and signals of these rows into the
    /// arrays of `out`, and terminated and diverged of all rows. Without `out`, makes new arrays.
    /// Returns the arrays.
    #[pyo3(signature = (mask, seeds, scenarios, out = None))]
    fn reset<'py>(
        &self,
        py: Python<'py>,
        mask: PyReadonlyArray1<'py, bool>,
        seeds: PyReadonlyArray1<'py, u64>,
        scenarios: PyReadonlyArray2<'py, f64>,
        out: Option<Arrays<'py>>,
    ) -> PyResult<Arrays<'py>> {
        let axes = self.environment.space().dimension();
        self.check_shape("mask", mask.shape(), &[self.rows])?;
        self.check_shape("seeds", seeds.shape(), &[self.rows])?;
        self.check_shape("scenarios", scenarios.shape(), &[self.rows, axes])?;
        let mask = mask.as_array();
        let seeds = seeds.as_array();
        let scenarios = scenarios.as_array();
        let space = self.environment.space();
        let mut starts: Vec<Option<(Scenario, Seed)>> = vec![None; self.rows];
        for row in (0..self.rows).filter(|row| mask[*row]) {
            let seed = Seed(seeds[row]);
            let drawn = space.sample(seed, 0);
            let value = |(value, drawn): (&f64, &Option<f64>)| {
                if value.is_nan() { *drawn } else { Some(*value) }
            };
            let values = scenarios.row(row).iter().zip(drawn.values()).map(value).collect::<Vec<_>>();
            let scenario = Scenario::new(values);
            space.check(&scenario).map_err(raised)?;
            starts[row] = Some((scenario, seed));
        }
        self.update(py, out, |batch, samples| batch.reset_into(|row| starts[row].clone(), samples))
    }

    /// Advances all rows by one control step. Actions are clipped to \[-1, 1\].
    ///
    /// Writes the results into the arrays of `out`, or into new ones, and returns them. Observation
    /// and signals of a row that diverged keep their contents; its reward terms are 0.
    #[pyo3(signature = (actions, out = None))]
    fn step<'py>(
        &self,
        py: Python<'py>,
        actions: &Bound<'py, PyAny>,
        out: Option<Arrays<'py>>,
    ) -> PyResult<Arrays<'py>> {
        let actions: Vec<f64> = checked_actions(actions, [self.rows, self.environment.action_size()])?
            .into_iter()
            .map(|action| f64::from(action).clamp(-1.0, 1.0))
            .collect();
        self.update(py, out, |batch, samples| batch.step_into(&actions, samples))
    }

    /// Draws the current state of some rows: an array of bytes of the shape (rows, height, width,
    /// 3).
    ///
    /// The camera does not move.
    fn render<'py>(
        &self,
        py: Python<'py>,
        rows: Vec<usize>,
        width: u32,
        height: u32,
    ) -> PyResult<Bound<'py, PyArray4<u8>>> {
        let Some(size) = Size::new(width, height) else {
            let low = Size::RANGE.start();
            let high = Size::RANGE.end();
            return Err(InvalidValueError::new_err(format!(
                "a picture has {width} x {height} pixels; width and height must be even and from {low} to {high}"
            )));
        };
        if let Some(row) = rows.iter().find(|row| **row >= self.rows) {
            return Err(InvalidValueError::new_err(format!(
                "there is no row {row}; there are {}",
                self.rows
            )));
        }
        let model = mishandle::resolve::picture_model(self.environment.name()).map_err(raised)?;
        let count = rows.len();
        let pixels = self.pool.with(py, |Stage { batch, camera }| {
            let state = |row| {
                let mut state = vec![0.0; self.environment.state_size()];
                batch.read_state(row, &mut state);
                state
            };
            let states: Vec<Vec<f64>> = rows.into_iter().map(state).collect();
            if camera.as_ref().is_none_or(|camera| camera.size() != size) {
                *camera = Some(Camera::new(model, size, framed_states(&self.environment)));
            }
            camera.as_ref().map(|camera| camera.draw(states))
        })?;
        let pixels = pixels.unwrap_or_else(|| Ok(Vec::new())).map_err(MishandleError::new_err)?;
        pixels.into_pyarray(py).reshape([count, height as usize, width as usize, 3])
    }

    /// Returns the state of a row, for cameras.
    fn state<'py>(&self, py: Python<'py>, row: usize) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let size = self.environment.state_size();
        let state = self.pool.with(py, |Stage { batch, .. }| {
            let mut state = vec![0.0; size];
            batch.read_state(row, &mut state);
            state
        })?;
        Ok(state.into_pyarray(py))
    }

    #[getter]
    fn observation_size(&self) -> usize {
        self.environment.observation_size()
    }

    #[getter]
    fn action_size(&self) -> usize {
        self.environment.action_size()
    }

    #[getter]
    fn episode_steps(&self) -> usize {
        self.environment.episode_steps()
    }

    #[getter]
    fn control_dt(&self) -> f64 {
        self.environment.control_dt()
    }

    /// Name and unit of each signal.
    #[getter]
    fn signals(&self) -> Vec<(String, String)> {
        let known = self.environment.definition().signals.iter().chain(MANNER);
        let signals = known.take(self.environment.signals().len());
        signals.map(|signal| (signal.name.to_string(), signal.unit.to_string())).collect()
    }

    /// Name and text of each formula, success first.
    #[getter]
    fn formulas(&self) -> Vec<(String, String)> {
        let formulas = self.environment.definition().formulas(self.preset).named();
        formulas.into_iter().map(|formula| (formula.name, formula.text)).collect()
    }

    #[getter]
    fn reward_terms(&self) -> Vec<String> {
        self.environment.reward_terms().to_vec()
    }

    /// Name, unit, bounds and meaning of each axis of the initial box.
    #[getter]
    fn axes(&self) -> Vec<(String, String, f64, f64, String)> {
        let axes = self.environment.space().axes().iter();
        axes.map(|axis| (axis.name.clone(), axis.unit.clone(), axis.low, axis.high, axis.meaning.clone()))
            .collect()
    }

    /// The observation and the action as places of faults: channels by name, and the range of each
    /// number.
    #[getter]
    fn fault_layouts(&self) -> Vec<crate::faults::Layout> {
        let sites = self.environment.definition().fault_sites();
        sites.iter().map(crate::faults::layout).collect()
    }

    /// Name of each number of an observation, with an index for quantities of several numbers.
    #[getter]
    fn observation_names(&self) -> Vec<String> {
        observation_names(&self.environment)
    }
}

/// Returns the name of each number of an observation, with an index for quantities of several
/// numbers.
pub(crate) fn observation_names(environment: &TaskEnvironment) -> Vec<String> {
    let parts = environment.definition().whole_observation();
    let names = parts.iter().flat_map(|part| {
        (0..part.size).map(|i| match part.size {
            1 => part.name.to_string(),
            _ => format!("{}[{i}]", part.name),
        })
    });
    names.collect()
}

impl Simulator {
    /// Calls `work` on the threads, with the memory of the arrays as its buffers.
    fn update<'py>(
        &self,
        py: Python<'py>,
        out: Option<Arrays<'py>>,
        work: impl FnOnce(&mut CpuBatch<TaskEnvironment>, Samples<'_>) + Send,
    ) -> PyResult<Arrays<'py>> {
        let arrays = out.unwrap_or_else(|| self.arrays(py));
        let rows = self.rows;
        let environment = &self.environment;
        let terms = environment.reward_terms().len();
        let mut observations = arrays.0.try_readwrite()?;
        let mut rewards = arrays.1.try_readwrite()?;
        let mut signals = arrays.2.try_readwrite()?;
        let mut terminated = arrays.3.try_readwrite()?;
        let mut diverged = arrays.4.try_readwrite()?;
        let observations = self.memory(&mut observations, &[rows, environment.observation_size()])?;
        let rewards = self.memory(&mut rewards, &[rows, terms])?;
        let signals = self.memory(&mut signals, &[rows, environment.signals().len()])?;
        let terminated = self.memory(&mut terminated, &[rows])?;
        let diverged = self.memory(&mut diverged, &[rows])?;
        self.pool.with(py, |Stage { batch, .. }| {
            work(batch, Samples { observations, signals, rewards: &mut *rewards });
            for (row, status) in batch.statuses().iter().enumerate() {
                terminated[row] = *status != StepStatus::Running;
                diverged[row] = *status == StepStatus::Diverged;
                // A step that diverged leaves those of the step before it.
                if diverged[row] {
                    rewards[row * terms..][..terms].fill(0.0);
                }
            }
        })?;
        Ok(arrays)
    }

    /// Returns the memory of an array that has this shape.
    fn memory<'a, T: Element, D: Dimension>(
        &self,
        array: &'a mut PyReadwriteArray<'_, T, D>,
        shape: &[usize],
    ) -> PyResult<&'a mut [T]> {
        self.check_shape("out", array.shape(), shape)?;
        // Numbers at odd addresses would be undefined behavior, and the library checks it in debug
        // builds only.
        if !array.is_aligned() {
            return Err(InvalidValueError::new_err(
                "`out` is not aligned in memory; use the arrays of `arrays()`",
            ));
        }
        // A slice of an array in Fortran order would be column by column.
        if !array.is_c_contiguous() {
            return Err(InvalidValueError::new_err(
                "`out` is not contiguous in C order; use the arrays of `arrays()`",
            ));
        }
        Ok(array.as_slice_mut()?)
    }

    fn check_shape(&self, name: &str, found: &[usize], expected: &[usize]) -> PyResult<()> {
        if found == expected {
            return Ok(());
        }
        Err(InvalidValueError::new_err(format!("`{name}` must have the shape {expected:?}, found {found:?}")))
    }
}
