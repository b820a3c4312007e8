use std::io;
use std::path::{Path, PathBuf};

use mishandle::MishandleError;
use mishandle::results::{Choice, Key, Remedy};

/// An error while a folder of evidence is written or read. What a verification finds is not one.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EvidenceError {
    /// A run file cannot be read.
    #[error(transparent)]
    Mishandle(Box<MishandleError>),
    /// A file cannot be read or written.
    #[error("{}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The folder exists.
    #[error("{} exists already", path.display())]
    Exists {
        /// The folder.
        path: PathBuf,
    },
    /// The folder to replace is something else, or has a file of somebody else.
    #[error("{} is not replaced, because {problem}", path.display())]
    Foreign {
        /// The folder.
        path: PathBuf,
        /// The part that is not evidence.
        problem: String,
    },
    /// A run is in the folder to replace.
    #[error("{} is in the folder that would be replaced", path.display())]
    Inside {
        /// The run file.
        path: PathBuf,
    },
    /// A folder is not that of a finished check.
    #[error("{} is a folder without a finished check; name run files, or the folder of a check", path.display())]
    NotACheck {
        /// The folder.
        path: PathBuf,
    },
    /// The caller stopped it.
    #[error("interrupted")]
    Interrupted,
    /// The folder to verify is something else.
    #[error("{} is not a folder of evidence: it has no file {}", path.display(), crate::SUMS)]
    NotEvidence {
        /// The folder.
        path: PathBuf,
    },
    /// A run is still being written, or its process was killed.
    #[error(
        "{} is not closed: a process still writes it, or was killed; wait for its end, or resume the run",
        path.display()
    )]
    NotClosed {
        /// The run file.
        path: PathBuf,
    },
    /// A file has a name that the list of hashes cannot hold.
    #[error(
        "{name:?} cannot be part of a folder of evidence; rename it without control characters and backslashes"
    )]
    Name {
        /// The name.
        name: String,
    },
    /// `ssh-keygen` cannot be started, or does not answer.
    #[error("{problem}")]
    Keygen {
        /// Why.
        problem: String,
    },
    /// A key cannot be used.
    #[error("{}: {problem}", path.display())]
    Key {
        /// Its file.
        path: PathBuf,
        /// Why.
        problem: String,
    },
}

impl EvidenceError {
    /// Returns what helps.
    pub fn remedies(&self) -> Vec<Remedy> {
        match self {
            EvidenceError::Mishandle(error) => error.remedies(),
            EvidenceError::Exists { .. } => {
                vec![Remedy::Another(Key::OUT), Remedy::set(Key::FORCE, Choice::On)]
            }
            EvidenceError::Foreign { .. } | EvidenceError::Inside { .. } => vec![Remedy::Another(Key::OUT)],
            _ => Vec::new(),
        }
    }

    /// Returns a function that adds a path to an I/O error.
    pub(crate) fn file(path: &Path) -> impl FnOnce(io::Error) -> EvidenceError {
        move |source| EvidenceError::File { path: path.to_path_buf(), source }
    }
}

impl<E: Into<MishandleError>> From<E> for EvidenceError {
    fn from(error: E) -> EvidenceError {
        EvidenceError::Mishandle(Box::new(error.into()))
    }
}
