use crate::{Episode, Request, RolloutError, Space};

/// How many simulations are asked for at once if a plan says nothing else. It never depends on the number of threads,
/// so that a run has the same batches everywhere.
pub const DEFAULT_BATCH_SIZE: usize = 64;

/// What can be evaluated and falsified: it is given requests and returns episodes with verdicts.
///
/// Our tasks are systems through [`Rollout`](crate::Rollout); a closed form in a test is one, and so is any other
/// simulator.
pub trait System {
    /// The axes of the scenarios that it takes.
    fn space(&self) -> &Space;

    /// Runs the requested simulations; the episodes come in the order of the requests. An episode never depends on what
    /// it runs beside.
    ///
    /// # Errors
    /// If a scenario does not fit the space, or no simulation could be run. A diverged simulation is not an error.
    fn rollout(&mut self, requests: &[Request]) -> Result<Vec<Episode>, RolloutError>;
}
