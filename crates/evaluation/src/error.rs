use mishandle_rollout::RolloutError;

/// What can be wrong with an evaluation.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EvaluationError {
    /// The system could not run an episode.
    #[error(transparent)]
    Rollout(#[from] RolloutError),
    /// The system gave another number of episodes than it was asked for.
    #[error(
        "the system was asked for {asked} episodes and gave {given}; it has to give one for each request"
    )]
    Episodes {
        /// Number of requests.
        asked: usize,
        /// Number of episodes.
        given: usize,
    },
    /// No drawn scenario was accepted.
    #[error(
        "none of {draws} scenarios drawn for simulation {simulation} was accepted; the accepted part of the space has to \
         be larger"
    )]
    NoStart {
        /// Number of the simulation, from 1.
        simulation: u32,
        /// How many were drawn.
        draws: u64,
    },
}
