use std::sync::{Arc, Mutex, PoisonError};

use mishandle::rollout::{Environment, RolloutError, Seed};
use mishandle::tasks::TaskEnvironment;
use mishandle::training::{Boundary, EpisodeSettings, Episodes, TrainingError};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::{MishandleError, raised};

/// Simulations of a task that are stepped together, a row each, and start anew when they end.
///
/// They are the episodes that `mishandle train` learns from, to the same bits for the same arguments, whatever the
/// number of threads. Observations and actions are those of a controller: `observation_names` says what stands where,
/// and an action steps the targets of seven arm joints and two fingers by at most its share in [-1, 1].
///
/// Arguments:
///     task: name of a task, such as "point-reaching".
///     environments: number of rows.
///     preset: the task preset, "paper" or "code": which reading of the original benchmark the initial box is.
///     reward: "shaped" or "original".
///     seed: of all that is random; episode k of a row is the same whatever happens in other rows.
///     time_limit: control steps after which the clock ends an episode; the task's if left out.
///     action_noise: standard deviation of noise on each clipped action.
///     staggered: whether a row's first episode has only a random part of its time, so that rows are not in step.
///     threads: threads that step the rows; as many as there are cores if left out.
///
/// Raises MishandleError if a name is unknown or a number is out of its range.
///
/// Another Python thread may run while the rows are stepped; calls from several of them follow each other.
#[pyclass(frozen, module = "mishandle")]
pub struct VectorEnv {
    environment: Arc<TaskEnvironment>,
    settings: EpisodeSettings,
    seed: Seed,
    pool: ThreadPool,
    /// Nothing until the first reset. Locked by threads that have let go of the interpreter, never by others.
    episodes: Mutex<Option<Episodes>>,
}

/// What a control step gives, row by row.
struct Outcome {
    observations: Vec<f32>,
    rewards: Vec<f64>,
    boundaries: Vec<Boundary>,
    final_observations: Vec<f32>,
}

/// What `step` returns: observations, rewards, terminated, truncated, info.
type Step<'py> = (
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyDict>,
);

#[pymethods]
impl VectorEnv {
    #[new]
    #[pyo3(signature = (task, environments, *, preset = "paper", reward = "shaped", seed = 0, time_limit = None,
        action_noise = 0.0, staggered = false, threads = None))]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn new(
        task: &str,
        environments: usize,
        preset: &str,
        reward: &str,
        seed: u64,
        time_limit: Option<usize>,
        action_noise: f64,
        staggered: bool,
        threads: Option<usize>,
    ) -> PyResult<VectorEnv> {
        let settings = EpisodeSettings {
            environments,
            time_limit,
            staggered,
            action_noise,
            ..EpisodeSettings::default()
        };
        settings.check().map_err(wrong_keyword)?;
        let task = mishandle::task(task).map_err(raised)?;
        let preset = mishandle::preset(preset).map_err(raised)?;
        let reward = mishandle::reward(reward).map_err(raised)?;
        let environment = TaskEnvironment::new(task, preset, reward).map_err(raised)?;
        if threads == Some(0) {
            return Err(MishandleError::new_err("`threads` must be at least 1, found 0"));
        }
        let pool = ThreadPoolBuilder::new().num_threads(threads.unwrap_or_default()).build();
        Ok(VectorEnv {
            environment: Arc::new(environment),
            settings,
            seed: Seed(seed),
            pool: pool.map_err(|error| MishandleError::new_err(error.to_string()))?,
            episodes: Mutex::new(None),
        })
    }

    /// Starts the first episode of every row: again the same ones if it is called again.
    ///
    /// Returns what each row shows, float32 of shape (environments, observation_size).
    fn reset<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let observations = py.detach(|| -> Result<_, RolloutError> {
            let episodes =
                self.pool.install(|| Episodes::of_training(&self.environment, &self.settings, self.seed))?;
            let observations = episodes.observations().to_vec();
            *self.episodes.lock().unwrap_or_else(PoisonError::into_inner) = Some(episodes);
            Ok(observations)
        });
        self.rows(py, observations.map_err(raised)?)
    }

    /// Carries every row on by one control step of `control_dt` seconds.
    ///
    /// `actions` is float32 of shape (environments, action_size). Each is clipped to [-1, 1]; noise is added to it, if
    /// there is any, and not clipped.
    ///
    /// A row whose episode ends starts its next one in the same step. Returns
    ///     observations: float32 (environments, observation_size), what each row shows now: the first observation of
    ///         the next episode where one has just ended;
    ///     rewards: float64 (environments,), of this step, the sum of the task's reward terms;
    ///     terminated: bool (environments,), whether the task ended the row's episode, lost or with numbers that are
    ///         no longer finite;
    ///     truncated: bool (environments,), whether the clock did; never together with terminated;
    ///     info: a dict whose "final_observation", float32 (environments, observation_size), is what each row showed
    ///         after this step and before any new start: what a critic is asked about at the time limit. After
    ///         numbers that are not finite it is the observation before the step, and the reward 0.
    ///
    /// Raises MishandleError if there was no reset, or the actions have another type or shape or are not finite.
    fn step<'py>(&self, py: Python<'py>, actions: &Bound<'py, PyAny>) -> PyResult<Step<'py>> {
        let actions = self.actions(actions)?;
        let outcome = py.detach(|| self.outcome(&actions));
        let Outcome { observations, rewards, boundaries, final_observations } =
            outcome?.ok_or_else(|| MishandleError::new_err("`reset` comes before the first `step`"))?;
        let which = |end| boundaries.iter().map(|boundary| *boundary == end).collect::<Vec<_>>();
        let info = PyDict::new(py);
        info.set_item("final_observation", self.rows(py, final_observations)?)?;
        Ok((
            self.rows(py, observations)?,
            rewards.into_pyarray(py),
            which(Boundary::Terminated).into_pyarray(py),
            which(Boundary::Truncated).into_pyarray(py),
            info,
        ))
    }

    /// Name of the task.
    #[getter]
    fn task(&self) -> &str {
        self.environment.name()
    }

    /// Number of rows.
    #[getter]
    fn environments(&self) -> usize {
        self.settings.environments
    }

    /// Numbers in an observation.
    #[getter]
    fn observation_size(&self) -> usize {
        self.environment.observation_size()
    }

    /// Numbers in an action.
    #[getter]
    fn action_size(&self) -> usize {
        self.environment.action_size()
    }

    /// Control steps after which the clock ends an episode.
    #[getter]
    fn episode_steps(&self) -> usize {
        self.settings.time_limit.unwrap_or(self.environment.episode_steps())
    }

    /// Duration of a control step, s.
    #[getter]
    fn control_dt(&self) -> f64 {
        self.environment.control_dt()
    }

    /// What each number of an observation is, with an index where a quantity has several.
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

impl VectorEnv {
    /// One control step; nothing before the first reset.
    fn outcome(&self, actions: &[f32]) -> PyResult<Option<Outcome>> {
        let mut episodes = self.episodes.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(episodes) = episodes.as_mut() else { return Ok(None) };
        self.pool.install(|| episodes.step(actions)).map_err(raised)?;
        Ok(Some(Outcome {
            observations: episodes.observations().to_vec(),
            rewards: episodes.rewards().to_vec(),
            boundaries: episodes.boundaries().to_vec(),
            final_observations: episodes.final_observations().to_vec(),
        }))
    }

    /// A copy of the actions, row by row.
    fn actions(&self, actions: &Bound<'_, PyAny>) -> PyResult<Vec<f32>> {
        let wanted = [self.environments(), self.action_size()];
        let Ok(actions) = actions.extract::<PyReadonlyArray2<'_, f32>>() else {
            let found = actions.get_type().name()?;
            let found = match (actions.getattr("dtype"), actions.getattr("shape")) {
                (Ok(dtype), Ok(shape)) => format!("{found} of {dtype} and shape {shape}"),
                _ => found.to_string(),
            };
            let [rows, columns] = wanted;
            return Err(MishandleError::new_err(format!(
                "`actions` must be a NumPy array of float32 and shape ({rows}, {columns}), found {found}"
            )));
        };
        if actions.shape() != wanted {
            return Err(MishandleError::new_err(format!(
                "`actions` must have the shape {wanted:?} of environments and action numbers, found {:?}",
                actions.shape()
            )));
        }
        let actions: Vec<f32> = actions.as_array().iter().copied().collect();
        match actions.iter().position(|action| !action.is_finite()) {
            None => Ok(actions),
            Some(place) => Err(MishandleError::new_err(format!(
                "`actions` must be finite, found {} at [{}, {}]",
                actions[place],
                place / wanted[1],
                place % wanted[1]
            ))),
        }
    }

    /// An array with a row for each environment.
    fn rows<'py>(&self, py: Python<'py>, numbers: Vec<f32>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        numbers.into_pyarray(py).reshape([self.environments(), self.observation_size()])
    }
}

/// A setting that has a value that it cannot have: in Python it is a keyword, in no table.
fn wrong_keyword(error: TrainingError) -> PyErr {
    match error {
        TrainingError::Setting { name, expected, found, .. } => {
            let keyword = name.rsplit('.').next().unwrap_or(&name);
            MishandleError::new_err(format!("`{keyword}` must be {expected}, found {found}"))
        }
        other => raised(other),
    }
}
