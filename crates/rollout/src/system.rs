use crate::{Episode, InitialBox, RolloutError, Seed};

/// One simulation to run.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// Initial configuration, SI units, one value for each axis of the box.
    pub x0: Vec<f64>,
    /// Key of everything random in the simulation.
    pub seed: Seed,
}

/// What can be evaluated and falsified: given initial configurations, it returns episodes with verdicts.
///
/// Our tasks are systems through [`Rollout`](crate::Rollout); so is a closed form in a test, and so may be any other
/// simulator.
pub trait System {
    /// The initial configurations it takes.
    fn initial_box(&self) -> &InitialBox;

    /// How many simulations it likes to be asked for at once. Results never depend on it.
    fn batch_size(&self) -> usize;

    /// Runs the requested simulations; the episodes come in the order of the requests.
    ///
    /// # Errors
    /// If a request does not fit the box, or the simulation could not be run. A diverged simulation is no error.
    fn rollout(&mut self, requests: &[Request]) -> Result<Vec<Episode>, RolloutError>;
}
