//! Sequences of simulation states, for rendering.

use std::sync::Arc;

use mishandle_rollout::{Episode, Request, Sample, Scenario, Seed, Space, StepStatus, System};
use mishandle_store::RunFile;

use crate::error::{MishandleError, RunError, invalid};
use crate::inspect::{Event, EventKind};
use crate::picture::cameras::{CameraSettings, TargetCameras};
use crate::picture::frames::SeenStates;
use crate::picture::recording::{RecordingEnvironment, SharedRecordings};
use crate::replay::{ReplayResult, replay_in};
use crate::resolve::{ResolvedPlan, SceneEnvironment, recorded_plan, scene_start, scene_target};

/// Time in which objects settle into their first contacts, in seconds.
const SETTLING: f64 = 0.1;

/// The simulation states of an episode, one per control step.
pub struct StateTrajectory {
    /// MuJoCo states (`state_size` numbers each), from the initial state on.
    pub states: Vec<Vec<f64>>,
    /// Time between two states, in seconds.
    pub control_dt: f64,
    environment: Arc<dyn SceneEnvironment>,
    /// The target, as in a plan, and what the cameras of its simulation depend on.
    target: String,
    space: Space,
    scenario: Scenario,
    seed: Seed,
}

impl StateTrajectory {
    /// Returns what cameras of the target see in these states. `None` without a state.
    ///
    /// # Errors
    /// As for [`TargetCameras::new`].
    pub fn seen_by(&self, settings: &CameraSettings) -> Result<Option<SeenStates>, MishandleError> {
        let mut cameras = TargetCameras::new(&self.target, &self.space, settings)?;
        let episode = cameras.start(&self.states, &self.scenario, self.seed)?;
        Ok(episode.map(|episode| SeenStates { cameras, episode, states: self.states.clone() }))
    }

    /// Returns the first contact between two parts of the scene that do not touch in the first 0.1
    /// s, in which objects settle, and its name, which is that of the column `contact_A_B` of a
    /// full trace. `None` without one. A contact between two control steps is not seen.
    ///
    /// # Errors
    /// If the scene cannot be built.
    pub fn first_contact(&self) -> Result<Option<(Event, String)>, MishandleError> {
        let mut full_state = self.environment.full_state()?;
        let columns = full_state.columns();
        let is_pair = |name: &str| name.starts_with("contact_") && name != "contact_largest";
        let pairs: Vec<usize> = (0..columns.len()).filter(|column| is_pair(&columns[*column].0)).collect();
        let mut touching = |state: &[f64]| -> Vec<usize> {
            let mut values = Vec::new();
            full_state.measure(state, &mut values);
            pairs.iter().copied().filter(|column| values[*column] > 0.0).collect()
        };
        let settled = 1 + (SETTLING / self.control_dt).round() as usize;
        let (initial, later) = self.states.split_at(settled.min(self.states.len()));
        let initial: Vec<usize> = initial.iter().flat_map(|state| touching(state)).collect();
        let found = later.iter().zip(settled..).find_map(|(state, sample)| {
            let column = touching(state).into_iter().find(|column| !initial.contains(column))?;
            Some((Event { sample, decisive: None, kind: EventKind::Contact }, columns[column].0.clone()))
        });
        Ok(found)
    }
}

/// Returns the initial state of a target, as a trajectory with one state. The target is the name of
/// a task or the path of a target file.
///
/// `x0` has one value per axis of the start, in the unit of the axis. `None` selects the nominal
/// values: the center of the initial box of a task.
///
/// # Errors
/// If `x0` does not have one finite number per axis or is outside the initial boxes of all task
/// presets, or the target cannot be built.
pub fn initial_state(target: &str, x0: Option<&[f64]>) -> Result<StateTrajectory, MishandleError> {
    let (environment, scenario) = scene_start(target, x0)?;
    let mut state = vec![0.0; environment.state_size()];
    let mut observation = vec![0.0; environment.observation_size()];
    let mut signals = vec![0.0; environment.signals().len()];
    let mut rewards = vec![0.0; environment.reward_terms().len()];
    let sample = Sample { observation: &mut observation, signals: &mut signals, rewards: &mut rewards };
    if environment.worker().reset(&scenario, Seed(0), &mut state, sample) == StepStatus::Diverged {
        return Err(invalid(
            "the initial state",
            "one whose physics diverges",
            "one that settles: change `start` of the target file",
        ));
    }
    Ok(StateTrajectory {
        states: vec![state],
        control_dt: environment.control_dt(),
        target: target.to_string(),
        space: environment.space().clone(),
        environment,
        scenario,
        seed: Seed(0),
    })
}

/// Returns the samples of a filmstrip of the samples `first` to `last`: both ends, the decisive
/// sample, and samples between them. If a violation starts earlier than the decisive sample, its
/// `start` is one of them.
///
/// # Example
/// ```
/// use mishandle::picture::strip_samples;
/// assert_eq!(strip_samples(None, 90, 0, 300), [0, 30, 60, 90, 195, 300]);
/// assert_eq!(strip_samples(None, 300, 0, 300), [0, 100, 200, 300]);
/// assert_eq!(strip_samples(Some(240), 290, 0, 300), [0, 120, 240, 265, 290, 300]);
/// assert_eq!(strip_samples(Some(40), 50, 0, 300), [0, 20, 40, 50, 175, 300]);
/// assert_eq!(strip_samples(Some(10), 250, 220, 280), [220, 230, 240, 250, 265, 280]);
/// ```
pub fn strip_samples(start: Option<usize>, decisive: usize, first: usize, last: usize) -> Vec<usize> {
    let decisive = decisive.clamp(first, last);
    let mut samples = match start.filter(|start| (first..decisive).contains(start)) {
        None => {
            let third = (decisive - first) / 3;
            vec![first, first + third, decisive - third, decisive, decisive.midpoint(last), last]
        }
        Some(start) => {
            // One sample in the longer of the two spans that follow the start.
            let between = if decisive - start > last - decisive {
                start.midpoint(decisive)
            } else {
                decisive.midpoint(last)
            };
            vec![first, first.midpoint(start), start, decisive, between, last]
        }
    };
    samples.sort_unstable();
    samples.dedup();
    samples
}

/// Replays a simulation as [`replay`](crate::replay::replay()) does, and returns its states as
/// well.
///
/// # Errors
/// The errors of [`replay`](crate::replay::replay()), or if the run's target has no scene.
pub fn replay_states(
    run: &RunFile,
    trial: u32,
    number: u32,
    controller: Option<&str>,
) -> Result<(ReplayResult, StateTrajectory), MishandleError> {
    replay_states_with(run, trial, number, &recorded_plan(run.header(), controller)?)
}

/// Replays a simulation as [`replay_states`] does, with a plan that the caller has resolved.
///
/// # Errors
/// The errors of [`replay_states`].
pub fn replay_states_with(
    run: &RunFile,
    trial: u32,
    number: u32,
    resolved: &ResolvedPlan,
) -> Result<(ReplayResult, StateTrajectory), MishandleError> {
    let mut recorded = Recorded::new(resolved)?;
    let space = recorded.system.space().clone();
    let replayed = replay_in(run, trial, number, resolved, &mut *recorded.system, &space)?;
    let trajectory = recorded.trajectory(resolved, &replayed.episode.request);
    Ok((replayed, trajectory))
}

/// Simulates a request of a target with a scene, and returns its states as well.
///
/// # Errors
/// If the target has no scene, or the simulation cannot be run.
pub fn simulate_states(
    resolved: &ResolvedPlan,
    request: &Request,
) -> Result<(Episode, StateTrajectory), MishandleError> {
    let mut recorded = Recorded::new(resolved)?;
    let episode = recorded.system.rollout(std::slice::from_ref(request))?.pop();
    Ok((episode.ok_or(MishandleError::Run(RunError::NoEpisode))?, recorded.trajectory(resolved, request)))
}

/// A system that records the states of its only simulation.
pub(crate) struct Recorded {
    pub system: Box<dyn System>,
    recording: SharedRecordings,
    environment: Arc<dyn SceneEnvironment>,
}

impl Recorded {
    pub fn new(resolved: &ResolvedPlan) -> Result<Recorded, MishandleError> {
        let target = scene_target(resolved)?;
        let environment = target.environment(&resolved.space, &resolved.specification, false)?;
        let (recorder, recording) = RecordingEnvironment::new(environment.clone());
        let system = target.system_in(Arc::new(recorder), &resolved.space, &resolved.specification)?;
        Ok(Recorded { system: Box::new(system), recording, environment })
    }

    /// Returns the states of the simulation.
    pub fn states(&self) -> Vec<Vec<f64>> {
        self.recording.only().states
    }

    /// Returns the states of the simulation of a request.
    pub fn trajectory(self, resolved: &ResolvedPlan, request: &Request) -> StateTrajectory {
        StateTrajectory {
            states: self.states(),
            control_dt: self.environment.control_dt(),
            environment: self.environment,
            target: resolved.plan.target.clone(),
            space: resolved.space.clone(),
            scenario: request.scenario.clone(),
            seed: request.seed,
        }
    }
}
