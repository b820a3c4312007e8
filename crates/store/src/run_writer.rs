//! Writes a run file.

use std::fs::{File, OpenOptions};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use mishandle_files::FileLock;
use rusqlite::{Connection, OpenFlags, OptionalExtension, ffi, params};

use crate::error::{InFile, StoreError};
use crate::run_file::{RunFile, connect, open};
use crate::schema::{APPLICATION_ID, FORMAT_VERSION};
use crate::upgrade::{STEPS, Step};
use crate::{
    Result, RunHeader, Simulation, TrialRecord, TrialStatus, header_table, row, schema, trace_blob, upgrade,
};

/// What to do if there is a run already where a new one is to be created.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum IfExists {
    /// Refuse, and leave it as it is.
    Refuse,
    /// Remove it, all of it. Only a run of ours, or a file with nothing in it, is ever removed.
    Replace,
}

/// The one writer of a run.
///
/// It holds a lock file beside the run and SQLite's write lock for as long as it lives, so that a second one is
/// refused, and readers are not. Each call is a transaction of its own: once it has returned, a killed process loses nothing of it.
/// (After a power failure the last few transactions may be missing; those before them are whole.)
#[derive(Debug)]
pub struct RunWriter {
    file: RunFile,
    /// SQLite's lock alone is free for a moment between two transactions. Dropped last, after the file is settled.
    _lock: Option<FileLock>,
}

impl RunWriter {
    /// Creates a run that holds the header and nothing else.
    ///
    /// # Errors
    /// [`Exists`](StoreError::Exists) if there is a file already that is not to be replaced,
    /// [`NotARun`](StoreError::NotARun) if it is not ours to replace, [`Locked`](StoreError::Locked) if it is
    /// being written; [`BadHeader`](StoreError::BadHeader) if names repeat or numbers are not finite;
    /// [`Missing`](StoreError::Missing), [`ReadOnly`](StoreError::ReadOnly) and
    /// [`NoRoom`](StoreError::NoRoom) for the folder.
    pub fn create(path: impl AsRef<Path>, header: &RunHeader, existing: IfExists) -> Result<Self> {
        let path = path.as_ref();
        header_table::guard(header)?;
        let mut writer_lock = None;
        if existing == IfExists::Replace && path.exists() {
            writer_lock = lock(path)?;
            remove(path)?;
        }
        claim(path).map_err(not_begun)?;
        if writer_lock.is_none() {
            writer_lock = lock(path)?;
        }
        fill(path, header, writer_lock).map_err(|error| {
            // What was made so far is ours and worth nothing; the first failure is the one to tell.
            let _ = remove_files(path);
            not_begun(error)
        })
    }

    /// Opens a run to record more in it. A file of an older format is upgraded first, in place.
    ///
    /// # Errors
    /// [`Locked`](StoreError::Locked) if another writer has it, [`ReadOnly`](StoreError::ReadOnly), and all
    /// that [`RunFile::open`] may find.
    pub fn resume(path: impl AsRef<Path>) -> Result<Self> {
        Self::resume_with(path.as_ref(), STEPS)
    }

    /// `resume` for a program that knows these steps.
    pub(crate) fn resume_with(path: &Path, steps: &[Step]) -> Result<Self> {
        let connection = connect(path, OpenFlags::SQLITE_OPEN_READ_WRITE)?;
        upgrade::version(&connection, path, steps)?;
        let writer_lock = lock(path)?;
        if connection.is_readonly("main").in_file(path)? {
            return Err(StoreError::ReadOnly { path: path.into() });
        }
        // An upgrade replaces tables that others refer to.
        connection.pragma_update(None, "foreign_keys", false).in_file(path)?;
        begin(&connection).in_file(path)?;
        // Asked again, now that nobody else can change it.
        let found = upgrade::version(&connection, path, steps)?;
        upgrade::upgrade(&connection, path, found, steps)?;
        connection.execute_batch("COMMIT").in_file(path)?;
        prepare(&connection, path)?;
        begin(&connection).in_file(path)?;
        let file = RunFile::of(connection, path)?;
        check_references(&file)?;
        Ok(Self { file, _lock: writer_lock })
    }

    /// The run as it stands, to read.
    pub fn file(&self) -> &RunFile {
        &self.file
    }

    /// Adds a trial, which is then running.
    ///
    /// # Errors
    /// [`AlreadyRecorded`](StoreError::AlreadyRecorded), or a failure of the file.
    pub fn start_trial(&mut self, trial: u32, seed: u64) -> Result<()> {
        self.transact(|file| {
            let row = TrialRecord { number: trial, seed, status: TrialStatus::Running };
            let inserted = row::insert_trial(&file.connection, &row);
            inserted.map(drop).map_err(|error| match constraint(&error) {
                Some(_) => StoreError::AlreadyRecorded { what: format!("trial {trial}") },
                None => StoreError::from_sqlite(&file.path, &error),
            })
        })
    }

    /// Says how a trial ended, or that it is running again.
    ///
    /// # Errors
    /// [`UnknownTrial`](StoreError::UnknownTrial), or a failure of the file.
    pub fn end_trial(&mut self, trial: u32, status: TrialStatus) -> Result<()> {
        self.transact(|file| {
            let row = TrialRecord { status, ..file.trial(trial)? };
            let sql = "UPDATE trial SET status = ?2, row_hash = ?3 WHERE number = ?1";
            let values = params![trial, row::status_text(status), row::trial_hash(&row)];
            file.connection.execute(sql, values).map(drop).in_file(&file.path)
        })
    }

    /// Records simulations, all of them or, on an error, none.
    ///
    /// A simulation with a trace and no digest gets the digest of its trace.
    ///
    /// # Errors
    /// [`UnknownTrial`](StoreError::UnknownTrial), [`AlreadyRecorded`](StoreError::AlreadyRecorded),
    /// [`WrongLength`](StoreError::WrongLength), [`NotANumber`](StoreError::NotANumber),
    /// [`NumberedFromOne`](StoreError::NumberedFromOne) and [`WrongDigest`](StoreError::WrongDigest) for a
    /// simulation that does not fit; [`DiskFull`](StoreError::DiskFull) or another failure of the file. The
    /// writer can be used on after any of them.
    pub fn record(&mut self, simulations: &[Simulation]) -> Result<()> {
        for simulation in simulations {
            row::guard(simulation, self.file.header())?;
        }
        if simulations.is_empty() {
            return Ok(());
        }
        self.transact(|file| simulations.iter().try_for_each(|simulation| insert(file, simulation)))
    }

    /// Ends the writing: everything is on the disk, in a single file.
    ///
    /// Dropping the writer does the same, but cannot say if it failed. While somebody reads the run, the log
    /// beside the file stays; it goes with the last of them.
    ///
    /// # Errors
    /// A failure of the file; what was recorded is safe all the same, in the file and its log.
    pub fn close(self) -> Result<()> {
        settle(&self.file.connection).in_file(&self.file.path)
    }

    /// Runs `work` in the transaction that is open, commits it and opens the next.
    fn transact(&mut self, work: impl FnOnce(&RunFile) -> Result<()>) -> Result<()> {
        let (connection, path) = (&self.file.connection, &self.file.path);
        if connection.is_autocommit() {
            begin(connection).in_file(path)?;
        }
        let done = work(&self.file).and_then(|()| connection.execute_batch("COMMIT").in_file(path));
        if done.is_err() && !connection.is_autocommit() {
            // SQLite rolls back by itself when the connection ends, should this fail.
            let _ = connection.execute_batch("ROLLBACK");
        }
        // Should this fail, the next call tries again, and reports it.
        let _ = begin(connection);
        done
    }
}

impl Drop for RunWriter {
    fn drop(&mut self) {
        // Nobody is left to tell; the log holds what could not be moved into the file.
        let _ = settle(&self.file.connection);
    }
}

/// A failure of a run that is not there: nothing of it is safe, and nothing can be resumed.
fn not_begun(error: StoreError) -> StoreError {
    match error {
        StoreError::DiskFull { path } => StoreError::NoRoom { path },
        error => error,
    }
}

/// Takes the name, so that of two processes one is refused.
fn claim(path: &Path) -> Result<File> {
    OpenOptions::new().write(true).create_new(true).open(path).map_err(|source| match source.kind() {
        ErrorKind::AlreadyExists => StoreError::Exists { path: path.into() },
        ErrorKind::NotFound => StoreError::Missing { what: "the folder", path: path.into() },
        _ => StoreError::from_io(path, "create", source),
    })
}

/// Makes a run of an empty file.
fn fill(path: &Path, header: &RunHeader, writer_lock: Option<FileLock>) -> Result<RunWriter> {
    let connection = open(path, OpenFlags::SQLITE_OPEN_READ_WRITE)?;
    prepare(&connection, path)?;
    begin(&connection).in_file(path)?;
    schema::create(&connection, header).in_file(path)?;
    connection.pragma_update(None, "application_id", APPLICATION_ID).in_file(path)?;
    connection.pragma_update(None, "user_version", FORMAT_VERSION).in_file(path)?;
    header_table::write(&connection, header).in_file(path)?;
    connection.execute_batch("COMMIT").in_file(path)?;
    begin(&connection).in_file(path)?;
    Ok(RunWriter { file: RunFile::of(connection, path)?, _lock: writer_lock })
}

/// Keeps other writers away from a run. Where no lock file can be made, SQLite's own lock has to do, and what is wrong with
/// the folder shows when the run is written.
fn lock(path: &Path) -> Result<Option<FileLock>> {
    match FileLock::try_acquire(&lock_file(path)) {
        Ok(None) => Err(StoreError::Locked { path: path.into() }),
        Ok(lock) => Ok(lock),
        Err(_) => Ok(None),
    }
}

fn lock_file(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".lock");
    name.into()
}

/// Refuses a run whose rows refer to rows that are missing.
fn check_references(file: &RunFile) -> Result<()> {
    let (connection, path) = (&file.connection, &file.path);
    let missing: Option<(String, String)> = connection
        .query_row("SELECT \"table\", \"parent\" FROM pragma_foreign_key_check", [], |row| {
            Ok((row.get(0)?, row.get(1)?))
        })
        .optional()
        .in_file(path)?;
    match missing {
        Some((table, parent)) => Err(StoreError::damaged(
            path,
            format!("a row of its {table}s refers to a {parent} that is missing"),
        )),
        None => Ok(()),
    }
}

/// Sets what a writer needs of SQLite.
fn prepare(connection: &Connection, path: &Path) -> Result<()> {
    if connection.is_readonly("main").in_file(path)? {
        return Err(StoreError::ReadOnly { path: path.into() });
    }
    connection.pragma_update(None, "journal_mode", "WAL").in_file(path)?;
    connection.pragma_update(None, "synchronous", "NORMAL").in_file(path)?;
    connection.pragma_update(None, "foreign_keys", true).in_file(path)
}

/// Takes the write lock, which the writer holds from one transaction to the next.
fn begin(connection: &Connection) -> rusqlite::Result<()> {
    connection.execute_batch("BEGIN IMMEDIATE")
}

/// Moves the log into the file and leaves the file alone, if no reader is in the way.
fn settle(connection: &Connection) -> rusqlite::Result<()> {
    if !connection.is_autocommit() {
        connection.execute_batch("ROLLBACK")?;
    }
    connection.query_row("PRAGMA wal_checkpoint(TRUNCATE)", [], |_| Ok(()))?;
    match connection.pragma_update(None, "journal_mode", "DELETE") {
        Err(error) if error.sqlite_error_code() == Some(rusqlite::ErrorCode::DatabaseBusy) => Ok(()),
        done => done,
    }
}

fn insert(file: &RunFile, simulation: &Simulation) -> Result<()> {
    let (trial, number) = (simulation.trial, simulation.number);
    let mut trace_digest = simulation.trace_digest;
    if let Some(trace) = &simulation.trace {
        let computed = trace.digest();
        let given = trace_digest.unwrap_or(computed);
        if given != computed {
            return Err(StoreError::WrongDigest { trial, number, given, computed });
        }
        trace_digest = Some(computed);
    }
    let inserted = row::insert(&file.connection, file.header(), simulation, trace_digest);
    inserted.map_err(|error| match constraint(&error) {
        Some(ffi::SQLITE_CONSTRAINT_FOREIGNKEY) => StoreError::UnknownTrial { trial },
        Some(_) => StoreError::AlreadyRecorded { what: format!("simulation {number} of trial {trial}") },
        None => StoreError::from_sqlite(&file.path, &error),
    })?;
    if let Some(trace) = &simulation.trace {
        let sql = "INSERT INTO trace (trial, number, blob) VALUES (?1, ?2, ?3)";
        let mut statement = file.connection.prepare_cached(sql).in_file(&file.path)?;
        statement.execute(params![trial, number, trace_blob::encode(trace)]).in_file(&file.path)?;
    }
    Ok(())
}

/// The extended code, if a constraint of the tables was violated.
fn constraint(error: &rusqlite::Error) -> Option<i32> {
    let failure = error.sqlite_error()?;
    (failure.code == rusqlite::ErrorCode::ConstraintViolation).then_some(failure.extended_code)
}

/// Removes a run that is ours, whole or begun, and that nobody writes.
fn remove(path: &Path) -> Result<()> {
    if std::fs::metadata(path).is_ok_and(|found| found.is_file() && found.len() > 0) {
        let connection = connect(path, OpenFlags::SQLITE_OPEN_READ_WRITE)?;
        // A newer or an older one is a run too, and so is one whose making was broken off.
        match upgrade::version(&connection, path, STEPS) {
            Ok(_) | Err(StoreError::NewerVersion { .. }) => {}
            Err(StoreError::NotARun { .. }) if is_blank(&connection) => {}
            Err(error) => return Err(error),
        }
        begin(&connection).in_file(path)?;
    }
    remove_files(path)
}

/// Whether this is a database without a single table.
fn is_blank(connection: &Connection) -> bool {
    connection.query_row("SELECT count(*) FROM sqlite_schema", [], |row| row.get(0)) == Ok(0)
}

fn remove_files(path: &Path) -> Result<()> {
    let beside = |suffix: &str| {
        let mut name = path.as_os_str().to_owned();
        name.push(suffix);
        PathBuf::from(name)
    };
    for file in [path.into(), beside("-wal"), beside("-shm"), beside("-journal")] {
        match std::fs::remove_file(&file) {
            Err(source) if source.kind() != ErrorKind::NotFound => {
                return Err(StoreError::from_io(&file, "remove", source));
            }
            _ => {}
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BuildRecord, RunKind, SignalRecord, SimulationEnd, StoredTrace, TargetRecord};

    fn traced(number: u32) -> Simulation {
        // Noise, so that it takes as much room as it has bits.
        let column = (0..301_u32).map(|step| f64::from(step * 31 + number * 17).sin()).collect();
        Simulation {
            trial: 1,
            number,
            seed: 0,
            unit_point: vec![],
            scenario: vec![],
            robustness: Some(1.0),
            robustness_low: Some(1.0),
            robustness_high: Some(1.0),
            stop_threshold: None,
            end: SimulationEnd::Completed,
            steps: 300,
            verdicts: vec![],
            trace_digest: None,
            trace: Some(StoredTrace { columns: vec![column] }),
        }
    }

    #[test]
    fn a_run_that_found_no_room_to_begin_is_not_to_be_resumed() {
        let full = StoreError::from_io(Path::new("run"), "create", ErrorKind::StorageFull.into());
        assert_eq!(not_begun(full).to_string(), "the disk is full, so the run could not be begun: run");
    }

    #[test]
    fn a_full_disk_loses_nothing_that_was_recorded() {
        let header = RunHeader {
            kind: RunKind::Falsify,
            build: BuildRecord::default(),
            versions: vec![],
            plan: String::new(),
            target: TargetRecord::default(),
            components: vec![],
            space: String::new(),
            formula: String::new(),
            formulas: vec![],
            search: String::new(),
            seed: 0,
            control_dt: 1.0,
            episode_steps: 300,
            signals: vec![SignalRecord { name: "a".into(), unit: String::new() }],
            axes: vec![],
            verdicts: vec![],
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.sqlite");
        let mut writer = RunWriter::create(&path, &header, IfExists::Refuse).unwrap();
        writer.start_trial(1, 0).unwrap();
        writer.file.connection.pragma_update(None, "max_page_count", 100).unwrap();

        let mut recorded = 0;
        let error = loop {
            match writer.record(&[traced(recorded + 1), traced(recorded + 2), traced(recorded + 3)]) {
                Ok(()) => recorded += 3,
                Err(error) => break error,
            }
        };
        assert!(matches!(error, StoreError::DiskFull { .. }), "{error}");
        assert!(recorded > 30, "{recorded}");
        assert_eq!(writer.file().last_number(1).unwrap(), recorded);

        // With room again, the same writer goes on.
        writer.file.connection.pragma_update(None, "max_page_count", 10_000).unwrap();
        writer.record(&[traced(recorded + 1)]).unwrap();
        writer.close().unwrap();
        let run = RunFile::open(&path).unwrap();
        run.check().unwrap();
        assert_eq!(run.simulation(1, recorded).unwrap().trace, traced(recorded).trace);
        assert_eq!(run.last_number(1).unwrap(), recorded + 1);
    }
}
