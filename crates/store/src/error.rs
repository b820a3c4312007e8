//! What can go wrong with a run file, told to the user.

use std::io::Read;
use std::path::{Path, PathBuf};

use rusqlite::ErrorCode;

/// Why a run file could not be written or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StoreError {
    /// A file is in the place of the new run.
    #[error("cannot create a run: there is a file already, which would be overwritten: {}", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// There is no such file, or no such folder.
    #[error("cannot open a run: {what} does not exist: {}", path.display())]
    Missing {
        /// `the file` or `the folder`.
        what: &'static str,
        /// Where it was looked for.
        path: PathBuf,
    },
    /// The file or its folder cannot be written.
    #[error("cannot write a run: the file or its folder is read-only: {}", path.display())]
    ReadOnly {
        /// The file.
        path: PathBuf,
    },
    /// The file is there, but may not be opened.
    #[error("cannot open a run: the system refuses access to the file: {}", path.display())]
    CannotOpen {
        /// The file.
        path: PathBuf,
    },
    /// The run was not closed (its writer was killed or still runs), and the folder's being read-only keeps
    /// SQLite from reading what is in its log.
    #[error(
        "cannot read a run that was not closed from a read-only folder; copy it, and the file ending in `-wal` \
         beside it, to a folder that can be written: {}", path.display()
    )]
    NotClosed {
        /// The file.
        path: PathBuf,
    },
    /// Another process has it.
    #[error(
        "another process is writing this run; wait until it ends, or stop it: {}", path.display()
    )]
    Locked {
        /// The file.
        path: PathBuf,
    },
    /// No room is left.
    #[error(
        "the disk is full; what was recorded before is safe: free some space and resume the run: {}",
        path.display()
    )]
    DiskFull {
        /// The file.
        path: PathBuf,
    },
    /// No room is left for a new run.
    #[error("the disk is full, so the run could not be begun: {}", path.display())]
    NoRoom {
        /// The file, which is not there.
        path: PathBuf,
    },
    /// The file is something else.
    #[error("not a run file: expected a SQLite database made by mishandle, found {found}: {}", path.display())]
    NotARun {
        /// What it is.
        found: String,
        /// The file.
        path: PathBuf,
    },
    /// The file is one of ours, but its content is not what was written.
    #[error("the run file is damaged, restore it from a copy: {what}: {}", path.display())]
    Damaged {
        /// Where the damage shows.
        what: String,
        /// The file.
        path: PathBuf,
    },
    /// The file is of a later format.
    #[error(
        "the run file has format version {found}, this program reads versions up to {supported}; \
         use a newer program: {}", path.display()
    )]
    NewerVersion {
        /// Format version of the file.
        found: i64,
        /// The latest that this program knows.
        supported: i64,
        /// The file.
        path: PathBuf,
    },
    /// The file is of an earlier format, and cannot be upgraded where it is.
    #[error(
        "the run file has format version {found} and must be upgraded to {current}, but the file or its folder is \
         read-only; copy it to a folder that can be written: {}", path.display()
    )]
    CannotUpgrade {
        /// Format version of the file.
        found: i64,
        /// The version that this program reads.
        current: i64,
        /// The file.
        path: PathBuf,
    },
    /// A list has the wrong number of elements.
    #[error(
        "cannot record simulation {number} of trial {trial}: its {list} has {found} elements, \
         the run's header asks for {expected}"
    )]
    WrongLength {
        /// Which list.
        list: &'static str,
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation.
        number: u32,
        /// Its elements.
        found: usize,
        /// How many there should be.
        expected: usize,
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
        /// A signal.
        signal: String,
        /// Its samples.
        found: usize,
        /// The first signal.
        first: String,
        /// The samples of that.
        expected: usize,
    },
    /// A simulation has the number 0.
    #[error("cannot record simulation 0 of trial {trial}: the simulations of a trial are numbered from 1")]
    NumberedFromOne {
        /// Number of the trial.
        trial: u32,
    },
    /// A number is NaN, or infinite where it may not be.
    #[error("cannot record simulation {number} of trial {trial}: its {what} is {value}")]
    NotANumber {
        /// Which number.
        what: String,
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation.
        number: u32,
        /// What it is.
        value: f64,
    },
    /// The digest given with a trace is that of another.
    #[error(
        "cannot record simulation {number} of trial {trial}: its trace digest is {given:032x}, \
         but the trace given with it has {computed:032x}"
    )]
    WrongDigest {
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation.
        number: u32,
        /// As given.
        given: u128,
        /// As computed from the trace.
        computed: u128,
    },
    /// The header contradicts itself.
    #[error("cannot create a run: {what}")]
    BadHeader {
        /// What is wrong, and what would be right.
        what: String,
    },
    /// The simulation or the trial stands in the run already.
    #[error("cannot record {what}: it is in the run already")]
    AlreadyRecorded {
        /// Which one.
        what: String,
    },
    /// There is no such trial.
    #[error("the run holds no trial {trial}")]
    UnknownTrial {
        /// Its number.
        trial: u32,
    },
    /// There is no such simulation.
    #[error("the run holds no simulation {number} of trial {trial}")]
    UnknownSimulation {
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation.
        number: u32,
    },
    /// A file could not be read, written or removed.
    #[error("{what}: {source}")]
    Io {
        /// What was tried.
        what: String,
        /// What the system says.
        source: std::io::Error,
    },
    /// SQLite failed in a way that has no name here.
    #[error("SQLite failed: {message}: {}", path.display())]
    Sqlite {
        /// What SQLite says.
        message: String,
        /// The file.
        path: PathBuf,
    },
}

impl StoreError {
    pub(crate) fn damaged(path: &Path, what: impl Into<String>) -> Self {
        Self::Damaged { what: what.into() + if_without_log(path), path: path.into() }
    }

    /// The file is a database that does not say it is a run.
    pub(crate) fn of_another_program(path: &Path) -> Self {
        let found = "a SQLite database of another program, or one whose making was broken off";
        Self::NotARun { found: found.to_string() + if_without_log(path), path: path.into() }
    }

    /// `doing` is what was tried, as a verb.
    pub(crate) fn from_io(path: &Path, doing: &str, source: std::io::Error) -> Self {
        use std::io::ErrorKind;
        match source.kind() {
            ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem => {
                Self::ReadOnly { path: path.into() }
            }
            ErrorKind::StorageFull => Self::DiskFull { path: path.into() },
            _ => Self::Io { what: format!("cannot {doing} {}", path.display()), source },
        }
    }

    /// Gives SQLite's codes their meaning here. Our SQL text never changes, so a statement that SQLite cannot
    /// understand, or a value of an unexpected type, means that the file is not what it was.
    pub(crate) fn from_sqlite(path: &Path, error: &rusqlite::Error) -> Self {
        let path = path.to_path_buf();
        let message = error.to_string();
        let code = match error {
            rusqlite::Error::SqliteFailure(failure, _) => failure,
            rusqlite::Error::SqlInputError { error, .. } => error,
            _ => return Self::damaged(&path, message),
        };
        match (code.code, code.extended_code) {
            (ErrorCode::DiskFull, _) | (_, rusqlite::ffi::SQLITE_IOERR_SHMSIZE) => Self::DiskFull { path },
            (ErrorCode::DatabaseBusy | ErrorCode::DatabaseLocked, _) => Self::Locked { path },
            (ErrorCode::ReadOnly | ErrorCode::PermissionDenied, _) => Self::ReadOnly { path },
            (ErrorCode::CannotOpen, _) => Self::CannotOpen { path },
            (ErrorCode::NotADatabase, _) => Self::NotARun { found: "a file of another kind".into(), path },
            (ErrorCode::DatabaseCorrupt | ErrorCode::Unknown, _)
            | (_, rusqlite::ffi::SQLITE_IOERR_SHORT_READ) => Self::damaged(&path, message),
            _ => Self::Sqlite { message, path },
        }
    }
}

/// What else may be wrong with a file that SQLite would read together with a log, and that has none.
fn if_without_log(path: &Path) -> &'static str {
    // Bytes 18 and 19 of a SQLite file are 2 from the time its writer begins a log until it has closed the file.
    const VERSIONS: std::ops::Range<usize> = 18..20;
    let mut begin = [0; VERSIONS.end];
    let read = std::fs::File::open(path).and_then(|mut file| file.read_exact(&mut begin));
    let mut log = path.as_os_str().to_owned();
    log.push("-wal");
    let has_log = std::fs::metadata(log).is_ok_and(|found| found.len() > 0);
    if read.is_ok() && begin[VERSIONS] == [2, 2] && !has_log {
        ", or a run that was copied while it was written or after a kill, without the file ending in `-wal` beside it"
    } else {
        ""
    }
}

/// Says which file a failure of SQLite concerns.
pub(crate) trait InFile<T> {
    fn in_file(self, path: &Path) -> crate::Result<T>;
}

impl<T> InFile<T> for rusqlite::Result<T> {
    fn in_file(self, path: &Path) -> crate::Result<T> {
        self.map_err(|error| StoreError::from_sqlite(path, &error))
    }
}
