use std::sync::Arc;

use mishandle::rollout::{Environment, RolloutError, Seed};
use mishandle::tasks::TaskEnvironment;
use mishandle::training::{Boundary, EpisodeSettings, Episodes, ScenarioSettings, TrainingError};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::pool::{Pool, actions};
use crate::simulator::observation_names;
use crate::{InvalidStateError, InvalidValueError, raised};

/// Parallel environments of one task. An environment whose episode ends is reset in the same step.
///
/// The episodes are bit-identical to those of `mishandle train` with the same arguments, for every
/// number of threads. Row i of each array belongs to environment i. `observation_names` describes
/// the numbers of an observation. An action changes the targets of seven arm joints and two
/// fingers; its numbers range from -1 to 1.
///
/// Arguments:
///     task: name of a task, such as "point-reaching".
///     environments: number of environments.
///     preset: task preset, "paper" or "code", which selects the initial box.
///     reward: "shaped" or "original".
///     seed: random seed. Episode k of an environment does not depend on the other environments.
///     time_limit: control steps until truncation; by default the task's episode length.
///     action_noise: standard deviation of the noise on each clipped action.
///     staggered: whether the first episode of each environment has a random length, so that resets
///         are spread out.
///     threads: number of threads, from 1 to 1024; by default the number of cores. It does not
///         affect the results.
///
/// Raises MishandleError if a name is unknown or a value is out of its range.
///
/// Other Python threads can run during a step. Concurrent calls are executed one after the other.
///
/// A process made by fork cannot use the environments of its parent, because it has none of its
/// threads: reset and step raise RuntimeError. It can create its own.
#[pyclass(frozen, module = "mishandle.systems")]
pub struct TrainingEpisodes {
    environment: Arc<TaskEnvironment>,
    settings: EpisodeSettings,
    seed: Seed,
    /// `None` until the first reset.
    pool: Pool<Option<Episodes>>,
}

/// Results of a control step, row by row.
struct StepResult {
    observations: Vec<f32>,
    rewards: Vec<f64>,
    boundaries: Vec<Boundary>,
    final_observations: Vec<f32>,
}

/// Return value of `step`: observations, rewards, terminated, truncated, info.
type Step<'py> = (
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyDict>,
);

#[pymethods]
impl TrainingEpisodes {
    #[new]
    #[pyo3(signature = (task, environments, *, preset = "paper", reward = "shaped", seed = 0, time_limit = None,
        action_noise = 0.0, staggered = false, threads = None))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments in Python")]
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
    ) -> PyResult<TrainingEpisodes> {
        let settings = EpisodeSettings {
            environments,
            time_limit,
            staggered,
            action_noise,
            ..EpisodeSettings::default()
        };
        settings.check().map_err(keyword_error)?;
        let task = mishandle::resolve::task(task).map_err(raised)?;
        let preset = mishandle::resolve::preset(preset).map_err(raised)?;
        let reward = mishandle::train::reward(reward).map_err(raised)?;
        let environment = TaskEnvironment::new(task, preset, reward).map_err(raised)?;
        let pool = Pool::new(threads, || None)?;
        Ok(TrainingEpisodes { environment: Arc::new(environment), settings, seed: Seed(seed), pool })
    }

    /// Starts the first episode of every environment. Every call starts the same episodes.
    ///
    /// Returns the observations, float32 of shape (environments, observation_size). Raises
    /// RuntimeError in a process made by fork after the environments were created.
    fn reset<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let observations = self.pool.with(py, |current| -> Result<_, RolloutError> {
            let episodes = Episodes::of_training(
                &self.environment,
                &self.settings,
                &ScenarioSettings::default(),
                self.seed,
            )?;
            let observations = episodes.observations().to_vec();
            *current = Some(episodes);
            Ok(observations)
        })?;
        self.rows(py, observations.map_err(raised)?)
    }

    /// Advances every environment by one control step of `control_dt` seconds.
    ///
    /// `actions` is float32 of shape (environments, action_size). Actions are clipped to [-1, 1];
    /// then the action noise is added without further clipping.
    ///
    /// An environment whose episode ends is reset in the same step. Returns
    ///     observations: float32 (environments, observation_size); after the end of an episode, the
    ///         first observation of the next episode;
    ///     rewards: float64 (environments,), the sum of the task's reward terms in this step;
    ///     terminated: bool (environments,), whether the task terminated the episode: the task
    ///         failed, or the simulation diverged;
    ///     truncated: bool (environments,), whether the time limit ended the episode; never
    ///         together with terminated;
    ///     info: a dict with "final_observation", float32 (environments, observation_size): the
    ///         observation after this step and before any reset, for bootstrapping the value at the
    ///         time limit. If the simulation diverged, it is the observation before the step, and
    ///         the reward is 0.
    ///
    /// Raises MishandleError before the first reset, or if the actions have another type or shape,
    /// are not finite or are not aligned in memory. Raises RuntimeError in a process made by fork
    /// after the environments were created.
    fn step<'py>(&self, py: Python<'py>, given: &Bound<'py, PyAny>) -> PyResult<Step<'py>> {
        let actions = actions(given, [self.environments(), self.action_size()])?;
        let result = self.pool.with(py, |episodes| {
            let Some(episodes) = episodes else { return Ok(None) };
            episodes.step(&actions)?;
            Ok::<_, RolloutError>(Some(StepResult {
                observations: episodes.observations().to_vec(),
                rewards: episodes.rewards().to_vec(),
                boundaries: episodes.boundaries().to_vec(),
                final_observations: episodes.final_observations().to_vec(),
            }))
        })?;
        let StepResult { observations, rewards, boundaries, final_observations } = result
            .map_err(raised)?
            .ok_or_else(|| InvalidStateError::new_err("call `reset` before the first `step`"))?;
        let flags = |end| boundaries.iter().map(|boundary| *boundary == end).collect::<Vec<_>>();
        let info = PyDict::new(py);
        info.set_item("final_observation", self.rows(py, final_observations)?)?;
        Ok((
            self.rows(py, observations)?,
            rewards.into_pyarray(py),
            flags(Boundary::Terminated).into_pyarray(py),
            flags(Boundary::Truncated).into_pyarray(py),
            info,
        ))
    }

    /// Name of the task.
    #[getter]
    fn task(&self) -> &str {
        self.environment.name()
    }

    /// Number of environments.
    #[getter]
    fn environments(&self) -> usize {
        self.settings.environments
    }

    /// Size of an observation.
    #[getter]
    fn observation_size(&self) -> usize {
        self.environment.observation_size()
    }

    /// Size of an action.
    #[getter]
    fn action_size(&self) -> usize {
        self.environment.action_size()
    }

    /// Control steps until truncation.
    #[getter]
    fn episode_steps(&self) -> usize {
        self.settings.time_limit.unwrap_or(self.environment.episode_steps())
    }

    /// Duration of a control step, in seconds.
    #[getter]
    fn control_dt(&self) -> f64 {
        self.environment.control_dt()
    }

    /// Name of each number of an observation, with an index for quantities of several numbers.
    #[getter]
    fn observation_names(&self) -> Vec<String> {
        observation_names(&self.environment)
    }
}

impl TrainingEpisodes {
    /// Returns an array with one row per environment.
    fn rows<'py>(&self, py: Python<'py>, numbers: Vec<f32>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        numbers.into_pyarray(py).reshape([self.environments(), self.observation_size()])
    }
}

/// Converts an error of a training setting: in Python the setting is a keyword argument without a
/// table.
fn keyword_error(error: TrainingError) -> PyErr {
    match error {
        TrainingError::Setting { name, expected, found, .. } => {
            let keyword = name.rsplit('.').next().unwrap_or(&name);
            InvalidValueError::new_err(format!("`{keyword}` must be {expected}, found {found}"))
        }
        other => raised(other),
    }
}
