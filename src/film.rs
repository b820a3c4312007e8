//! The states of a task's scene, one after the other, to be drawn.

use std::sync::{Arc, Mutex, PoisonError};

use mishandle_rollout::{Environment, EnvironmentWorker, Sample, Scenario, Seed, Space, StepStatus};
use mishandle_store::RunFile;
use mishandle_tasks::{Definition, Preset, Reward, Task, TaskEnvironment, compose};

use crate::replay::{recorded_plan, replay_in};
use crate::target::task_target;
use crate::{MishandleError, ReplayResult};

/// States of a task's scene, a control step apart.
pub struct Film {
    /// State rows of it.
    pub states: Vec<Vec<f64>>,
    /// Time between two of them, s.
    pub control_dt: f64,
}

/// A task's scene at its start: from `x0`, or from the middle of the paper's box.
///
/// # Errors
/// If `x0` does not have a finite number for each axis, lies in no task preset's initial box, or the task cannot be built.
pub fn start(task: &dyn Task, x0: Option<&[f64]>) -> Result<Film, MishandleError> {
    let environment = TaskEnvironment::new(task, Preset::Paper, Reward::Original)?;
    let scenario = x0.map_or_else(|| environment.space().nominal(), Scenario::from);
    environment.space().check(&scenario)?;
    check_start(task.definition(), x0.unwrap_or_default())?;
    let mut state = vec![0.0; environment.state_size()];
    let mut observation = vec![0.0; environment.observation_size()];
    let mut signals = vec![0.0; environment.signals().len()];
    let mut rewards = vec![0.0; environment.reward_terms().len()];
    let sample = Sample { observation: &mut observation, signals: &mut signals, rewards: &mut rewards };
    environment.worker().reset(&scenario, Seed(0), &mut state, sample);
    Ok(Film { states: vec![state], control_dt: environment.control_dt() })
}

/// Refuses a start that lies in no task preset's box, by what the paper's box says of it.
fn check_start(definition: &Definition, x0: &[f64]) -> Result<(), MishandleError> {
    let outside = |preset| {
        definition.initial_box.iter().zip(x0).find(move |(axis, value)| {
            let [low, high] = axis.bounds(preset);
            !(low..=high).contains(*value)
        })
    };
    match (outside(Preset::Paper), outside(Preset::Code)) {
        (Some((axis, &value)), Some(_)) => {
            let [low, high] = axis.bounds(Preset::Paper);
            Err(MishandleError::OutsideBox { axis: axis.name, value, unit: axis.unit, low, high })
        }
        _ => Ok(()),
    }
}

/// Runs simulation `number` of trial `trial` of a run again, as [`replay`](crate::replay()) does, and keeps its states.
///
/// # Errors
/// As [`replay`](crate::replay()), and if the run's target is not a task.
pub fn film(
    run: &RunFile,
    trial: u32,
    number: u32,
    controller: Option<&str>,
) -> Result<(ReplayResult, Film), MishandleError> {
    let resolved = recorded_plan(run.header(), controller)?;
    let target = task_target(&resolved.plan)?;
    let states = Arc::new(Mutex::new(Vec::new()));
    let environment = Arc::new(target.environment(&resolved.space)?);
    let filmed = Arc::new(Filmed { environment, states: states.clone() });
    let mut system = target.system_in(filmed, &resolved.space, &resolved.specification)?;
    let replayed = replay_in(run, trial, number, &resolved, &mut system)?;
    let states = std::mem::take(&mut *states.lock().unwrap_or_else(PoisonError::into_inner));
    Ok((replayed, Film { states, control_dt: run.header().control_dt }))
}

/// A task's scene with all that is to be seen, an MJCF document.
///
/// # Errors
/// If the scene cannot be put together.
pub fn scene(task: &dyn Task) -> Result<String, MishandleError> {
    compose(task).map_err(|source| {
        MishandleError::Task(mishandle_tasks::TaskError::Scene { task: task.definition().name, source })
    })
}

/// An environment that keeps the states of the one simulation that runs in it.
struct Filmed {
    environment: Arc<TaskEnvironment>,
    states: Arc<Mutex<Vec<Vec<f64>>>>,
}

impl Environment for Filmed {
    fn name(&self) -> &str {
        self.environment.name()
    }

    fn space(&self) -> &Space {
        self.environment.space()
    }

    fn signals(&self) -> &Arc<[String]> {
        self.environment.signals()
    }

    fn reward_terms(&self) -> &[String] {
        self.environment.reward_terms()
    }

    fn observation_size(&self) -> usize {
        self.environment.observation_size()
    }

    fn action_size(&self) -> usize {
        self.environment.action_size()
    }

    fn state_size(&self) -> usize {
        self.environment.state_size()
    }

    fn control_dt(&self) -> f64 {
        self.environment.control_dt()
    }

    fn episode_steps(&self) -> usize {
        self.environment.episode_steps()
    }

    fn worker(&self) -> Box<dyn EnvironmentWorker> {
        Box::new(FilmedWorker { worker: self.environment.worker(), states: self.states.clone() })
    }
}

struct FilmedWorker {
    worker: Box<dyn EnvironmentWorker>,
    states: Arc<Mutex<Vec<Vec<f64>>>>,
}

impl FilmedWorker {
    fn keep(&self, state: &[f64]) {
        self.states.lock().unwrap_or_else(PoisonError::into_inner).push(state.to_vec());
    }
}

impl EnvironmentWorker for FilmedWorker {
    fn reset(&mut self, scenario: &Scenario, seed: Seed, state: &mut [f64], sample: Sample<'_>) {
        self.worker.reset(scenario, seed, state, sample);
        self.keep(state);
    }

    fn step(&mut self, action: &[f64], state: &mut [f64], sample: Sample<'_>) -> StepStatus {
        let status = self.worker.step(action, state, sample);
        if status != StepStatus::Diverged {
            self.keep(state);
        }
        status
    }
}
