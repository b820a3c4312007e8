use mishandle_rollout::RolloutError;
use mishandle_search::SearchError;

/// What can be wrong with a falsification.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FalsificationError {
    /// A campaign without trials, or trials without simulations.
    #[error("a campaign of 0 {what} was asked for; it needs at least 1")]
    Empty {
        /// What there was none of.
        what: &'static str,
    },
    /// The search proposes points of another dimension than the space has axes.
    #[error("the search `{search}` has dimension {found}, the space has {wanted} axes")]
    Dimension {
        /// Name of the search.
        search: &'static str,
        /// Its dimension.
        found: usize,
        /// Axes of the space.
        wanted: usize,
    },
    /// The system could not run an episode.
    #[error(transparent)]
    Rollout(#[from] RolloutError),
    /// The search could not be made, or refused what it was told.
    #[error(transparent)]
    Search(#[from] SearchError),
    /// A search gave no point though it has not ended and no value is awaited.
    #[error(
        "the search `{search}` gave no point in trial {trial}, though it has not ended and awaits no value"
    )]
    Stalled {
        /// Name of the search.
        search: &'static str,
        /// Number of the trial.
        trial: u32,
    },
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
    /// An episode ran to its end and left the formula undecided, so every other one would too.
    #[error(
        "simulation {number} of trial {trial} ran to its end and left the formula undecided; \
         the formula's intervals have to lie within the episode"
    )]
    Undecidable {
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation.
        number: u32,
    },
    /// A robustness that is no number.
    #[error(
        "the robustness of simulation {number} of trial {trial}, with scenario {scenario:?}, is NaN; it has to be a number"
    )]
    NotANumber {
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation.
        number: u32,
        /// Its scenario.
        scenario: Vec<Option<f64>>,
    },
    /// A recorded simulation of a trial that the campaign does not have.
    #[error("simulation {number} of trial {trial} is recorded, but the campaign has {trials} trials")]
    UnknownTrial {
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation.
        number: u32,
        /// Trials of the campaign.
        trials: u32,
    },
    /// A recorded simulation that is not the next one of its trial.
    #[error("simulation {found} of trial {trial} is recorded where simulation {wanted} has to come next")]
    OutOfOrder {
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation found.
        found: u32,
        /// Number of the simulation that comes next.
        wanted: u32,
    },
    /// A recorded simulation after the end of its trial.
    #[error("simulation {number} of trial {trial} is recorded, but the trial ended with simulation {last}")]
    PastTheEnd {
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation.
        number: u32,
        /// Number of the trial's last simulation.
        last: u32,
    },
    /// What was recorded is not what the trial now asks for.
    #[error(
        "simulation {number} of trial {trial} was recorded {recorded}, but the trial now asks for one {asked}: \
         the run was made by another build or with other settings and has to be resumed with those"
    )]
    OtherBuild {
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation.
        number: u32,
        /// Point, scenario and seed that were recorded.
        recorded: String,
        /// Those asked for now.
        asked: String,
    },
}
