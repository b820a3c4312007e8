use std::sync::Arc;

use mishandle_rollout::{
    Controller, ControllerFailure, ControllerWorker, Image, Seed, Signal, Supervised, Supervisor,
    SupervisorWorker,
};

use crate::guard::Guard;
use crate::guard::supervisor::GuardWorker;

/// A controller with its guard.
///
/// A controller that fails, or whose action is not finite, has no action: the fallback acts.
pub struct Guarded {
    controller: Arc<dyn Controller>,
    guard: Guard,
}

impl Guarded {
    /// Guards a controller. Its sizes must be those of the guard.
    pub fn new(controller: Arc<dyn Controller>, guard: Guard) -> Guarded {
        Guarded { controller, guard }
    }
}

impl Controller for Guarded {
    fn observation_size(&self) -> usize {
        self.controller.observation_size()
    }

    fn further_parts(&self) -> &[String] {
        self.controller.further_parts()
    }

    fn action_size(&self) -> usize {
        self.controller.action_size()
    }

    /// The guard's state, and then that of the controller.
    fn state_size(&self) -> usize {
        self.guard.state_size() + self.controller.state_size()
    }

    fn signals(&self) -> &[Signal] {
        self.guard.signals()
    }

    fn sees(&self) -> &[Image] {
        self.controller.sees()
    }

    fn worker(&self) -> Box<dyn ControllerWorker> {
        Box::new(Worker {
            controller: self.controller.worker(),
            guard: self.guard.guard_worker(),
            guard_size: self.guard.state_size(),
            size: self.controller.state_size(),
            rows: Vec::new(),
            usable: Vec::new(),
            images: Vec::new(),
            seen: Vec::new(),
            observations: Vec::new(),
            states: Vec::new(),
            actions: Vec::new(),
        })
    }
}

struct Worker {
    controller: Box<dyn ControllerWorker>,
    guard: GuardWorker,
    guard_size: usize,
    /// Length of the state of the controller.
    size: usize,
    /// Rows in which the controller acts, and whether it has an action in each row.
    rows: Vec<usize>,
    usable: Vec<bool>,
    /// Images of all rows, and of these rows.
    images: Vec<u8>,
    seen: Vec<u8>,
    /// Observations, states and actions of these rows.
    observations: Vec<f32>,
    states: Vec<f64>,
    actions: Vec<f32>,
}

impl ControllerWorker for Worker {
    fn reset(&mut self, state: &mut [f64], seed: Seed) {
        let (guard, own) = state.split_at_mut(self.guard_size);
        self.guard.reset(guard, seed);
        self.controller.reset(own, seed);
    }

    fn needs_images(&self, state: &[f64]) -> bool {
        self.guard.needs_action(state) && self.controller.needs_images(&state[self.guard_size..])
    }

    fn look(&mut self, _rows: usize, images: &[u8]) {
        self.images.clear();
        self.images.extend_from_slice(images);
    }

    fn act(&mut self, rows: usize, observations: &[f32], states: &mut [f64], actions: &mut [f32]) {
        if rows == 0 {
            return;
        }
        let stride = states.len() / rows;
        let observation_size = observations.len() / rows;
        let action_size = actions.len() / rows;
        let needs = |row: &usize| self.guard.needs_action(&states[row * stride..][..stride]);
        self.rows.clear();
        self.rows.extend((0..rows).filter(needs));
        self.observations.clear();
        self.states.clear();
        for row in &self.rows {
            self.observations.extend_from_slice(&observations[row * observation_size..][..observation_size]);
            self.states.extend_from_slice(&states[row * stride + self.guard_size..][..self.size]);
        }
        self.actions.clear();
        self.actions.resize(self.rows.len() * action_size, 0.0);
        let bytes = self.images.len() / rows;
        if bytes > 0 {
            self.seen.clear();
            for row in &self.rows {
                self.seen.extend_from_slice(&self.images[row * bytes..][..bytes]);
            }
            self.controller.look(self.rows.len(), &self.seen);
        }
        if !self.rows.is_empty() {
            self.controller.act(self.rows.len(), &self.observations, &mut self.states, &mut self.actions);
        }
        actions.fill(0.0);
        self.usable.clear();
        self.usable.resize(rows, false);
        for (index, row) in self.rows.iter().enumerate() {
            let action = &self.actions[index * action_size..][..action_size];
            states[row * stride + self.guard_size..][..self.size]
                .copy_from_slice(&self.states[index * self.size..][..self.size]);
            actions[row * action_size..][..action_size].copy_from_slice(action);
            self.usable[*row] =
                self.controller.failure(index).is_none() && action.iter().all(|value| value.is_finite());
        }
        let usable = &self.usable;
        self.guard.supervise(
            rows,
            Supervised { observations, states, stride, actions },
            // A row that needed no action has the fallback, and keeps it.
            &|row| usable[row],
        );
    }

    fn see_signals(&mut self, state: &mut [f64], signals: &[f64]) {
        self.guard.see_signals(&mut state[..self.guard_size], signals);
    }

    fn signals(&self, state: &[f64], signals: &mut [f64]) {
        self.guard.signals(&state[..self.guard_size], signals);
    }

    fn failure(&self, row: usize) -> Option<&ControllerFailure> {
        if self.guard.only_watches() {
            let index = self.rows.iter().position(|acting| *acting == row)?;
            return self.controller.failure(index);
        }
        self.guard.failure(row)
    }
}
