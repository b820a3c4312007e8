use mishandle_stl::MonitorError;
use thiserror::Error;

/// Why a guard cannot be made.
#[derive(Debug, Error)]
pub enum GuardError {
    /// The formula does not fit the quantities.
    #[error("the formula of the guard `{formula}`: {problem}")]
    Formula {
        /// Text of the formula.
        formula: String,
        /// The mistake.
        problem: MonitorError,
    },
    /// An episode never decides the formula.
    #[error(
        "the formula of the guard `{formula}` needs {needed} control steps and an episode has {steps}, so the guard would \
         never hand over; shorten its windows"
    )]
    TooLong {
        /// Text of the formula.
        formula: String,
        /// Control steps that the formula reads ahead.
        needed: usize,
        /// Control steps of an episode.
        steps: usize,
    },
    /// A way back for a formula about the future.
    #[error(
        "the formula of the guard `{formula}` reads the future: the best robustness that is still possible never rises, so \
         there is no way back. Leave out `return-threshold`, or use a formula about the past (once, historically, since)"
    )]
    NoWayBack {
        /// Text of the formula.
        formula: String,
    },
    /// A number that makes no sense.
    #[error("`{key}` of the guard is {value}; expected {expected}")]
    Number {
        /// The setting.
        key: &'static str,
        /// Its value.
        value: f64,
        /// Allowed values.
        expected: &'static str,
    },
    /// A fallback that does not fit.
    #[error(
        "the fallback has {found_observation} observations and {found_action} actions, the controller {observation} and \
         {action}"
    )]
    Fallback {
        /// Observations of the fallback.
        found_observation: usize,
        /// Actions of the fallback.
        found_action: usize,
        /// Observations of the controller.
        observation: usize,
        /// Actions of the controller.
        action: usize,
    },
}
