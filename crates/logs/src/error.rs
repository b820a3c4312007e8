//! Errors of reading a log.

use std::io;

use mishandle_stl::{DenseError, MonitorError};

/// The result of reading a log.
pub type Result<T> = std::result::Result<T, LogError>;

/// The error of reading a log. The message is one or two lines; it names the line, the column and
/// the flag that decides.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LogError {
    /// The file cannot be read.
    #[error("{0}")]
    Io(#[from] io::Error),
    /// The content is not what the format requires.
    #[error("{0}")]
    Content(String),
    /// The log has several readings, and nobody stated one.
    #[error("{message}")]
    Undecided {
        /// The message, which contains the flag.
        message: String,
        /// The flag of `mishandle monitor` that states the choice, such as `--resample`.
        flag: &'static str,
    },
    /// The signals of the log do not fit the formula.
    #[error("{0}")]
    Formula(#[from] MonitorError),
    /// The formula has no value in dense time.
    #[error("{0}")]
    Dense(#[from] DenseError),
}

impl LogError {
    /// Returns the flag that decides, if a choice is missing.
    pub fn flag(&self) -> Option<&'static str> {
        match self {
            LogError::Undecided { flag, .. } => Some(flag),
            _ => None,
        }
    }
}

pub(crate) fn content(message: impl Into<String>) -> LogError {
    LogError::Content(message.into())
}

pub(crate) fn undecided(flag: &'static str, message: impl Into<String>) -> LogError {
    LogError::Undecided { message: message.into(), flag }
}
