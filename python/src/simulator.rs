//! Simulations of a task that Python resets and steps together.

use std::sync::{Arc, Mutex, PoisonError};

use mishandle::rollout::{CpuBatch, Environment, Scenario, Seed, StepStatus};
use mishandle::tasks::{Preset, TaskEnvironment};
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::{MishandleError, in_this_process, raised};

/// Largest number of threads, more than any machine has cores.
const MAX_THREADS: usize = 1024;

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
    parts: Arc<Parts>,
    /// The process that created the threads of the pool.
    process: u32,
}

/// What a process made by fork must not touch: threads that it does not have, and state in the middle of a step.
struct Parts {
    pool: ThreadPool,
    /// Only threads that have released the interpreter lock it, which prevents deadlocks.
    batch: Mutex<CpuBatch<TaskEnvironment>>,
}

impl Drop for Simulator {
    fn drop(&mut self) {
        if self.process != std::process::id() {
            // The copy is never dropped, so dropping the pool does not wait for its threads.
            std::mem::forget(self.parts.clone());
        }
    }
}

#[pymethods]
impl Simulator {
    #[new]
    #[pyo3(signature = (task, rows, *, preset, reward, threads))]
    fn new(task: &str, rows: usize, preset: &str, reward: &str, threads: Option<usize>) -> PyResult<Self> {
        check_range("the number of environments", rows, MAX_ROWS)?;
        if let Some(threads) = threads {
            check_range("threads", threads, MAX_THREADS)?;
        }
        let preset = mishandle::preset(preset).map_err(raised)?;
        let reward = mishandle::reward(reward).map_err(raised)?;
        let task = mishandle::task(task).map_err(raised)?;
        let environment = Arc::new(TaskEnvironment::new(task, preset, reward).map_err(raised)?);
        let pool = ThreadPoolBuilder::new()
            .num_threads(threads.unwrap_or_default())
            .build()
            .map_err(|error| PyRuntimeError::new_err(error.to_string()))?;
        let batch = Mutex::new(pool.install(|| CpuBatch::new(environment.clone(), rows)));
        Ok(Simulator {
            environment,
            preset,
            rows,
            parts: Arc::new(Parts { pool, batch }),
            process: std::process::id(),
        })
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
    fn step<'py>(&self, py: Python<'py>, actions: PyReadonlyArray2<'py, f32>) -> PyResult<Samples<'py>> {
        self.check_shape("actions", actions.shape(), &[self.rows, self.environment.action_size()])?;
        // A view of numbers at odd addresses would be undefined behavior, and the library checks it in debug builds only.
        if !actions.is_aligned() {
            return Err(MishandleError::new_err("`actions` is not aligned in memory; pass `actions.copy()`"));
        }
        let actions: Vec<f64> =
            actions.as_array().iter().map(|action| f64::from(*action).clamp(-1.0, 1.0)).collect();
        if let Some(index) = actions.iter().position(|action| !action.is_finite()) {
            let (row, column) =
                (index / self.environment.action_size(), index % self.environment.action_size());
            return Err(MishandleError::new_err(format!(
                "`actions` must be finite, found NaN at [{row}, {column}]"
            )));
        }
        self.update(py, |batch| batch.step(&actions))
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
        let parts = self.environment.definition().whole_observation();
        let names = parts.iter().flat_map(|part| {
            (0..part.size).map(|i| match part.size {
                1 => part.name.to_string(),
                _ => format!("{}[{i}]", part.name),
            })
        });
        names.collect()
    }
}

impl Simulator {
    fn update<'py>(
        &self,
        py: Python<'py>,
        work: impl FnOnce(&mut CpuBatch<TaskEnvironment>) + Send,
    ) -> PyResult<Samples<'py>> {
        in_this_process(self.process)?;
        let Parts { pool, batch } = &*self.parts;
        let (observations, rewards, signals, statuses) = py.detach(|| {
            let mut guard = batch.lock().unwrap_or_else(PoisonError::into_inner);
            let batch = &mut *guard;
            pool.install(|| work(batch));
            let statuses = batch.statuses().to_vec();
            (batch.observations().to_vec(), batch.rewards().to_vec(), batch.signals().to_vec(), statuses)
        });
        let flags = |found: fn(&StepStatus) -> bool| statuses.iter().map(found).collect::<Vec<bool>>();
        let environment = &self.environment;
        Ok((
            observations.into_pyarray(py).reshape([self.rows, environment.observation_size()])?,
            rewards.into_pyarray(py).reshape([self.rows, environment.reward_terms().len()])?,
            signals.into_pyarray(py).reshape([self.rows, environment.signals().len()])?,
            flags(|status| *status != StepStatus::Running).into_pyarray(py),
            flags(|status| *status == StepStatus::Diverged).into_pyarray(py),
        ))
    }

    fn check_shape(&self, name: &str, found: &[usize], expected: &[usize]) -> PyResult<()> {
        if found == expected {
            return Ok(());
        }
        Err(MishandleError::new_err(format!("`{name}` must have the shape {expected:?}, found {found:?}")))
    }
}

fn check_range(name: &str, found: usize, limit: usize) -> PyResult<()> {
    if (1..=limit).contains(&found) {
        return Ok(());
    }
    Err(MishandleError::new_err(format!("{name} must be a whole number from 1 to {limit}, found {found}")))
}
