use crate::steering::not_steerable;
use crate::{Episode, Request, RolloutError, Space, Steerable, SteeredEpisode, Steering};

/// Default number of simulations per batch. It does not depend on the number of threads, so that a
/// run has the same batches on every machine.
pub const DEFAULT_BATCH_SIZE: usize = 64;

/// A system under test: simulates requests and returns episodes with verdicts.
///
/// The manipulation tasks implement it through [`Rollout`](crate::Rollout). Any other simulator, or
/// a function in closed form, can implement it directly.
pub trait System {
    /// Returns the space of the scenarios that the system accepts.
    fn space(&self) -> &Space;

    /// Runs the requested simulations and returns one episode per request, in the same order.
    ///
    /// An episode does not depend on the other requests.
    ///
    /// # Errors
    /// If a scenario does not fit the space or a simulation cannot run. A diverged simulation is
    /// not an error.
    fn rollout(&mut self, requests: &[Request]) -> Result<Vec<Episode>, RolloutError>;

    /// Returns what a [`Steering`] can choose while a simulation runs; `None` if the simulations
    /// cannot be steered.
    fn steerable(&self) -> Option<Steerable> {
        None
    }

    /// Runs the requested simulations, in which `steering` replaces the values of the steered axes.
    /// A request has values for them, too, which later ones keep if the simulation ends before.
    ///
    /// # Errors
    /// As [`rollout`](Self::rollout), or if the simulations cannot be steered.
    fn rollout_steered(
        &mut self,
        requests: &[Request],
        steering: &dyn Steering,
    ) -> Result<Vec<SteeredEpisode>, RolloutError> {
        let _ = (requests, steering);
        Err(not_steerable())
    }
}
