use std::ops::Range;
use std::path::{Path, PathBuf};

use crate::expression::ExpressionError;

/// Errors of a target in a file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RobotError {
    /// The file cannot be read.
    #[error("cannot read {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Reason.
        source: std::io::Error,
    },
    /// The file is wrong at a line.
    #[error("{}, line {line}: {message}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Number of the line, from 1.
        line: usize,
        /// Problem, and a way out where there is one.
        message: String,
    },
    /// The model cannot be used.
    #[error("{}: {message}", path.display())]
    Model {
        /// File of the model.
        path: PathBuf,
        /// Problem.
        message: String,
    },
    /// The file lacks what training needs.
    #[error("{} cannot be trained: {message}", path.display())]
    Untrainable {
        /// The file.
        path: PathBuf,
        /// Missing part, and how to add it.
        message: String,
    },
    /// The policy cannot act on the robot.
    #[error("the policy does not fit the robot: {message}")]
    Policy {
        /// Problem, and a way out where there is one.
        message: String,
    },
    /// The target is inconsistent.
    #[error(transparent)]
    Target(#[from] mishandle_rollout::RolloutError),
}

/// A problem at a place in the text of the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Problem {
    pub span: Range<usize>,
    pub message: String,
}

impl Problem {
    pub(crate) fn new(span: &Range<usize>, message: impl Into<String>) -> Problem {
        Problem { span: span.clone(), message: message.into() }
    }

    /// Returns the problem of an expression that stands at `span`.
    pub(crate) fn of_expression(span: &Range<usize>, text: &str, error: &ExpressionError) -> Problem {
        Problem::new(span, error.marked(text))
    }

    /// Returns the error with the line in the file.
    pub(crate) fn at(self, path: &Path, text: &str) -> RobotError {
        let before = text.get(..self.span.start.min(text.len())).unwrap_or(text);
        let line = before.matches('\n').count() + 1;
        RobotError::Line { path: path.to_path_buf(), line, message: self.message }
    }
}
