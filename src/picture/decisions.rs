//! A controller that records what it sees and does.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use mishandle_rollout::{Controller, ControllerFailure, ControllerWorker, Image, Seed, Signal};

/// Observations and actions of a controller in a simulation.
#[derive(Debug)]
pub(crate) struct Decisions {
    pub seed: Seed,
    /// Observations of all control steps, as the controller saw them.
    pub observations: Vec<f32>,
    /// Actions of all control steps, before noise and disturbances.
    pub actions: Vec<f32>,
    /// Images of all control steps, as the controller saw them; empty if they are not kept.
    pub images: Vec<u8>,
}

/// The decisions of all simulations, in any order.
#[derive(Clone, Debug, Default)]
pub(crate) struct SharedDecisions(Arc<Mutex<Vec<Decisions>>>);

impl SharedDecisions {
    /// Returns the decisions since the last call.
    pub fn take(&self) -> Vec<Decisions> {
        std::mem::take(&mut *self.lock())
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Decisions>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A controller that records its decisions. The first number of its state is the index of the
/// simulation, the others are the state of the controller that decides.
pub(crate) struct RecordedController {
    controller: Arc<dyn Controller>,
    decisions: SharedDecisions,
    keeps_images: bool,
}

impl RecordedController {
    pub fn new(
        controller: Arc<dyn Controller>,
        decisions: SharedDecisions,
        keeps_images: bool,
    ) -> RecordedController {
        RecordedController { controller, decisions, keeps_images }
    }
}

impl Controller for RecordedController {
    fn observation_size(&self) -> usize {
        self.controller.observation_size()
    }

    fn action_size(&self) -> usize {
        self.controller.action_size()
    }

    fn state_size(&self) -> usize {
        1 + self.controller.state_size()
    }

    fn signals(&self) -> &[Signal] {
        self.controller.signals()
    }

    fn sees(&self) -> &[Image] {
        self.controller.sees()
    }

    fn worker(&self) -> Box<dyn ControllerWorker> {
        Box::new(RecordedWorker {
            worker: self.controller.worker(),
            decisions: self.decisions.clone(),
            state_size: self.controller.state_size(),
            states: Vec::new(),
            keeps_images: self.keeps_images,
            images: Vec::new(),
        })
    }
}

struct RecordedWorker {
    worker: Box<dyn ControllerWorker>,
    decisions: SharedDecisions,
    state_size: usize,
    /// States of the controller that decides, without the indices.
    states: Vec<f64>,
    keeps_images: bool,
    /// Images of the next control step of all rows, if they are kept.
    images: Vec<u8>,
}

impl ControllerWorker for RecordedWorker {
    fn reset(&mut self, state: &mut [f64], seed: Seed) {
        let mut decisions = self.decisions.lock();
        state[0] = decisions.len() as f64;
        let observations = Vec::new();
        let actions = Vec::new();
        let images = Vec::new();
        decisions.push(Decisions { seed, observations, actions, images });
        drop(decisions);
        self.worker.reset(&mut state[1..], seed);
    }

    fn needs_images(&self, state: &[f64]) -> bool {
        self.keeps_images || self.worker.needs_images(&state[1..])
    }

    fn look(&mut self, rows: usize, images: &[u8]) {
        if self.keeps_images {
            self.images.clear();
            self.images.extend_from_slice(images);
        }
        self.worker.look(rows, images);
    }

    fn act(&mut self, rows: usize, observations: &[f32], states: &mut [f64], actions: &mut [f32]) {
        let width = 1 + self.state_size;
        self.states.clear();
        states.chunks_exact(width).for_each(|state| self.states.extend_from_slice(&state[1..]));
        self.worker.act(rows, observations, &mut self.states, actions);
        let seen = observations.len() / rows.max(1);
        let done = actions.len() / rows.max(1);
        let bytes = self.images.len() / rows.max(1);
        let mut decisions = self.decisions.lock();
        for (row, state) in states.chunks_exact_mut(width).enumerate() {
            state[1..].copy_from_slice(&self.states[row * self.state_size..][..self.state_size]);
            let decisions = &mut decisions[state[0] as usize];
            decisions.observations.extend_from_slice(&observations[row * seen..][..seen]);
            decisions.actions.extend_from_slice(&actions[row * done..][..done]);
            decisions.images.extend_from_slice(&self.images[row * bytes..][..bytes]);
        }
    }

    fn see_signals(&mut self, state: &mut [f64], signals: &[f64]) {
        self.worker.see_signals(&mut state[1..], signals);
    }

    fn signals(&self, state: &[f64], signals: &mut [f64]) {
        self.worker.signals(&state[1..], signals);
    }

    fn failure(&self, row: usize) -> Option<&ControllerFailure> {
        self.worker.failure(row)
    }
}
