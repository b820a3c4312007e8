use std::io;
use std::path::{Path, PathBuf};

use mishandle::MishandleError;
use mishandle::controllers::ControllerError;
use mishandle::tasks::TaskError;
use mishandle_text::plural;

/// An error of the controller zoo.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ZooError {
    /// A training run, an evaluation or a falsification failed.
    #[error(transparent)]
    Mishandle(Box<MishandleError>),
    /// A controller file cannot be read.
    #[error(transparent)]
    Controller(Box<ControllerError>),
    /// A benchmark task cannot be built.
    #[error(transparent)]
    Task(Box<TaskError>),
    /// A file cannot be read or written.
    #[error("{}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A record is not what this program writes.
    #[error("{}: expected a record of the controller zoo", path.display())]
    Record {
        /// The file.
        path: PathBuf,
        /// Why.
        source: serde_json::Error,
    },
    /// A learning curve cannot be used.
    #[error("{}: {problem}", path.display())]
    Curve {
        /// The file.
        path: PathBuf,
        /// Why.
        problem: CurveFileProblem,
    },
    /// A Markdown page has no place for a table.
    #[error("{}: {problem}", path.display())]
    Page {
        /// The file.
        path: PathBuf,
        /// Why.
        problem: PageProblem,
    },
    /// A controller differs from the one that the plan would train.
    #[error("{} is not the planned controller: {}", path.display(), reasons.join("; "))]
    NotPlanned {
        /// The file.
        path: PathBuf,
        /// The differences.
        reasons: Vec<String>,
    },
    /// A file could not be written at the end of a training run.
    #[error("the training run ended, but could not write all files: {}", failures.join("; "))]
    Unwritten {
        /// One failure per file.
        failures: Vec<String>,
    },
    /// The selection names an unknown task or controller.
    #[error(
        "--only is `{only}`; it must be TASK or TASK/CONTROLLER, with a task of {} and a controller of {}{}",
        tasks.join(", "), controllers.join(", "),
        nearest.as_ref().map_or(String::new(), |near| format!("; did you mean `{near}`?"))
    )]
    UnknownSelection {
        /// The selection.
        only: String,
        /// The selection with the most similar spelling, if one is similar.
        nearest: Option<String>,
        /// Names of the tasks.
        tasks: Vec<String>,
        /// Names of the controllers of each task.
        controllers: Vec<String>,
    },
    /// Another process works on the same zoo.
    #[error("another `studies zoo` is running in this repository; wait until it ends")]
    Busy,
    /// A thread pool cannot be created.
    #[error("cannot start a thread for a job")]
    Threads(#[source] rayon::ThreadPoolBuildError),
    /// A stop was requested.
    #[error("interrupted")]
    Interrupted,
    /// A stop was requested while jobs were left.
    #[error("interrupted after {done} of {}; run the same command again to continue", plural(*total, "job"))]
    InterruptedWith {
        /// Jobs that ended.
        done: usize,
        /// Jobs in all.
        total: usize,
    },
    /// Some jobs failed; the observer reported each.
    #[error("{failed} of {} failed", plural(*total, "job"))]
    Failed {
        /// Jobs that failed.
        failed: usize,
        /// Jobs in all.
        total: usize,
    },
    /// Some imported training runs were refused; the observer reported each.
    #[error("refused {refused} of the training runs in {}", folder.display())]
    Refused {
        /// How many.
        refused: usize,
        /// The folder that was imported.
        folder: PathBuf,
    },
}

impl From<MishandleError> for ZooError {
    fn from(error: MishandleError) -> ZooError {
        ZooError::Mishandle(Box::new(error))
    }
}

impl From<ControllerError> for ZooError {
    fn from(error: ControllerError) -> ZooError {
        ZooError::Controller(Box::new(error))
    }
}

impl From<TaskError> for ZooError {
    fn from(error: TaskError) -> ZooError {
        ZooError::Task(Box::new(error))
    }
}

impl ZooError {
    /// Returns a function that adds a path to an I/O error.
    pub(crate) fn file(path: &Path) -> impl FnOnce(io::Error) -> ZooError {
        move |source| ZooError::File { path: path.to_path_buf(), source }
    }
}

/// Fault of the file of a learning curve.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CurveFileProblem {
    /// Not CSV, or not the columns of a kept curve.
    #[error("expected the columns of a learning curve: {0}")]
    Csv(#[from] csv::Error),
    /// The training run did not reach its end.
    #[error("the training run has not ended: {done} of {total} environment steps")]
    Unfinished {
        /// Environment steps of the last row.
        done: u64,
        /// Environment steps that the settings ask for.
        total: u64,
    },
    /// The first iterations of the training run are missing.
    #[error("the learning curve starts at iteration {iteration}, not at 1")]
    MissingStart {
        /// Iteration of the first row.
        iteration: u64,
    },
    /// The file has no rows.
    #[error("the learning curve has no rows")]
    Empty,
    /// The settings of the training run cannot be read any more.
    #[error("the settings of its controller are not settings of {algorithm}")]
    Settings {
        /// The algorithm.
        algorithm: String,
    },
}

/// Fault of a Markdown page.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PageProblem {
    /// The comments around a table are missing.
    #[error("expected the comments `<!-- figures: {name} -->` and `<!-- end of figures -->`")]
    NoPlace {
        /// Name of the table.
        name: String,
    },
}
