use crate::{EpisodeEnd, Image, Seed, Signal};

/// A policy: computes actions from observations.
///
/// A controller is shared and immutable. Each thread makes its own [`ControllerWorker`].
pub trait Controller: Send + Sync {
    /// Returns the length of an observation.
    fn observation_size(&self) -> usize;
    /// Returns the names of the further parts of an observation that the controller reads, in the
    /// order of the environment. They follow the parts that the environment always has. By default,
    /// it reads none.
    fn further_parts(&self) -> &[String] {
        &[]
    }
    /// Returns the number of actions.
    fn action_size(&self) -> usize;
    /// Returns the length of the controller's state per simulation; 0 if it is stateless.
    fn state_size(&self) -> usize {
        0
    }
    /// Returns the signals that the controller adds to traces, after those of the environment.
    fn signals(&self) -> &[Signal] {
        &[]
    }
    /// Returns the images that the controller gets; none by default.
    fn sees(&self) -> &[Image] {
        &[]
    }
    /// Makes a worker for one thread.
    fn worker(&self) -> Box<dyn ControllerWorker>;
}

/// Computes the actions of a [`Controller`] on one thread, for any number of simulations at once.
///
/// The actions of a row do not depend on the other rows or their number.
pub trait ControllerWorker: Send {
    /// Writes the controller's initial state of a new simulation.
    ///
    /// Random draws must come from [`Stream::Policy`](crate::Stream::Policy) of `seed`.
    fn reset(&mut self, _state: &mut [f64], _seed: Seed) {}

    /// Returns whether the actions of a controller that [sees](Controller::sees), from the next call
    /// of [`act`](Self::act) on, depend on the present images of a row with this state. By default,
    /// they do.
    fn needs_images(&self, _state: &[f64]) -> bool {
        true
    }

    /// Shows a controller that [sees](Controller::sees) the images of the next call of
    /// [`act`](Self::act): those of each row, one row after another. A row that [does not need
    /// them](Self::needs_images) may have any bytes.
    fn look(&mut self, _rows: usize, _images: &[u8]) {}

    /// Computes the actions of `rows` simulations and updates the controller's states.
    ///
    /// All slices are row-major: `observations` is `[rows, observation_size]`, `states` is
    /// `[rows, state_size]`, and `actions` is `[rows, action_size]`.
    fn act(&mut self, rows: usize, observations: &[f32], states: &mut [f64], actions: &mut [f32]);

    /// Shows a controller with [signals](Controller::signals) of its own those of the environment,
    /// in the sample whose observation comes next. Only a privileged controller uses them.
    fn see_signals(&mut self, _state: &mut [f64], _signals: &[f64]) {}

    /// Writes the [signals](Controller::signals) of the controller after its last action; before
    /// the first one, those after the reset.
    fn signals(&self, _state: &[f64], _signals: &mut [f64]) {}

    /// Returns why the last call of [`act`](Self::act) has no action of a row, for controllers that
    /// can fail.
    fn failure(&self, _row: usize) -> Option<&ControllerFailure> {
        None
    }
}

/// Why a controller has no action.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ControllerFailure {
    /// Whether it took longer than its time limit. Otherwise it ended, or answered something else
    /// than an action.
    pub is_timeout: bool,
    /// Reason in words.
    pub reason: String,
}

impl ControllerFailure {
    /// Returns the end of a simulation whose controller failed in control step `step`.
    pub fn end(&self, step: usize) -> EpisodeEnd {
        if self.is_timeout { EpisodeEnd::TimedOut { step } } else { EpisodeEnd::Crashed { step } }
    }
}
