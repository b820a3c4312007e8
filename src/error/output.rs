//! Errors of output files and folders that are there already.

use std::path::Path;

use mishandle_results::{Choice, Key, Remedy};

use super::{MishandleError, problem};

impl MishandleError {
    /// Returns the error that another process writes an output.
    pub fn busy(what: &str, path: &Path, key: Key) -> MishandleError {
        problem(format!("another {what} is writing {}", path.display()))
            .with(Remedy::Advice("wait until it ends"))
            .with(Remedy::Another(key))
    }
}

/// Returns the error that an output of a new run exists.
pub(crate) fn exists(path: &Path, key: Key) -> MishandleError {
    problem(format!("{} exists already", path.display()))
        .with(Remedy::Another(key))
        .with(Remedy::set(Key::RESUME, Choice::On))
}

/// Returns the error that the folder of a check or a bisection has other files.
pub(crate) fn foreign_folder(what: &str, path: &Path, name: &str) -> MishandleError {
    let text = format!(
        "{} has `{name}` and is not the folder of a {what}, which writes no file into the folder of something else",
        path.display()
    );
    problem(text).with(Remedy::Another(Key::OUT))
}
