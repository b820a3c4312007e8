use std::sync::Arc;

use mishandle_rollout::{
    ControllerFailure, ControllerWorker, Seed, Signal, Supervised, Supervisor, SupervisorWorker,
};

use crate::guard::fallback::Actions;
use crate::guard::{Fallback, GuardError, Switch, Watch};

/// Signal of a trace: 1 if the action of the control step before the sample came from the fallback,
/// otherwise 0.
pub const ACTIVE: &str = "guard_active";

/// Signal of a trace: the robustness that decided about the action of the control step before the
/// sample, within ±[`MAX_ROBUSTNESS`]; 0 in the first sample.
pub const ROBUSTNESS: &str = "guard_robustness";

/// Largest absolute value of the signal [`ROBUSTNESS`], which is finite as every signal.
pub const MAX_ROBUSTNESS: f64 = 1e9;

/// Places of the own numbers of a state. The watch, the fallback and its actions follow.
mod place {
    /// Control steps for which the fallback has acted without a break.
    pub const STEPS: usize = 0;
    /// The last robustness.
    pub const ROBUSTNESS: usize = 1;
    /// Both halves of the seed, for the fallback.
    pub const SEED: usize = 2;
    /// Number of own numbers.
    pub const COUNT: usize = 4;
}

/// A formula, a switch and a fallback: what a controller is guarded by.
#[derive(Clone)]
pub struct Guard(Arc<Parts>);

struct Parts {
    identity: String,
    watch: Watch,
    switch: Switch,
    fallback: Fallback,
    is_privileged: bool,
    observation_size: usize,
    action_size: usize,
    signals: [Signal; 2],
}

impl Guard {
    /// Makes a guard of controllers with these sizes of observation and action. The quantities of
    /// `watch` are the numbers of the observation, or the signals of the environment if the guard
    /// `is_privileged`. Guards that do the same have the same `identity`.
    ///
    /// # Errors
    /// If the fallback has other sizes, or the switch a way back that the formula does not allow.
    pub fn new(
        identity: String,
        watch: Watch,
        switch: Switch,
        fallback: Fallback,
        is_privileged: bool,
        observation_size: usize,
        action_size: usize,
    ) -> Result<Guard, GuardError> {
        if switch.has_way_back() && !watch.is_past() {
            return Err(GuardError::NoWayBack { formula: watch.formula().to_string() });
        }
        let (found_observation, found_action) = match &fallback {
            Fallback::Controller(controller) => (controller.observation_size(), controller.action_size()),
            Fallback::Hold(motion) | Fallback::Retreat(motion, _) => {
                (observation_size, motion.meanings.len())
            }
        };
        if (found_observation, found_action) != (observation_size, action_size) {
            return Err(GuardError::Fallback {
                found_observation,
                found_action,
                observation: observation_size,
                action: action_size,
            });
        }
        let signals = [ACTIVE, ROBUSTNESS].map(|name| Signal { name: name.to_string(), unit: String::new() });
        Ok(Guard(Arc::new(Parts {
            identity,
            watch,
            switch,
            fallback,
            is_privileged,
            observation_size,
            action_size,
            signals,
        })))
    }

    /// Returns the signals that a guarded controller adds to traces.
    pub(crate) fn signals(&self) -> &[Signal] {
        &self.0.signals
    }

    /// Makes a worker for one thread.
    pub(crate) fn guard_worker(&self) -> GuardWorker {
        let Guard(parts) = self;
        GuardWorker {
            watch: parts.watch.clone(),
            fallback: match &parts.fallback {
                Fallback::Controller(controller) => Some(controller.worker()),
                Fallback::Hold(_) | Fallback::Retreat(..) => None,
            },
            rows: Vec::new(),
            observations: Vec::new(),
            states: Vec::new(),
            actions: Vec::new(),
            guard: parts.clone(),
        }
    }
}

impl Parts {
    fn fallback_state_size(&self) -> usize {
        match &self.fallback {
            Fallback::Controller(controller) => controller.state_size(),
            Fallback::Hold(_) | Fallback::Retreat(..) => {
                Actions::state_size(self.fallback.remembered(), self.action_size)
            }
        }
    }
}

/// A guard as the supervisor of any controller.
impl Supervisor for Guard {
    fn identity(&self) -> &str {
        &self.0.identity
    }

    fn state_size(&self) -> usize {
        place::COUNT + self.0.watch.state_size() + self.0.fallback_state_size()
    }

    fn worker(&self) -> Box<dyn SupervisorWorker> {
        Box::new(self.guard_worker())
    }
}

/// A [`Guard`] on one thread. Its buffers are reused, so that a control step does not allocate.
pub(crate) struct GuardWorker {
    guard: Arc<Parts>,
    watch: Watch,
    fallback: Option<Box<dyn ControllerWorker>>,
    /// Rows in which the fallback controller acts.
    rows: Vec<usize>,
    /// Their observations, states and actions.
    observations: Vec<f32>,
    states: Vec<f64>,
    actions: Vec<f32>,
}

impl GuardWorker {
    /// Returns whether the guard never acts.
    pub(crate) fn only_watches(&self) -> bool {
        self.guard.switch.only_watches()
    }

    /// Adds a sample to the watch of a simulation.
    fn push(&mut self, state: &mut [f64], quantity: impl Fn(usize) -> f64) {
        let (own, rest) = state.split_at_mut(place::COUNT);
        own[place::ROBUSTNESS] = self.watch.push(&mut rest[..self.watch.state_size()], quantity);
    }

    /// Decides who acts in a row, and starts the fallback at the hand-over. Returns whether the
    /// fallback acts.
    fn decide(&mut self, state: &mut [f64], is_usable: bool) -> bool {
        let (own, rest) = state.split_at_mut(place::COUNT);
        let before = own[place::STEPS] as usize;
        let is_active = self.guard.switch.is_active(before, own[place::ROBUSTNESS], is_usable);
        own[place::STEPS] = if is_active { before as f64 + 1.0 } else { 0.0 };
        if let (true, 0, Some(fallback)) = (is_active, before, &mut self.fallback) {
            let size = self.guard.fallback_state_size();
            fallback.reset(&mut rest[self.watch.state_size()..][..size], seed(own));
        }
        is_active
    }

    /// Lets the fallback controller act in the collected rows.
    fn act(&mut self, observations: &[f32], states: &mut [f64], stride: usize, actions: &mut [f32]) {
        let Some(fallback) = self.fallback.as_mut().filter(|_| !self.rows.is_empty()) else {
            return;
        };
        let observation_size = self.guard.observation_size;
        let action_size = self.guard.action_size;
        let first = place::COUNT + self.watch.state_size();
        let size = self.guard.fallback_state_size();
        self.observations.clear();
        self.states.clear();
        for row in &self.rows {
            self.observations.extend_from_slice(&observations[row * observation_size..][..observation_size]);
            self.states.extend_from_slice(&states[row * stride + first..][..size]);
        }
        self.actions.clear();
        self.actions.resize(self.rows.len() * action_size, 0.0);
        fallback.act(self.rows.len(), &self.observations, &mut self.states, &mut self.actions);
        for (index, row) in self.rows.iter().enumerate() {
            states[row * stride + first..][..size].copy_from_slice(&self.states[index * size..][..size]);
            actions[row * action_size..][..action_size]
                .copy_from_slice(&self.actions[index * action_size..][..action_size]);
        }
    }
}

impl GuardWorker {
    /// Shows a privileged guard the signals of the environment in the sample whose observation
    /// comes next.
    pub(crate) fn see_signals(&mut self, state: &mut [f64], signals: &[f64]) {
        if self.guard.is_privileged {
            self.push(state, |column| signals[column]);
        }
    }

    /// Returns whether the guard may use the next action of the controller.
    pub(crate) fn needs_action(&self, state: &[f64]) -> bool {
        state[place::STEPS] == 0.0 || self.guard.switch.has_way_back()
    }

    /// Returns why the fallback has no action in a row of the last step.
    pub(crate) fn failure(&self, row: usize) -> Option<&ControllerFailure> {
        let index = self.rows.iter().position(|acting| *acting == row)?;
        self.fallback.as_ref()?.failure(index)
    }

    /// Returns whether the fallback acted in the last control step of a simulation.
    fn is_active(&self, state: &[f64]) -> bool {
        state[place::STEPS] > 0.0
    }

    /// Writes the signals of the guard after its last action.
    pub(crate) fn signals(&self, state: &[f64], signals: &mut [f64]) {
        let robustness = state[place::ROBUSTNESS].clamp(-MAX_ROBUSTNESS, MAX_ROBUSTNESS);
        signals.copy_from_slice(&[f64::from(u8::from(self.is_active(state))), robustness]);
    }
}

impl SupervisorWorker for GuardWorker {
    fn reset(&mut self, state: &mut [f64], seed: Seed) {
        let (own, rest) = state.split_at_mut(place::COUNT);
        let (watch, rest) = rest.split_at_mut(self.watch.state_size());
        own.fill(0.0);
        // Each half is a whole number that a float represents.
        own[place::SEED] = f64::from((seed.0 >> 32) as u32);
        own[place::SEED + 1] = f64::from(seed.0 as u32);
        self.watch.reset(watch);
        rest[..self.guard.fallback_state_size()].fill(0.0);
    }

    fn supervise(&mut self, rows: usize, supervised: Supervised<'_>, is_usable: &dyn Fn(usize) -> bool) {
        let Supervised { observations, states, stride, actions } = supervised;
        let observation_size = self.guard.observation_size;
        let action_size = self.guard.action_size;
        let first = place::COUNT + self.watch.state_size();
        self.rows.clear();
        for row in 0..rows {
            let state = &mut states[row * stride..][..stride];
            let observation = &observations[row * observation_size..][..observation_size];
            if !self.guard.is_privileged {
                self.push(state, |column| f64::from(observation[column]));
            }
            let is_active = self.decide(state, is_usable(row));
            let action = &mut actions[row * action_size..][..action_size];
            let size = self.guard.fallback_state_size();
            let mut remembered = Actions(&mut state[first..][..size]);
            match (&self.guard.fallback, is_active) {
                (Fallback::Controller(_), true) => self.rows.push(row),
                (Fallback::Controller(_), false) => {}
                (Fallback::Hold(motion), true) => remembered.hold(motion, action),
                (Fallback::Retreat(motion, _), true) => remembered.retreat(motion, action),
                (Fallback::Hold(motion) | Fallback::Retreat(motion, _), false) => {
                    remembered.push(action, motion.limit);
                }
            }
        }
        self.act(observations, states, stride, actions);
    }
}

/// Returns the seed that [`GuardWorker::reset`] stored.
fn seed(own: &[f64]) -> Seed {
    Seed((own[place::SEED] as u64) << 32 | own[place::SEED + 1] as u64)
}
