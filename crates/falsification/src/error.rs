use mishandle_results::PhysicsCheck;
use mishandle_rollout::RolloutError;
use mishandle_search::SearchError;

/// Errors of a falsification.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FalsificationError {
    /// A falsification has no trials, or its trials have no simulations.
    #[error("the number of {what} is 0; expected at least 1")]
    Empty {
        /// `trials` or `simulations per trial`.
        what: &'static str,
    },
    /// A value is out of its range.
    #[error("{what} is {value}; it must be {expected}")]
    InvalidValue {
        /// Meaning of the value.
        what: &'static str,
        /// The value.
        value: String,
        /// Allowed values.
        expected: &'static str,
    },
    /// A relation changes an axis in a way that does not fit it.
    #[error("the change of the axis {axis} is {change}; it must be {expected}")]
    Change {
        /// Name of the axis.
        axis: String,
        /// The change.
        change: String,
        /// Allowed changes.
        expected: String,
    },
    /// All follow-up cases of a relation are outside of the bounds of its axes.
    #[error(
        "the relation `{relation}` has no follow-up case in {pairs} pairs: all are outside of the bounds of its axes, {bounds}"
    )]
    NoFollowUp {
        /// Name of the relation.
        relation: String,
        /// Number of pairs.
        pairs: u64,
        /// The bounds of the changed axes, in words.
        bounds: String,
    },
    /// The simulation is not a counterexample.
    #[error("the robustness of the simulation is {robustness}; a counterexample violates the requirement")]
    NotACounterexample {
        /// Robustness of the simulation, or the reason why it has none.
        robustness: String,
    },
    /// The violation vanishes under a change of the physics that no real robot would notice.
    #[error("simulation {simulation} of trial {trial} {}", crate::physics_text(check))]
    DependsOnSolver {
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation within the trial.
        simulation: u32,
        /// The check of its physics.
        check: PhysicsCheck,
    },
    /// The dimension of the search differs from the number of axes of the space.
    #[error(
        "the search `{search}` has dimension {found}; expected {expected}, the number of axes of the space"
    )]
    Dimension {
        /// Name of the search.
        search: &'static str,
        /// Dimension of the search.
        found: usize,
        /// Number of axes of the space.
        expected: usize,
    },
    /// The system cannot run an episode.
    #[error(transparent)]
    Rollout(#[from] RolloutError),
    /// The search cannot be made, or rejects an observation.
    #[error(transparent)]
    Search(#[from] SearchError),
    /// A search proposes no point, although it has not ended and waits for no observation.
    #[error(
        "the search `{search}` proposed no point in trial {trial}, although it has not ended and waits for no observation"
    )]
    Stalled {
        /// Name of the search.
        search: &'static str,
        /// Number of the trial.
        trial: u32,
    },
    /// The number of episodes differs from the number of requests.
    #[error("the system returned {returned} episodes; expected {requested}, one per request")]
    EpisodeCount {
        /// Number of requests.
        requested: usize,
        /// Number of episodes.
        returned: usize,
    },
    /// A complete episode leaves the formula undecided, so every other episode would too.
    #[error(
        "simulation {number} of trial {trial} is complete but leaves the formula undecided: at its first sample, the formula \
         reads samples after the end of the episode (a window that is too long) or before its start (`prev`)"
    )]
    Undecidable {
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation.
        number: u32,
    },
    /// A robustness is NaN.
    #[error(
        "the robustness of simulation {number} of trial {trial}, with scenario {scenario:?}, is NaN; expected a number"
    )]
    NotANumber {
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation.
        number: u32,
        /// Scenario of the simulation.
        scenario: Vec<Option<f64>>,
    },
    /// The record of a violation has no trace, which determines its failure mode.
    #[error(
        "simulation {number} of trial {trial} violates the requirement but has no recorded trace; a trial that keeps going \
         needs it"
    )]
    NoTrace {
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation.
        number: u32,
    },
    /// Trials that keep going are to run on another physics engine.
    #[error(
        "trials that keep going need the traces of the system, so another physics engine cannot run them"
    )]
    ScreenedModes,
    /// A record belongs to a trial that the falsification does not have.
    #[error(
        "simulation {number} of trial {trial} is recorded, but the trials of the falsification are 1 to {trials}"
    )]
    UnknownTrial {
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation.
        number: u32,
        /// Number of trials of the falsification.
        trials: u32,
    },
    /// A record is not the next simulation of its trial.
    #[error("the record of trial {trial} contains simulation {found}; expected simulation {expected} next")]
    OutOfOrder {
        /// Number of the trial.
        trial: u32,
        /// Number of the recorded simulation.
        found: u32,
        /// Number of the next simulation.
        expected: u32,
    },
    /// A record follows the last simulation of its trial.
    #[error("simulation {number} of trial {trial} is recorded, but the trial ended with simulation {last}")]
    AfterTrialEnd {
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation.
        number: u32,
        /// Number of the trial's last simulation.
        last: u32,
    },
    /// The point, scenario or seed of a record differs from the request of the trial.
    #[error(
        "simulation {number} of trial {trial} was recorded {recorded}, but this program requests it {expected}: \
         the run was made by another build or with other settings; resume it with those"
    )]
    RecordMismatch {
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation.
        number: u32,
        /// Recorded point, scenario and seed.
        recorded: String,
        /// Requested point, scenario and seed.
        expected: String,
    },
}
