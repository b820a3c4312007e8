/// Errors before or during episodes.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RolloutError {
    /// A scenario has the wrong number of values.
    #[error(
        "the number of values in the scenario is {found}; expected {expected}, one for each axis of the space ({axes})"
    )]
    Dimension {
        /// Number of axes of the space.
        expected: usize,
        /// Number of values of the scenario.
        found: usize,
        /// Names of the axes, joined by commas.
        axes: String,
    },
    /// A scenario contains NaN or an infinity.
    #[error("the scenario's `{axis}` is {value}; expected a finite number")]
    NotFinite {
        /// Name of the axis.
        axis: String,
        /// The value.
        value: f64,
    },
    /// A scenario omits a value that is not a random draw.
    #[error("the scenario has no value for `{axis}`; only a random draw may be omitted")]
    MissingValue {
        /// Name of the axis.
        axis: String,
    },
    /// A value outside the bounds of its axis, or a fraction where a whole number is required.
    #[error(
        "the scenario's `{axis}` is {value}; expected a {} from {low} to {high}",
        if *is_discrete { "whole number" } else { "number" }
    )]
    OutOfRange {
        /// Name of the axis.
        axis: String,
        /// The value.
        value: f64,
        /// Lower bound.
        low: f64,
        /// Upper bound.
        high: f64,
        /// Whether the axis has whole numbers only.
        is_discrete: bool,
    },
    /// The target has no space with this name.
    #[error("there is no space `{name}`; available spaces: {}", known.join(", "))]
    UnknownSpace {
        /// The unknown name.
        name: String,
        /// Names of the target's spaces.
        known: Vec<String>,
    },
    /// An axis is inconsistent or unknown.
    #[error("axis `{axis}`: {what}")]
    Axis {
        /// Name of the axis.
        axis: String,
        /// The problem.
        what: &'static str,
    },
    /// The bounds of an axis are not finite, or the lower one is not below the upper one.
    #[error(
        "axis `{axis}` has bounds from {low} to {high}; expected a finite lower bound below a finite upper bound"
    )]
    Bounds {
        /// Name of the axis.
        axis: String,
        /// Lower bound.
        low: f64,
        /// Upper bound.
        high: f64,
    },
    /// The controller's observation or action size differs from the environment's.
    #[error(
        "the controller has {found_observation} observations and {found_action} actions; \
         {environment} has {expected_observation} and {expected_action}"
    )]
    Layout {
        /// Name of the environment.
        environment: String,
        /// Observation size of the environment.
        expected_observation: usize,
        /// Action size of the environment.
        expected_action: usize,
        /// Observation size of the controller.
        found_observation: usize,
        /// Action size of the controller.
        found_action: usize,
    },
    /// A noise level is negative, NaN or too large.
    #[error("{what} is {value}; expected a standard deviation from 0 to {max}")]
    Noise {
        /// Name of the noise.
        what: &'static str,
        /// The value.
        value: f64,
        /// Maximum.
        max: f64,
    },
    /// The safe condition contains a temporal operator.
    #[error("the safe condition `{formula}` has a temporal operator; expected a predicate on one sample")]
    NotAPredicate {
        /// Text of the formula.
        formula: String,
    },
    /// A formula does not parse.
    #[error("formula `{formula}`")]
    Parse {
        /// Text of the formula.
        formula: String,
        /// The parser's error.
        source: mishandle_stl::ParseError,
    },
    /// A formula does not fit the signals or the clock, or a trace contains NaN.
    #[error("formula `{formula}`")]
    Monitor {
        /// Text of the formula.
        formula: String,
        /// The monitor's error.
        source: mishandle_stl::MonitorError,
    },
    /// A controller asks for an image of a camera that the environment does not have.
    #[error(
        "the controller sees through the camera `{camera}`, but {environment} has {}{}",
        if known.is_empty() { "no cameras".to_string() } else { format!("only {}", known.join(", ")) },
        mishandle_stl::nearest(camera, known.iter().map(String::as_str))
            .map_or(String::new(), |near| format!("; did you mean `{near}`?"))
    )]
    NoCamera {
        /// Name of the environment.
        environment: String,
        /// Name of the camera.
        camera: String,
        /// Names of the cameras of the environment.
        known: Vec<String>,
    },
    /// An image cannot be rendered.
    #[error("the controller sees through the camera `{camera}`: {what}")]
    Image {
        /// Name of the camera.
        camera: String,
        /// The problem.
        what: String,
    },
    /// Another physics engine than that of the system failed.
    #[error("the physics engine of the worlds failed: {0}")]
    Engine(String),
    /// A system outside this crate failed.
    #[error("the system under test failed: {0}")]
    System(String),
    /// The caller of a question ended it. Nobody reads this: the caller knows why.
    #[error("the caller ended the question")]
    Ended,
    /// Random scenario after random scenario is invalid.
    #[error("{environment} could not start from {draws} random scenarios one after the other")]
    NoStart {
        /// Name of the environment.
        environment: String,
        /// Number of scenarios.
        draws: usize,
    },
    /// An environment batch cannot be made or stepped.
    #[error("the environment batch failed: {0}")]
    Batch(String),
}
