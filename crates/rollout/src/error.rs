/// What can be wrong before or while episodes run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RolloutError {
    /// A scenario has the wrong number of values.
    #[error("the scenario has {found} values, the space has {wanted} axes ({axes})")]
    Dimension {
        /// Number of axes of the space.
        wanted: usize,
        /// Number of values given.
        found: usize,
        /// Names of the axes, for the message.
        axes: String,
    },
    /// A scenario holds NaN or an infinity.
    #[error("the scenario's `{axis}` is {value}, which is not a finite number")]
    NotFinite {
        /// Name of the axis.
        axis: String,
        /// The value given.
        value: f64,
    },
    /// A scenario leaves out a value that is not a random draw.
    #[error("the scenario has no value for `{axis}`; only a random draw may be left out")]
    Absent {
        /// Name of the axis.
        axis: String,
    },
    /// A value that the axis does not take.
    #[error(
        "the scenario's `{axis}` is {value}; allowed values go from {low} to {high}, whole numbers if it counts"
    )]
    Value {
        /// Name of the axis.
        axis: String,
        /// The value given.
        value: f64,
        /// Smallest value.
        low: f64,
        /// Largest value.
        high: f64,
    },
    /// A space that the target does not have.
    #[error("there is no space `{name}`; there are: {}", known.join(", "))]
    UnknownSpace {
        /// The name given.
        name: String,
        /// The names there are.
        known: Vec<String>,
    },
    /// An axis that makes no sense, or that nobody knows.
    #[error("axis `{axis}`: {what}")]
    Axis {
        /// Name of the axis.
        axis: String,
        /// What is wrong.
        what: &'static str,
    },
    /// An axis whose lower bound does not lie below its upper bound, or is not finite.
    #[error(
        "axis `{axis}` goes from {low} to {high}: the lower bound has to be a finite number below the upper one"
    )]
    Bounds {
        /// Name of the axis.
        axis: String,
        /// Its lower bound.
        low: f64,
        /// Its upper bound.
        high: f64,
    },
    /// A controller made for other observations or actions than the environment's.
    #[error(
        "the controller takes {found_observation} observations and gives {found_action} actions, \
         {environment} has {wanted_observation} and {wanted_action}"
    )]
    Layout {
        /// Name of the environment.
        environment: String,
        /// Observations the environment gives.
        wanted_observation: usize,
        /// Actions the environment takes.
        wanted_action: usize,
        /// Observations the controller takes.
        found_observation: usize,
        /// Actions the controller gives.
        found_action: usize,
    },
    /// A controller's output was NaN or infinite.
    #[error(
        "action {component} of the controller was {value} at step {step} of the simulation with scenario {scenario:?}"
    )]
    Action {
        /// Index of the action.
        component: usize,
        /// What the controller gave.
        value: f64,
        /// Control step.
        step: usize,
        /// The simulation's scenario.
        scenario: crate::Scenario,
    },
    /// A noise level that is negative, NaN or infinite.
    #[error("{what} is {value}: a standard deviation has to be a finite number of at least 0")]
    Noise {
        /// Which noise.
        what: &'static str,
        /// The value given.
        value: f64,
    },
    /// The safe condition has a temporal operator.
    #[error("the safe condition `{formula}` has a temporal operator; it has to be a predicate on one sample")]
    NotAPredicate {
        /// Text of the formula.
        formula: String,
    },
    /// A formula that does not parse.
    #[error("formula `{formula}`")]
    Parse {
        /// Text of the formula.
        formula: String,
        /// What the parser says.
        source: mishandle_stl::ParseError,
    },
    /// A formula that does not fit the signals or the clock, or a trace that holds NaN.
    #[error("formula `{formula}`")]
    Monitor {
        /// Text of the formula.
        formula: String,
        /// What the monitor says.
        source: mishandle_stl::MonitorError,
    },
    /// A foreign system failed.
    #[error("the system under test failed: {0}")]
    System(String),
    /// An environment batch cannot be made or stepped.
    #[error("the environment batch failed: {0}")]
    Batch(String),
}
