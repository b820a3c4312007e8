//! SQLite connections that are protected against damaged and malicious files.

use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use rusqlite::config::DbConfig;
use rusqlite::limits::Limit;
use rusqlite::{Connection, OpenFlags};

use crate::Result;
use crate::error::{InFile, StoreError};
use crate::run_file::not_closed;
use crate::trace_blob::MAX_BLOB_BYTES;

/// Longest wait for a lock of another process. Such locks are short.
const BUSY_TIMEOUT: Duration = Duration::from_secs(1);

/// Largest value of a column, except for traces.
const MAX_VALUE_BYTES: usize = 8 << 20;

/// Largest number of tables, views and indexes. A run file has 23, and SQLite's statistics are two
/// more.
const MAX_OBJECTS: i32 = 64;

/// Number of SQLite's instructions between two looks at the clock, about 1 ms.
const INSTRUCTIONS: i32 = 100_000;

/// A connection to a run file. A statement that takes longer than its time limit fails.
#[derive(Debug)]
pub(crate) struct Database {
    connection: Connection,
    timer: Timer,
}

impl Database {
    /// Connects to an existing file, and checks that it is a non-empty regular file.
    pub(crate) fn connect(path: &Path, access: OpenFlags) -> Result<Self> {
        let found = std::fs::metadata(path).map_err(|source| match source.kind() {
            std::io::ErrorKind::NotFound => StoreError::Missing { what: "the file", path: path.into() },
            _ => StoreError::Io { what: format!("cannot open the run {}", path.display()), source },
        })?;
        if !found.is_file() {
            return Err(StoreError::NotARun { found: "a folder or a device".into(), path: path.into() });
        }
        if found.len() == 0 {
            return Err(StoreError::Unfinished { path: path.into() });
        }
        Self::open(path, access)
    }

    /// Connects to an existing file for reading, and checks that it is a non-empty regular file.
    pub(crate) fn connect_for_reading(path: &Path) -> Result<Self> {
        let database = Self::connect(path, OpenFlags::SQLITE_OPEN_READ_ONLY)?;
        let read = |database: &Self| database.sql().pragma_query_value(None, "application_id", |_| Ok(()));
        match read(&database).map_err(|error| error.sqlite_error().map(|failure| failure.extended_code)) {
            // A process was killed while it closed the run, and left a rollback journal. Only a
            // connection with write access can apply it.
            Err(Some(rusqlite::ffi::SQLITE_READONLY_ROLLBACK)) => {
                let writer = Self::connect(path, OpenFlags::SQLITE_OPEN_READ_WRITE)?;
                read(&writer).in_file(path).map_err(not_closed)?;
                Self::connect(path, OpenFlags::SQLITE_OPEN_READ_ONLY)
            }
            _ => Ok(database),
        }
    }

    /// Connects to an existing file, which can be empty.
    pub(crate) fn open(path: &Path, access: OpenFlags) -> Result<Self> {
        // SQLite would read `file:NAME?mode=memory` as a URI and `:memory:` as a database without a
        // file. An absolute path is neither.
        let absolute = std::path::absolute(path)
            .map_err(|source| StoreError::from_io(path, "find the folder of", source))?;
        check_side_files(&absolute)?;
        let mut connection =
            Connection::open_with_flags(&absolute, access | OpenFlags::SQLITE_OPEN_NO_MUTEX).in_file(path)?;
        connection.busy_timeout(BUSY_TIMEOUT).in_file(path)?;
        protect(&connection).in_file(path)?;
        let timer = Timer::new(absolute);
        timer.install(&mut connection).in_file(path)?;
        Ok(Self { connection, timer })
    }

    /// Returns the connection for a statement, whose time limit starts now.
    pub(crate) fn sql(&self) -> &Connection {
        self.timer.restart();
        &self.connection
    }

    /// Does `work` with a statement that reads or writes traces, which can be larger than other
    /// values.
    pub(crate) fn with_traces<T>(
        &self,
        work: impl FnOnce(&Connection) -> rusqlite::Result<T>,
    ) -> rusqlite::Result<T> {
        let connection = self.sql();
        set_limit(connection, Limit::SQLITE_LIMIT_LENGTH, MAX_BLOB_BYTES)?;
        let done = work(connection);
        set_limit(connection, Limit::SQLITE_LIMIT_LENGTH, MAX_VALUE_BYTES)?;
        done
    }
}

/// Checks that the files that SQLite keeps beside a run are regular files. SQLite would wait for
/// the writer of a FIFO.
fn check_side_files(path: &Path) -> Result<()> {
    for suffix in ["-journal", "-wal", "-shm"] {
        let mut name = path.as_os_str().to_owned();
        name.push(suffix);
        let side_file = PathBuf::from(name);
        if std::fs::symlink_metadata(&side_file).is_ok_and(|found| !found.is_file()) {
            let what = format!("cannot open the run {}", path.display());
            let problem = format!("{} is not a regular file; remove it", side_file.display());
            return Err(StoreError::Io { what, source: std::io::Error::other(problem) });
        }
        if suffix == "-journal" && names_other_journals(&side_file) {
            let what = format!("{} refers to other files, which a run never does", side_file.display());
            return Err(StoreError::damaged(path, what));
        }
    }
    Ok(())
}

/// Returns whether a rollback journal ends with the name of a super-journal, which SQLite would
/// open, and all files that it lists. Transactions of several databases have one; a run is a single
/// database.
fn names_other_journals(journal: &Path) -> bool {
    // The last bytes of such a journal: <https://sqlite.org/fileformat2.html#the_rollback_journal>.
    const MAGIC: [u8; 8] = [0xd9, 0xd5, 0x05, 0xf9, 0x20, 0xa1, 0x63, 0xd7];
    let mut last = [0; MAGIC.len()];
    let found = std::fs::File::open(journal).and_then(|mut file| {
        file.seek(SeekFrom::End(-(MAGIC.len() as i64)))?;
        file.read_exact(&mut last)
    });
    found.is_ok() && last == MAGIC
}

fn set_limit(connection: &Connection, limit: Limit, bytes: usize) -> rusqlite::Result<()> {
    connection.set_limit(limit, i32::try_from(bytes).unwrap_or(i32::MAX)).map(drop)
}

fn protect(connection: &Connection) -> rusqlite::Result<()> {
    connection.pragma_update(None, "cell_size_check", true)?;
    for (option, value) in [
        (DbConfig::SQLITE_DBCONFIG_DEFENSIVE, true),
        (DbConfig::SQLITE_DBCONFIG_TRUSTED_SCHEMA, false),
        (DbConfig::SQLITE_DBCONFIG_ENABLE_TRIGGER, false),
        (DbConfig::SQLITE_DBCONFIG_ENABLE_VIEW, false),
    ] {
        connection.set_db_config(option, value)?;
    }
    connection.set_limit(Limit::SQLITE_LIMIT_ATTACHED, 0)?;
    connection.set_limit(Limit::SQLITE_LIMIT_SCHEMA, MAX_OBJECTS)?;
    set_limit(connection, Limit::SQLITE_LIMIT_LENGTH, MAX_VALUE_BYTES)
}

/// The time limit of a statement: 30 s, and 1 s for each MiB of the file.
#[derive(Debug, Clone)]
struct Timer {
    deadline: Arc<Mutex<Instant>>,
    path: PathBuf,
}

impl Timer {
    const BASE: Duration = Duration::from_secs(30);

    fn new(path: PathBuf) -> Self {
        let timer = Self { deadline: Arc::new(Mutex::new(Instant::now())), path };
        timer.restart();
        timer
    }

    fn restart(&self) {
        let mebibytes = std::fs::metadata(&self.path).map_or(0, |found| found.len() >> 20);
        self.set(Instant::now() + Self::BASE + Duration::from_secs(mebibytes));
    }

    fn set(&self, deadline: Instant) {
        *self.deadline.lock().unwrap_or_else(PoisonError::into_inner) = deadline;
    }

    fn install(&self, connection: &mut Connection) -> rusqlite::Result<()> {
        let deadline = self.deadline.clone();
        let is_late = move || Instant::now() > *deadline.lock().unwrap_or_else(PoisonError::into_inner);
        connection.progress_handler(INSTRUCTIONS, Some(is_late))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_statement_without_end_fails_at_its_time_limit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run");
        std::fs::write(&path, "").unwrap();
        let database = Database::open(&path, OpenFlags::SQLITE_OPEN_READ_WRITE).unwrap();
        let connection = database.sql();
        database.timer.set(Instant::now() + Duration::from_millis(50));
        let endless =
            "WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n) SELECT count(*) FROM n";
        let error = connection.query_row(endless, [], |_| Ok(())).in_file(&path).unwrap_err();
        assert!(matches!(error, StoreError::TooSlow { .. }), "{error}");
        // The next statement has its own limit.
        assert_eq!(database.sql().query_row("SELECT 1", [], |row| row.get(0)), Ok(1));
    }

    #[cfg(unix)]
    #[test]
    fn a_planted_socket_link_or_fifo_beside_a_run_is_an_error() {
        for suffix in ["-journal", "-wal", "-shm"] {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("run");
            std::fs::write(&path, "").unwrap();
            let planted = folder.path().join(format!("run{suffix}"));
            let message = || match Database::open(&path, OpenFlags::SQLITE_OPEN_READ_WRITE) {
                Err(StoreError::Io { source, .. }) => source.to_string(),
                other => panic!("{other:?}"),
            };
            let socket = std::os::unix::net::UnixListener::bind(&planted).unwrap();
            assert!(message().contains("is not a regular file"), "{}", message());
            drop(socket);
            std::fs::remove_file(&planted).unwrap();
            std::os::unix::fs::symlink("/dev/null", &planted).unwrap();
            assert!(message().contains("is not a regular file"), "{}", message());
            std::fs::remove_file(&planted).unwrap();
            // SQLite would wait for its writer.
            assert!(std::process::Command::new("mkfifo").arg(&planted).status().unwrap().success());
            assert!(message().contains("is not a regular file"), "{}", message());
        }
    }

    #[test]
    fn a_planted_journal_cannot_name_other_files_for_sqlite_to_open() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run");
        std::fs::write(&path, "").unwrap();
        let mut journal = vec![0; 512];
        journal.extend([0xd9, 0xd5, 0x05, 0xf9, 0x20, 0xa1, 0x63, 0xd7]);
        std::fs::write(folder.path().join("run-journal"), journal).unwrap();
        let error = Database::open(&path, OpenFlags::SQLITE_OPEN_READ_WRITE).unwrap_err().to_string();
        assert!(error.contains("refers to other files"), "{error}");
    }

    #[test]
    fn a_path_is_never_read_as_a_uri() {
        let folder = tempfile::tempdir().unwrap();
        let victim = folder.path().join("victim");
        std::fs::write(&victim, "").unwrap();
        let path = PathBuf::from(format!("file:{}", victim.display()));
        // There is no file of that name, so there is nothing to open.
        let error = Database::open(&path, OpenFlags::SQLITE_OPEN_READ_WRITE).unwrap_err();
        assert!(matches!(error, StoreError::CannotOpen { .. }), "{error}");
    }
}
