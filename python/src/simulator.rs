//! Simulations of a task that Python resets and steps together.

use std::sync::Arc;

use mishandle::rollout::{CpuBatch, Environment, Scenario, Seed, StepStatus};
use mishandle::tasks::{Preset, TaskEnvironment};
use mishandle::world::Size;
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArray4, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use crate::camera::{Camera, framed_states};
use crate::pool::{Pool, actions, check_range};
use crate::{InvalidValueError, MishandleError, raised};

/// Largest number of simulations.
const MAX_ROWS: usize = 1_000_000;

/// Observations, reward terms, signals, and whether each row is terminated and diverged.
type Samples<'py> = (
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

/// What the threads change.
struct Stage {
    batch: CpuBatch<TaskEnvironment>,
    /// Created by the first picture.
    camera: Option<Camera>,
}

#[pymethods]
impl Simulator {
    #[new]
    #[pyo3(signature = (task, rows, *, preset, reward, threads))]
    fn new(task: &str, rows: usize, preset: &str, reward: &str, threads: Option<usize>) -> PyResult<Self> {
        check_range("the number of environments", rows, MAX_ROWS)?;
        let preset = mishandle::preset(preset).map_err(raised)?;
        let reward = mishandle::reward(reward).map_err(raised)?;
        let task = mishandle::task(task).map_err(raised)?;
        let environment = Arc::new(TaskEnvironment::new(task, preset, reward).map_err(raised)?);
        let stage = || Stage { batch: CpuBatch::new(environment.clone(), rows), camera: None };
        let pool = Pool::new(threads, stage)?;
        Ok(Simulator { environment, preset, rows, pool })
    }

    /// Starts a new simulation in each row of `mask`. A value of NaN in `scenarios` is drawn with the seed of its row.
    ///
    /// Returns observations, reward terms (0 after a reset), signals, terminated and diverged of all rows.
    fn reset<'py>(
        &self,
        py: Python<'py>,
        mask: PyReadonlyArray1<'py, bool>,
        seeds: PyReadonlyArray1<'py, u64>,
        scenarios: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Samples<'py>> {
        let axes = self.environment.space().dimension();
        self.check_shape("mask", mask.shape(), &[self.rows])?;
        self.check_shape("seeds", seeds.shape(), &[self.rows])?;
        self.check_shape("scenarios", scenarios.shape(), &[self.rows, axes])?;
        let (mask, seeds, scenarios) = (mask.as_array(), seeds.as_array(), scenarios.as_array());
        let space = self.environment.space();
        let mut starts: Vec<Option<(Scenario, Seed)>> = Vec::with_capacity(self.rows);
        for row in 0..self.rows {
            let seed = Seed(seeds[row]);
            let drawn = space.sample(seed, 0);
            let given = scenarios.row(row);
            let value =
                |(value, drawn): (&f64, &Option<f64>)| if value.is_nan() { *drawn } else { Some(*value) };
            let scenario = Scenario::new(given.iter().zip(drawn.values()).map(value).collect::<Vec<_>>());
            if mask[row] {
                space.check(&scenario).map_err(raised)?;
            }
            starts.push(mask[row].then_some((scenario, seed)));
        }
        self.update(py, |batch| batch.reset(|row| starts[row].clone()))
    }

    /// Advances all rows by one control step. Actions are clipped to \[-1, 1\].
    fn step<'py>(&self, py: Python<'py>, given: &Bound<'py, PyAny>) -> PyResult<Samples<'py>> {
        let actions: Vec<f64> = actions(given, [self.rows, self.environment.action_size()])?
            .into_iter()
            .map(|action| f64::from(action).clamp(-1.0, 1.0))
            .collect();
        self.update(py, |batch| batch.step(&actions))
    }

    /// Draws the current state of some rows: an array of bytes of the shape (rows, height, width, 3).
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
            let (low, high) = (Size::RANGE.start(), Size::RANGE.end());
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
        let document = mishandle::scene_mjcf(mishandle::task(self.environment.name()).map_err(raised)?);
        let document = document.map_err(raised)?;
        let count = rows.len();
        let pixels = self.pool.with(py, |Stage { batch, camera }| {
            let state = |row| {
                let mut state = vec![0.0; self.environment.state_size()];
                batch.read_state(row, &mut state);
                state
            };
            let states: Vec<Vec<f64>> = rows.into_iter().map(state).collect();
            if camera.as_ref().is_none_or(|camera| camera.size() != size) {
                *camera = Some(Camera::new(document, size, framed_states(&self.environment)));
            }
            camera.as_ref().map(|camera| camera.draw(states))
        })?;
        let pixels = pixels.unwrap_or_else(|| Ok(Vec::new())).map_err(MishandleError::new_err)?;
        pixels.into_pyarray(py).reshape([count, height as usize, width as usize, 3])
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
        let signals = self.environment.definition().signals.iter();
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

    /// Name of each number of an observation, with an index for quantities of several numbers.
    #[getter]
    fn observation_names(&self) -> Vec<String> {
        observation_names(&self.environment)
    }
}

/// Returns the name of each number of an observation, with an index for quantities of several numbers.
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
    fn update<'py>(
        &self,
        py: Python<'py>,
        work: impl FnOnce(&mut CpuBatch<TaskEnvironment>) + Send,
    ) -> PyResult<Samples<'py>> {
        let terms = self.environment.reward_terms().len();
        let (observations, rewards, signals, statuses) = self.pool.with(py, |Stage { batch, .. }| {
            work(batch);
            let mut rewards = batch.rewards().to_vec();
            // A step that diverged leaves those of the step before it.
            for (rewards, status) in rewards.chunks_exact_mut(terms.max(1)).zip(batch.statuses()) {
                if *status == StepStatus::Diverged {
                    rewards.fill(0.0);
                }
            }
            (batch.observations().to_vec(), rewards, batch.signals().to_vec(), batch.statuses().to_vec())
        })?;
        let flags = |found: fn(&StepStatus) -> bool| statuses.iter().map(found).collect::<Vec<bool>>();
        let environment = &self.environment;
        Ok((
            observations.into_pyarray(py).reshape([self.rows, environment.observation_size()])?,
            rewards.into_pyarray(py).reshape([self.rows, terms])?,
            signals.into_pyarray(py).reshape([self.rows, environment.signals().len()])?,
            flags(|status| *status != StepStatus::Running).into_pyarray(py),
            flags(|status| *status == StepStatus::Diverged).into_pyarray(py),
        ))
    }

    fn check_shape(&self, name: &str, found: &[usize], expected: &[usize]) -> PyResult<()> {
        if found == expected {
            return Ok(());
        }
        Err(InvalidValueError::new_err(format!("`{name}` must have the shape {expected:?}, found {found:?}")))
    }
}
