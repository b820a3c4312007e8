use crate::Seed;

/// Watches another controller and replaces its actions, for instance a guard.
///
/// A supervisor is shared and immutable. Each thread makes its own [`SupervisorWorker`].
pub trait Supervisor: Send + Sync {
    /// Returns a text that two supervisors have in common only if they do the same.
    fn identity(&self) -> &str;
    /// Returns the length of its state per simulation.
    fn state_size(&self) -> usize;
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

    /// Takes one control step of `rows` simulations. `is_usable` says whether the controller has an
    /// action in a row.
    fn supervise(&mut self, rows: usize, supervised: Supervised<'_>, is_usable: &dyn Fn(usize) -> bool);
}
