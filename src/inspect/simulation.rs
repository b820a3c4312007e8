//! Simulations of a chosen scenario.

use mishandle_random::Seed;
use mishandle_results::Simulation;
use mishandle_rollout::{Episode, Request, Scenario};
use mishandle_store::RunHeader;

use crate::error::MishandleError;
use crate::inspect::explain_episode;
use crate::resolve::ResolvedPlan;
use crate::run::{header, simulation_result};

/// A simulation that is in no run file.
#[derive(Debug)]
pub struct Simulated {
    /// Describes the simulation as the header of a run.
    pub header: RunHeader,
    /// The episode.
    pub episode: Episode,
    /// The result, with an explanation if the simulation has a verdict.
    pub result: Simulation,
}

/// Simulates a scenario once with each seed.
///
/// # Errors
/// If a simulation cannot be run or explained.
pub fn simulate(
    resolved: &ResolvedPlan,
    scenario: &Scenario,
    seeds: impl IntoIterator<Item = Seed>,
) -> Result<Vec<Simulated>, MishandleError> {
    let requests: Vec<Request> = seeds.into_iter().map(|seed| Request::new(scenario.clone(), seed)).collect();
    let episodes = resolved.system()?.rollout(&requests)?;
    episodes.into_iter().map(|episode| simulated(resolved, episode)).collect()
}

/// Describes an episode of a plan.
///
/// # Errors
/// If the episode cannot be explained.
pub fn simulated(resolved: &ResolvedPlan, episode: Episode) -> Result<Simulated, MishandleError> {
    let (header, explanation) = match episode.robustness() {
        Some(_) => {
            let (header, explained) = explain_episode(resolved, &episode)?;
            let explanation = explained.result(&header, None);
            (header, Some(explanation))
        }
        None => (header::header(resolved), None),
    };
    let mut result = simulation_result(resolved, &episode, explanation);
    // Repeats have seeds of their own.
    result.subject.seed = mishandle_results::Seed(episode.request.seed.0);
    Ok(Simulated { header, episode, result })
}
