use crate::{ControllerFailure, Seed, Signal};

/// Watches another controller and replaces its actions, for instance a guard.
///
/// A supervisor is shared and immutable. Each thread makes its own [`SupervisorWorker`].
pub trait Supervisor: Send + Sync {
    /// Returns a text that two supervisors have in common only if they do the same.
    fn identity(&self) -> &str;
    /// Returns the length of its state per simulation.
    fn state_size(&self) -> usize;
    /// Returns the signals that it adds to traces.
    fn signals(&self) -> &[Signal];
    /// Returns whether it reads the signals of the environment, which the controller does not see.
    fn is_privileged(&self) -> bool;
    /// Makes a worker for one thread.
    fn worker(&self) -> Box<dyn SupervisorWorker>;
}

/// Inputs and outputs of a supervisor in some simulations. All slices are row-major.
#[derive(Debug)]
pub struct Supervised<'a> {
    /// The observations of the controller, `[rows, observation_size]`.
    pub observations: &'a [f32],
    /// Rows whose first `state_size` numbers are the states of the supervisor, `[rows, stride]`.
    pub states: &'a mut [f64],
    /// Length of a row of the states.
    pub stride: usize,
    /// The actions of the controller, `[rows, action_size]`, and then those of the supervisor.
    pub actions: &'a mut [f32],
}

/// Supervises any number of simulations on one thread. A row's result does not depend on the other
/// rows.
pub trait SupervisorWorker: Send {
    /// Writes the state of a new simulation.
    fn reset(&mut self, state: &mut [f64], seed: Seed);

    /// Shows a privileged supervisor the signals of the environment in the sample whose observation
    /// comes next.
    fn see_signals(&mut self, state: &mut [f64], signals: &[f64]);

    /// Returns whether the supervisor may use the next action of the controller.
    fn needs_action(&self, state: &[f64]) -> bool;

    /// Takes one control step of `rows` simulations. `is_usable` says whether the controller has an
    /// action in a row.
    fn supervise(&mut self, rows: usize, supervised: Supervised<'_>, is_usable: &dyn Fn(usize) -> bool);

    /// Returns why the supervisor has no action in a row of the last step.
    fn failure(&self, row: usize) -> Option<&ControllerFailure>;

    /// Returns whether the supervisor replaced the action of a simulation in its last control step.
    fn is_active(&self, state: &[f64]) -> bool;

    /// Writes its signals after its last action.
    fn signals(&self, state: &[f64], signals: &mut [f64]);
}
