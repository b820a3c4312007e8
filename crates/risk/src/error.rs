use mishandle_rollout::RolloutError;
use mishandle_search::SearchError;

/// Errors of the estimation of a failure probability.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RiskError {
    /// A simulation cannot be run.
    #[error(transparent)]
    Rollout(#[from] RolloutError),
    /// The search cannot be made, or rejects an observation.
    #[error(transparent)]
    Search(#[from] SearchError),
    /// The number of episodes differs from the number of requests.
    #[error("the system returned {returned} episodes; expected {requested}, one per request")]
    EpisodeCount {
        /// Number of requests.
        requested: usize,
        /// Number of episodes.
        returned: usize,
    },
    /// A distribution is declared for an axis that the space lacks.
    #[error("the space has no axis `{name}` to have a distribution; its axes are: {}", known.join(", "))]
    UnknownAxis {
        /// The name.
        name: String,
        /// Names of the axes.
        known: Vec<String>,
    },
    /// The text of a distribution cannot be read.
    #[error("the distribution `{text}` is unknown; expected {expected}")]
    Syntax {
        /// The text.
        text: String,
        /// The known distributions.
        expected: &'static str,
    },
    /// A distribution does not fit its axis.
    #[error("the axis {axis} cannot have the distribution {distribution}: {problem}")]
    Distribution {
        /// Name of the axis.
        axis: String,
        /// The distribution.
        distribution: String,
        /// The reason.
        problem: String,
    },
    /// Every axis of the space has a fixed value, and the target does not depend on the seed.
    #[error("nothing is random: every axis of the space is fixed; choose a space with axes that vary")]
    NothingRandom,
    /// The method `sequence` has nothing to choose during a simulation.
    #[error(
        "the method `sequence` is for tasks only: it needs a free axis that disturbs actions from some time on, as the \
         spaces `noise` and `disturbance` of a task have; the other methods are for every target"
    )]
    NotSteerable,
}
