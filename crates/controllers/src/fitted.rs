use std::ops::Range;
use std::sync::Arc;

use mishandle_rollout::{Controller, ControllerFailure, ControllerWorker, Image, Seed, Signal};

use crate::{ActionLimiter, Layout};

/// A controller as it fits into an environment: it names the further parts of the observation that
/// the environment writes, reads its own, and its actions pass the limiter of its action interface.
///
/// Whatever acts on actions afterwards, such as noise and faults, is not limited. The state of a
/// simulation consists of the state of the controller and the memory of the limiter.
pub struct Fitted {
    controller: Arc<dyn Controller>,
    observation_size: usize,
    further_parts: Vec<String>,
    /// Numbers of the observation that the controller reads; `None` if it reads all.
    read: Option<Vec<Range<usize>>>,
    limiter: Option<ActionLimiter>,
}

impl Fitted {
    /// Fits a controller that reads these further parts.
    pub fn new(
        controller: Arc<dyn Controller>,
        further_parts: Vec<String>,
        limiter: Option<ActionLimiter>,
    ) -> Fitted {
        let observation_size = controller.observation_size();
        Fitted { controller, observation_size, further_parts, read: None, limiter }
    }

    /// Fits a controller into an environment with the observation of `layout`, whose further parts
    /// another one beside it reads, too. The controller reads all parts of the layout except those
    /// of `further_parts` that it does not name. A controller that reads all of them is returned as
    /// it is.
    pub fn of_layout(
        controller: Arc<dyn Controller>,
        layout: &Layout,
        further_parts: &[String],
    ) -> Arc<dyn Controller> {
        let own = controller.further_parts();
        let mut read = Vec::new();
        let mut observation_size = 0;
        for entry in &layout.observation {
            let part = observation_size..observation_size + entry.size;
            observation_size = part.end;
            if !further_parts.contains(&entry.name) || own.contains(&entry.name) {
                read.push(part);
            }
        }
        if read.len() == layout.observation.len() {
            return controller;
        }
        let further_parts = further_parts.to_vec();
        Arc::new(Fitted { controller, observation_size, further_parts, read: Some(read), limiter: None })
    }

    /// Returns the length of the memory of the limiter.
    fn memory_size(&self) -> usize {
        self.limiter.as_ref().map_or(0, ActionLimiter::memory_size)
    }
}

impl Controller for Fitted {
    fn observation_size(&self) -> usize {
        self.observation_size
    }

    fn further_parts(&self) -> &[String] {
        &self.further_parts
    }

    fn action_size(&self) -> usize {
        self.controller.action_size()
    }

    fn state_size(&self) -> usize {
        self.controller.state_size() + self.memory_size()
    }

    fn signals(&self) -> &[Signal] {
        self.controller.signals()
    }

    fn sees(&self) -> &[Image] {
        self.controller.sees()
    }

    fn worker(&self) -> Box<dyn ControllerWorker> {
        Box::new(Worker {
            controller: self.controller.worker(),
            observation_size: self.observation_size,
            read: self.read.clone(),
            limiter: self.limiter.clone(),
            size: self.controller.state_size(),
            memory_size: self.memory_size(),
            observations: Vec::new(),
            states: Vec::new(),
        })
    }
}

struct Worker {
    controller: Box<dyn ControllerWorker>,
    observation_size: usize,
    read: Option<Vec<Range<usize>>>,
    limiter: Option<ActionLimiter>,
    /// Lengths of the state of the controller and of the memory of the limiter.
    size: usize,
    memory_size: usize,
    /// Observations and states of the controller of all rows, reused.
    observations: Vec<f32>,
    states: Vec<f64>,
}

impl ControllerWorker for Worker {
    fn reset(&mut self, state: &mut [f64], seed: Seed) {
        let (own, memory) = state.split_at_mut(self.size);
        self.controller.reset(own, seed);
        if let Some(limiter) = &self.limiter {
            limiter.reset(memory);
        }
    }

    fn needs_images(&self, state: &[f64]) -> bool {
        self.controller.needs_images(&state[..self.size])
    }

    fn look(&mut self, rows: usize, images: &[u8]) {
        self.controller.look(rows, images);
    }

    fn act(&mut self, rows: usize, observations: &[f32], states: &mut [f64], actions: &mut [f32]) {
        let observations = match &self.read {
            None => observations,
            Some(read) => {
                self.observations.clear();
                for observation in observations.chunks(self.observation_size) {
                    read.iter().for_each(|part| self.observations.extend(&observation[part.clone()]));
                }
                &self.observations
            }
        };
        let Some(limiter) = self.limiter.as_ref().filter(|_| rows > 0) else {
            return self.controller.act(rows, observations, states, actions);
        };
        let stride = self.size + self.memory_size;
        self.states.clear();
        states.chunks(stride).for_each(|state| self.states.extend_from_slice(&state[..self.size]));
        self.controller.act(rows, observations, &mut self.states, actions);
        let inputs = observations.chunks(observations.len() / rows);
        let outputs = actions.chunks_mut(actions.len() / rows);
        for (row, ((state, observation), action)) in
            states.chunks_mut(stride).zip(inputs).zip(outputs).enumerate()
        {
            let (own, memory) = state.split_at_mut(self.size);
            own.copy_from_slice(&self.states[row * self.size..][..self.size]);
            if self.controller.failure(row).is_none() {
                limiter.limit(observation, memory, action);
            }
        }
    }

    fn see_signals(&mut self, state: &mut [f64], signals: &[f64]) {
        self.controller.see_signals(&mut state[..self.size], signals);
    }

    fn signals(&self, state: &[f64], signals: &mut [f64]) {
        self.controller.signals(&state[..self.size], signals);
    }

    fn failure(&self, row: usize) -> Option<&ControllerFailure> {
        self.controller.failure(row)
    }
}
