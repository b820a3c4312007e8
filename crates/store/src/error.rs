//! Errors of run files.

use std::io::Read;
use std::path::{Path, PathBuf};

use rusqlite::ErrorCode;

use crate::version::FORMAT_VERSION;

/// An error while reading or writing a run file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StoreError {
    /// The program was built without the feature `parquet`.
    #[error("this program was built without its feature `parquet`")]
    NoParquet,
    /// The new run would overwrite a file.
    #[error("cannot create a run: the file exists already; choose another path: {}", path.display())]
    Exists {
        /// Path of the existing file.
        path: PathBuf,
    },
    /// The file or its folder does not exist.
    #[error("cannot open a run: {what} does not exist: {}", path.display())]
    Missing {
        /// `the file` or `the folder`.
        what: &'static str,
        /// Path of the file.
        path: PathBuf,
    },
    /// The file or its folder is read-only.
    #[error("cannot write a run: the file or its folder is read-only: {}", path.display())]
    ReadOnly {
        /// Path of the file.
        path: PathBuf,
    },
    /// The process has no permission to open the file.
    #[error("cannot open a run: the system denies access to the file: {}", path.display())]
    CannotOpen {
        /// Path of the file.
        path: PathBuf,
    },
    /// The run was not closed, because its writer was killed or is still running, and the folder is
    /// read-only. SQLite then cannot read the log beside the file.
    #[error(
        "cannot read a run that was not closed from a read-only folder; copy it and the file ending in `-wal` \
         beside it to a writable folder: {}", path.display()
    )]
    NotClosed {
        /// Path of the file.
        path: PathBuf,
    },
    /// Another process has the run open for writing.
    #[error(
        "another process is writing this run; wait until it ends, or stop it: {}", path.display()
    )]
    Locked {
        /// Path of the file.
        path: PathBuf,
    },
    /// The disk is full.
    #[error(
        "the disk is full; the recorded simulations are safe: free some space and resume the run: {}",
        path.display()
    )]
    DiskFull {
        /// Path of the file.
        path: PathBuf,
    },
    /// The disk has no space for a new run.
    #[error("the disk is full, so the run could not be created: {}", path.display())]
    NoRoom {
        /// Path of the file, which does not exist.
        path: PathBuf,
    },
    /// The file is not a run file.
    #[error("not a run file: expected a SQLite database made by mishandle, found {found}: {}", path.display())]
    NotARun {
        /// Description of the content.
        found: String,
        /// Path of the file.
        path: PathBuf,
    },
    /// The file is empty or a database without tables, which a program leaves that is killed while
    /// it creates a run.
    #[error(
        "the run file is empty: the program that created it was stopped before the first simulation, or it was copied \
         without the file ending in `-wal` beside it; start the run again, which replaces the file: {}", path.display()
    )]
    Unfinished {
        /// Path of the file.
        path: PathBuf,
    },
    /// Reading the file took too long for its size.
    #[error(
        "reading the run file took longer than 30 s plus 1 s per MiB: it is damaged, or the disk is very slow: {}",
        path.display()
    )]
    TooSlow {
        /// Path of the file.
        path: PathBuf,
    },
    /// The content of the run file was changed or damaged.
    #[error("the run file is damaged, restore it from a copy: {what}: {}", path.display())]
    Damaged {
        /// Description of the damage.
        what: String,
        /// Path of the file.
        path: PathBuf,
    },
    /// The file has a newer format.
    #[error(
        "the run file has format version {found}, this program reads version {FORMAT_VERSION}; \
         use a newer program: {}", path.display()
    )]
    NewerVersion {
        /// Format version of the file.
        found: i64,
        /// Path of the file.
        path: PathBuf,
    },
    /// The file has an older format.
    #[error(
        "the run file has format version {found}, this program reads version {FORMAT_VERSION}; \
         run its plan again, or use the program that wrote the file: {}", path.display()
    )]
    OlderVersion {
        /// Format version of the file.
        found: i64,
        /// Path of the file.
        path: PathBuf,
    },
    /// A list has the wrong length.
    #[error(
        "cannot record simulation {number} of trial {trial}: its {list} has {found} elements, \
         the run's header requires {expected}"
    )]
    WrongLength {
        /// Name of the list.
        list: &'static str,
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation.
        number: u32,
        /// Length of the list.
        found: usize,
        /// Required length.
        expected: usize,
    },
    /// A trace is larger than a run file may contain.
    #[error(
        "cannot record simulation {number} of trial {trial}: its trace has {samples} samples; a trace can have up to \
         256 MiB, 8 bytes for each sample of a signal"
    )]
    TraceTooLarge {
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation.
        number: u32,
        /// Number of samples.
        samples: usize,
    },
    /// The signals of a trace have different lengths.
    #[error(
        "cannot record simulation {number} of trial {trial}: its trace has {found} samples of `{signal}`, \
         but {expected} of `{first}`"
    )]
    RaggedTrace {
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation.
        number: u32,
        /// Name of the signal.
        signal: String,
        /// Number of its samples.
        found: usize,
        /// Name of the first signal.
        first: String,
        /// Number of samples of the first signal.
        expected: usize,
    },
    /// A simulation has the number 0.
    #[error("cannot record simulation 0 of trial {trial}: simulations of a trial are numbered from 1")]
    SimulationZero {
        /// Number of the trial.
        trial: u32,
    },
    /// A value is NaN, or infinite although it must be finite.
    #[error("cannot record simulation {number} of trial {trial}: its {what} is {value}")]
    NotANumber {
        /// Name of the value.
        what: String,
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation.
        number: u32,
        /// The invalid value.
        value: f64,
    },
    /// The digest of a simulation does not match its trace.
    #[error(
        "cannot record simulation {number} of trial {trial}: its trace digest is {given:032x}, \
         but its trace has the digest {computed:032x}"
    )]
    WrongDigest {
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation.
        number: u32,
        /// Digest of the simulation.
        given: u128,
        /// Digest computed from the trace.
        computed: u128,
    },
    /// The header is invalid.
    #[error("cannot create a run: {what}")]
    BadHeader {
        /// The invalid value and the allowed values.
        what: String,
    },
    /// The run already contains the simulation or the trial.
    #[error("cannot record {what}: the run already contains it")]
    AlreadyRecorded {
        /// The simulation or the trial.
        what: String,
    },
    /// The run has no trial with this number.
    #[error("the run has no trial {trial}")]
    UnknownTrial {
        /// Number of the trial.
        trial: u32,
    },
    /// The run has no simulation with this number.
    #[error("the run has no simulation {number} of trial {trial}")]
    UnknownSimulation {
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation.
        number: u32,
    },
    /// A file could not be written. The source says why.
    #[error("{what}")]
    Write {
        /// The operation that failed.
        what: String,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// A file could not be read or removed. The source says why.
    #[error("{what}")]
    Io {
        /// The operation that failed.
        what: String,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// SQLite failed with an error that has no variant of its own.
    #[error("SQLite failed: {message}: {}", path.display())]
    Sqlite {
        /// Message of SQLite.
        message: String,
        /// Path of the file.
        path: PathBuf,
    },
}

/// The operation that a full disk or a quota lets fail.
const WRITE: &str = "write";

impl StoreError {
    /// Returns the error of a file with this damage.
    pub fn damaged(path: &Path, what: impl Into<String>) -> Self {
        Self::Damaged { what: what.into() + if_without_log(path), path: path.into() }
    }

    /// The file is a database without the application ID of a run file.
    pub(crate) fn of_another_program(path: &Path) -> Self {
        let found = "a SQLite database of another program";
        Self::NotARun { found: found.to_string() + if_without_log(path), path: path.into() }
    }

    /// Converts an I/O error. `verb` names the operation that failed.
    pub(crate) fn from_io(path: &Path, verb: &str, source: std::io::Error) -> Self {
        use std::io::ErrorKind;
        match source.kind() {
            ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem => {
                Self::ReadOnly { path: path.into() }
            }
            ErrorKind::StorageFull => Self::DiskFull { path: path.into() },
            _ => Self::Io { what: format!("cannot {verb} {}", path.display()), source },
        }
    }

    /// Converts an error of SQLite. The SQL statements of this crate are constant, so a statement
    /// that SQLite rejects, or a value of an unexpected type, means that the file is damaged.
    pub(crate) fn from_sqlite(path: &Path, error: &rusqlite::Error) -> Self {
        let path = path.to_path_buf();
        let message = error.to_string();
        let code = match error {
            rusqlite::Error::SqliteFailure(failure, _) => failure,
            rusqlite::Error::SqlInputError { error, .. } => error,
            _ => return Self::damaged(&path, message),
        };
        match (code.code, code.extended_code) {
            (ErrorCode::OperationInterrupted, _) => Self::TooSlow { path },
            (ErrorCode::TooBig, _) => Self::damaged(&path, "a value is too large"),
            (ErrorCode::DiskFull, _) | (_, rusqlite::ffi::SQLITE_IOERR_SHMSIZE) => Self::DiskFull { path },
            (ErrorCode::DatabaseBusy | ErrorCode::DatabaseLocked, _) => Self::Locked { path },
            (ErrorCode::ReadOnly | ErrorCode::PermissionDenied, _) => Self::ReadOnly { path },
            (ErrorCode::CannotOpen, _) => Self::CannotOpen { path },
            (ErrorCode::NotADatabase, _) => Self::NotARun { found: "a file of another kind".into(), path },
            (ErrorCode::DatabaseCorrupt | ErrorCode::Unknown, _)
            | (_, rusqlite::ffi::SQLITE_IOERR_SHORT_READ) => Self::damaged(&path, message),
            // When a connection cannot be opened, the message of SQLite is the path.
            (ErrorCode::OutOfMemory, _) => Self::Sqlite { message: "out of memory".into(), path },
            (ErrorCode::SystemIoFailure, extended) => {
                let operation = failed_operation(extended);
                let what = format!("cannot {operation} {}", path.display());
                let source = std::io::Error::other(message);
                if operation == WRITE { Self::Write { what, source } } else { Self::Io { what, source } }
            }
            _ => Self::Sqlite { message, path },
        }
    }
}

/// Returns the operation that failed with SQLite's extended error code of an I/O error.
fn failed_operation(extended_code: i32) -> &'static str {
    use rusqlite::ffi::{
        SQLITE_IOERR_FSYNC, SQLITE_IOERR_LOCK, SQLITE_IOERR_READ, SQLITE_IOERR_SHMLOCK,
        SQLITE_IOERR_TRUNCATE, SQLITE_IOERR_WRITE,
    };
    match extended_code {
        SQLITE_IOERR_READ => "read",
        SQLITE_IOERR_WRITE => WRITE,
        SQLITE_IOERR_TRUNCATE => "truncate",
        SQLITE_IOERR_FSYNC => "sync",
        SQLITE_IOERR_LOCK | SQLITE_IOERR_SHMLOCK => "lock",
        _ => "access",
    }
}

/// Returns a second possible cause of an error, for a file whose write-ahead log is missing.
fn if_without_log(path: &Path) -> &'static str {
    // SQLite sets bytes 18 and 19 to 2 when a writer starts a log, and resets them when the writer
    // closes the file.
    const VERSIONS: std::ops::Range<usize> = 18..20;
    let mut first_bytes = [0; VERSIONS.end];
    let read = std::fs::File::open(path).and_then(|mut file| file.read_exact(&mut first_bytes));
    let mut log = path.as_os_str().to_owned();
    log.push("-wal");
    let has_log = std::fs::metadata(log).is_ok_and(|found| found.len() > 0);
    if read.is_ok() && first_bytes[VERSIONS] == [2, 2] && !has_log {
        ", or a run that was copied before it was closed, without the file ending in `-wal` beside it"
    } else {
        ""
    }
}

/// Adds the path of the run file to an error of SQLite.
pub(crate) trait InFile<T> {
    fn in_file(self, path: &Path) -> crate::Result<T>;
}

impl<T> InFile<T> for rusqlite::Result<T> {
    fn in_file(self, path: &Path) -> crate::Result<T> {
        self.map_err(|error| StoreError::from_sqlite(path, &error))
    }
}
