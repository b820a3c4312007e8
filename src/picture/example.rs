//! The simulation of a failure, to look at.

use mishandle_rollout::{Episode, Request};
use mishandle_store::RunHeader;

use crate::error::MishandleError;
use crate::inspect::{ExplainedSimulation, explain_episode};
use crate::picture::{StateTrajectory, simulate_states};
use crate::resolve::ResolvedPlan;

/// The simulation of a controller in the scenario of a failure.
pub struct ExampleSimulation {
    /// The episode.
    pub episode: Episode,
    /// The states of its scene.
    pub trajectory: StateTrajectory,
    /// Why the failure or success is one; `None` if the simulation has no verdict.
    pub explained: Option<(RunHeader, ExplainedSimulation)>,
}

impl ExampleSimulation {
    /// Simulates a request.
    ///
    /// # Errors
    /// If the target has no scene, or the simulation cannot be run.
    pub fn new(resolved: &ResolvedPlan, request: &Request) -> Result<ExampleSimulation, MishandleError> {
        let (episode, trajectory) = simulate_states(resolved, request)?;
        let explained = episode.robustness().map(|_| explain_episode(resolved, &episode)).transpose()?;
        Ok(ExampleSimulation { episode, trajectory, explained })
    }
}
