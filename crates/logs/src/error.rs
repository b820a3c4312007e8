//! Errors of reading a log.

use std::io;

use mishandle_results::{Choice, Key, Remedy};
use mishandle_stl::{DenseError, MonitorError};

/// The result of reading a log.
pub type Result<T> = std::result::Result<T, LogError>;

/// How values between two samples are found.
const HOW: Choice = Choice::OneOf(&["hold", "linear"]);

/// The error of reading a log. The message is one or two lines; it names the line and the column.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LogError {
    /// The file cannot be read.
    #[error("{0}")]
    Io(#[from] io::Error),
    /// The content is not what the format requires.
    #[error("{0}")]
    Content(String),
    /// The log is shorter than the windows of the formula, which may not be cut.
    #[error("{0}")]
    TooShort(String),
    /// The log has several readings, and nobody stated one.
    #[error("{fact}")]
    Undecided {
        /// The open choice.
        fact: String,
        /// The choices that close it.
        remedies: Vec<Remedy>,
    },
    /// The signals of the log do not fit the formula.
    #[error("{0}")]
    Formula(#[from] MonitorError),
    /// The formula has no value in dense time.
    #[error("{0}")]
    Dense(#[from] DenseError),
}

impl LogError {
    /// Returns whether a choice is missing.
    pub fn is_undecided(&self) -> bool {
        matches!(self, LogError::Undecided { .. })
    }

    /// Returns the error with the part of the log that it is about.
    pub(crate) fn within(self, part: &str) -> LogError {
        let within = |message: String| format!("{part}: {message}");
        match self {
            LogError::Content(message) => LogError::Content(within(message)),
            LogError::TooShort(message) => LogError::TooShort(within(message)),
            LogError::Undecided { fact, remedies } => LogError::Undecided { fact: within(fact), remedies },
            error => error,
        }
    }

    /// Returns what helps.
    pub fn remedies(&self) -> Vec<Remedy> {
        match self {
            LogError::Undecided { remedies, .. } => remedies.clone(),
            LogError::TooShort(_) => vec![Remedy::Unset(Key::LOG_STRICT_HORIZON)],
            LogError::Dense(DenseError::NoUnit { .. }) => {
                let unit = Remedy::set(Key::LOG_UNIT, Choice::Text("s".to_owned()));
                vec![unit.when("it is the unit of all bounds")]
            }
            LogError::Dense(DenseError::NotLinear { .. }) => {
                vec![Remedy::set(Key::LOG_DENSE, Choice::OneOf(&["hold"])), resample_to_period()]
            }
            _ => Vec::new(),
        }
    }
}

pub(crate) fn content(message: impl Into<String>) -> LogError {
    LogError::Content(message.into())
}

pub(crate) fn undecided<const N: usize>(remedies: [Remedy; N], fact: impl Into<String>) -> LogError {
    LogError::Undecided { fact: fact.into(), remedies: remedies.into() }
}

/// Returns the remedy to resample.
pub(crate) fn resample() -> Remedy {
    Remedy::set(Key::LOG_RESAMPLE, HOW)
}

/// Returns the remedy to read signals as functions of time.
pub(crate) fn dense() -> Remedy {
    Remedy::set(Key::LOG_DENSE, HOW)
}

/// Returns the remedy to resample to a new period.
pub(crate) fn resample_to_period() -> Remedy {
    Remedy::Set(vec![(Key::LOG_RESAMPLE, HOW), (Key::LOG_PERIOD, Choice::SECONDS)])
}

/// Returns the remedy to state the period.
pub(crate) fn state_period() -> Remedy {
    Remedy::set(Key::LOG_PERIOD, Choice::SECONDS)
}

/// Returns the remedy to name the column with the times.
pub(crate) fn name_time() -> Remedy {
    Remedy::set(Key::LOG_TIME, Choice::COLUMN)
}

/// Returns the remedy to read a log without its missing values.
pub(crate) fn hold_or_drop() -> Remedy {
    Remedy::set(Key::LOG_MISSING, Choice::OneOf(&["hold", "drop"]))
}

/// Returns the remedy to leave out rows without a value.
pub(crate) fn drop_missing() -> Remedy {
    Remedy::set(Key::LOG_MISSING, Choice::OneOf(&["drop"]))
}

/// Returns the remedy to keep one row of each time.
pub(crate) fn keep_one() -> Remedy {
    Remedy::set(Key::LOG_DUPLICATES, Choice::OneOf(&["first", "last"]))
}
