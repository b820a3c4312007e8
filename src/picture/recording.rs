//! Environments that record what happens in them.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use mishandle_rollout::{
    Environment, EnvironmentFacts, EnvironmentWorker, Eyes, Image, RolloutError, Sample, Scenario, Seed,
    StepStatus,
};

use crate::resolve::SceneEnvironment;

/// Data that a [`RecordingEnvironment`] records of a simulation.
#[derive(Debug)]
pub(crate) struct Recording {
    pub seed: Seed,
    /// State rows, from the initial state on.
    pub states: Vec<Vec<f64>>,
    /// Observations of all samples, before noise and disturbances.
    pub observations: Vec<f32>,
    /// The action of each control step.
    pub actions: Vec<Vec<f64>>,
}

/// The recordings of an environment, which fills them while it simulates.
#[derive(Clone, Debug, Default)]
pub(crate) struct SharedRecordings(Arc<Mutex<Vec<Recording>>>);

impl SharedRecordings {
    /// Returns what was recorded of each simulation since the last call, in any order.
    pub(crate) fn take(&self) -> Vec<Recording> {
        std::mem::take(&mut *self.lock())
    }

    /// Returns what was recorded of the only simulation.
    pub(crate) fn only(&self) -> Recording {
        let none = Recording { seed: Seed(0), states: vec![], observations: vec![], actions: vec![] };
        self.take().pop().unwrap_or(none)
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Recording>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// An environment that records its simulations. The last number of a state row is the index of its
/// recording.
pub(crate) struct RecordingEnvironment {
    environment: Arc<dyn SceneEnvironment>,
    facts: EnvironmentFacts,
    recordings: SharedRecordings,
}

impl RecordingEnvironment {
    /// Makes the environment and its recordings.
    pub(crate) fn new(environment: Arc<dyn SceneEnvironment>) -> (RecordingEnvironment, SharedRecordings) {
        let recordings = SharedRecordings::default();
        let state_size = environment.state_size() + 1;
        let facts = EnvironmentFacts { state_size, ..environment.facts().clone() };
        (RecordingEnvironment { environment, facts, recordings: recordings.clone() }, recordings)
    }
}

impl Environment for RecordingEnvironment {
    fn facts(&self) -> &EnvironmentFacts {
        &self.facts
    }

    fn eyes(&self, images: &[Image]) -> Result<Arc<dyn Eyes>, RolloutError> {
        // The state of the environment comes first in a row.
        self.environment.eyes(images)
    }

    fn worker(&self) -> Box<dyn EnvironmentWorker> {
        Box::new(RecordingWorker { worker: self.environment.worker(), recordings: self.recordings.clone() })
    }
}

struct RecordingWorker {
    worker: Box<dyn EnvironmentWorker>,
    recordings: SharedRecordings,
}

impl EnvironmentWorker for RecordingWorker {
    fn reset(
        &mut self,
        scenario: &Scenario,
        seed: Seed,
        state: &mut [f64],
        sample: Sample<'_>,
    ) -> StepStatus {
        let (index, state) = split(state);
        let Sample { observation, signals, rewards } = sample;
        let sample = Sample { observation: &mut *observation, signals, rewards };
        let status = self.worker.reset(scenario, seed, state, sample);
        let mut recordings = self.recordings.lock();
        *index = recordings.len() as f64;
        recordings.push(Recording {
            seed,
            states: vec![state.to_vec()],
            observations: observation.to_vec(),
            actions: Vec::new(),
        });
        status
    }

    fn step(&mut self, action: &[f64], state: &mut [f64], sample: Sample<'_>) -> StepStatus {
        self.record(action, state, sample, EnvironmentWorker::step)
    }

    fn step_before_actions(&mut self, action: &[f64], state: &mut [f64], sample: Sample<'_>) -> StepStatus {
        self.record(action, state, sample, EnvironmentWorker::step_before_actions)
    }
}

/// Takes a control step of an environment.
type Step = fn(&mut (dyn EnvironmentWorker + 'static), &[f64], &mut [f64], Sample<'_>) -> StepStatus;

impl RecordingWorker {
    fn record(&mut self, action: &[f64], state: &mut [f64], sample: Sample<'_>, step: Step) -> StepStatus {
        let (index, state) = split(state);
        let Sample { observation, signals, rewards } = sample;
        let sample = Sample { observation: &mut *observation, signals, rewards };
        let status = step(&mut *self.worker, action, state, sample);
        if status != StepStatus::Diverged {
            let recording = &mut self.recordings.lock()[*index as usize];
            recording.states.push(state.to_vec());
            recording.observations.extend_from_slice(observation);
            recording.actions.push(action.to_vec());
        }
        status
    }
}

/// Splits a state row into the index of its recording and the state of the environment.
fn split(state: &mut [f64]) -> (&mut f64, &mut [f64]) {
    let (index, state) = state.split_last_mut().expect("a state row has the index of its recording");
    (index, state)
}
