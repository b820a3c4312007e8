//! Errors of questions about requirements.

use mishandle_stl::{MonitorError, ParseError};

/// A result, or an error of this crate.
pub type Result<T> = std::result::Result<T, RequirementError>;

/// The error of a question about a requirement.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RequirementError {
    /// The text is not a formula.
    #[error(transparent)]
    Parse(#[from] ParseError),
    /// The formula cannot be evaluated.
    #[error(transparent)]
    Monitor(#[from] MonitorError),
    /// The question has no answer.
    #[error("{0}")]
    Question(String),
}
