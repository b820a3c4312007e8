use mishandle_rollout::RolloutError;

/// Errors of an evaluation.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EvaluationError {
    /// The system cannot run an episode.
    #[error(transparent)]
    Rollout(#[from] RolloutError),
    /// The number of episodes differs from the number of requests.
    #[error("the system returned {returned} episodes; expected {requested}, one per request")]
    EpisodeCount {
        /// Number of requests.
        requested: usize,
        /// Number of episodes.
        returned: usize,
    },
    /// The filter rejected every random scenario.
    #[error(
        "the scenario filter rejected all {draws} random scenarios of simulation {simulation}; \
         choose a space with a larger accepted part"
    )]
    NoAcceptedScenario {
        /// Number of the simulation, from 1.
        simulation: u32,
        /// Number of random scenarios.
        draws: u64,
    },
}
