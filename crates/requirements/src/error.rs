//! Errors of questions about requirements.

use mishandle_results::Remedy;
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
    /// The question lacks a setting.
    #[error("{fact}")]
    Lacking {
        /// The open choice.
        fact: String,
        /// The setting that closes it.
        remedy: Remedy,
    },
}

impl RequirementError {
    /// Returns what helps.
    pub fn remedies(&self) -> Vec<Remedy> {
        match self {
            RequirementError::Lacking { remedy, .. } => vec![remedy.clone()],
            _ => Vec::new(),
        }
    }
}
