use std::io;
use std::path::{Path, PathBuf};

use mishandle::MishandleError;

use crate::zoo::ZooError;

/// An error of the paper's tables.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PaperError {
    /// A run file or a plan cannot be read.
    #[error(transparent)]
    Mishandle(Box<MishandleError>),
    /// The record of a shipped controller cannot be read.
    #[error(transparent)]
    Zoo(Box<ZooError>),
    /// A file cannot be read or written.
    #[error("{}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A file of results is not what it should be.
    #[error("{}: {problem}", path.display())]
    Results {
        /// Path of the file.
        path: PathBuf,
        /// The problem.
        problem: String,
    },
    /// Two parts of a campaign contain a run of the same name, with different rows or facts.
    #[error("two folders have different results of the run {run} of {campaign}; leave one out")]
    DuplicateRun {
        /// Name of the campaign.
        campaign: String,
        /// Name of the run.
        run: String,
    },
}

impl From<MishandleError> for PaperError {
    fn from(error: MishandleError) -> PaperError {
        PaperError::Mishandle(Box::new(error))
    }
}

impl PaperError {
    /// Returns the error of a file of results.
    pub(crate) fn results(path: &Path, problem: &dyn std::fmt::Display) -> PaperError {
        PaperError::Results { path: path.to_path_buf(), problem: problem.to_string() }
    }

    /// Returns a function that adds a path to an I/O error.
    pub(crate) fn file(path: &Path) -> impl FnOnce(io::Error) -> PaperError {
        move |source| PaperError::File { path: path.to_path_buf(), source }
    }
}
