//! Writing of run files.

use std::fs::{File, OpenOptions};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use mishandle_files::FileLock;
use rusqlite::{Connection, OpenFlags, ffi, params};

use crate::database::Database;
use crate::error::{InFile, StoreError};
use crate::run_file::RunFile;
use crate::version::{APPLICATION_ID, FORMAT_VERSION};
use crate::{
    Finding, Result, RunHeader, ScreenedChunk, Simulation, TrialRecord, TrialStatus, finding, header_table,
    memory, reason, row, schema, screened, trace_blob, version,
};

/// Behavior of [`RunWriter::create`] if the file exists.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum IfExists {
    /// Return [`StoreError::Exists`] and leave the file unchanged.
    Refuse,
    /// Replace the file. Only a run file or an empty file can be replaced.
    Replace,
}

/// The writer of a run. A run has at most one writer.
///
/// The writer holds a lock file beside the run and SQLite's write lock. A second writer gets
/// [`StoreError::Locked`]; readers are not blocked. Each call is one transaction: a process that is
/// killed after the call has returned loses nothing of it. After a power failure, the transactions
/// since the last sync can be missing, the last ones first; the earlier ones are complete.
/// [`create`](Self::create) and [`close`](Self::close) sync, and SQLite does so each time it moves
/// the log into the file, about every 4 MB. After [`set_durable`](Self::set_durable), each call
/// syncs.
#[derive(Debug)]
pub struct RunWriter {
    file: RunFile,
    /// Whether the open transaction contains rows of a call that failed.
    needs_rollback: bool,
    /// Needed in addition to SQLite's lock, which is released for a moment between two
    /// transactions. Dropped last, after the file is closed.
    _lock: FileLock,
}

impl RunWriter {
    /// Creates a run that contains only the header. Always replaces a file without content, which a
    /// program leaves that is killed while it creates a run.
    ///
    /// # Errors
    /// - [`Exists`](StoreError::Exists) if the file exists and `existing` is [`IfExists::Refuse`];
    /// - [`NotARun`](StoreError::NotARun) if the file to replace is not a run file;
    /// - [`Locked`](StoreError::Locked) if another process is writing the run;
    /// - [`BadHeader`](StoreError::BadHeader) if names are not unique or numbers are not finite;
    /// - [`Missing`](StoreError::Missing), [`ReadOnly`](StoreError::ReadOnly) or
    ///   [`NoRoom`](StoreError::NoRoom) for the folder.
    pub fn create(path: impl AsRef<Path>, header: &RunHeader, existing: IfExists) -> Result<Self> {
        let path = path.as_ref();
        header_table::guard(header)?;
        if existing == IfExists::Refuse && path.exists() && !is_unfinished(path) {
            return Err(StoreError::Exists { path: path.into() });
        }
        // Before the file: a process that has no lock never removes or creates the file.
        let writer_lock = lock(path)?;
        if path.exists() {
            // Another process may have finished it in the meantime.
            if existing == IfExists::Refuse && !is_unfinished(path) {
                return Err(StoreError::Exists { path: path.into() });
            }
            remove(path)?;
        }
        create_file(path).map_err(creation_error)?;
        initialize(path, header, writer_lock).map_err(|error| {
            // Removes the incomplete run. The first error is the one to report.
            let _ = remove_files(path);
            creation_error(error)
        })
    }

    /// Opens a run to add records, and checks it as [`RunFile::open`] does.
    ///
    /// # Errors
    /// [`Locked`](StoreError::Locked) if another process is writing the run,
    /// [`ReadOnly`](StoreError::ReadOnly), or an error of [`RunFile::open`].
    pub fn resume(path: impl AsRef<Path>) -> Result<Self> {
        Self::open(path.as_ref(), true)
    }

    /// Opens a run as [`resume`](Self::resume) does, without the check.
    ///
    /// # Errors
    /// The errors of [`resume`](Self::resume).
    pub fn resume_unchecked(path: impl AsRef<Path>) -> Result<Self> {
        Self::open(path.as_ref(), false)
    }

    /// Opens a run to add records, and checks it if `check` is true.
    fn open(path: &Path, check: bool) -> Result<Self> {
        let database = Database::connect(path, OpenFlags::SQLITE_OPEN_READ_WRITE)?;
        version::check(database.sql(), path)?;
        let writer_lock = lock(path)?;
        if database.sql().is_readonly("main").in_file(path)? {
            return Err(StoreError::ReadOnly { path: path.into() });
        }
        begin(database.sql()).in_file(path)?;
        // Checked again: now no other process can change it.
        version::check(database.sql(), path)?;
        let file = RunFile::of(database, path)?;
        if check {
            file.check_opened()?;
        }
        file.database.sql().execute_batch("COMMIT").in_file(path)?;
        prepare(file.database.sql(), path)?;
        begin(file.database.sql()).in_file(path)?;
        file.check_references()?;
        Ok(Self { file, needs_rollback: false, _lock: writer_lock })
    }

    /// Makes each later call wait until its records are on the disk, so that a power failure loses
    /// none of them.
    ///
    /// # Errors
    /// An error of the file.
    pub fn set_durable(&mut self) -> Result<()> {
        let connection = self.file.database.sql();
        let path = &self.file.path;
        // SQLite changes the setting only between transactions. The open one is empty.
        if !connection.is_autocommit() {
            connection.execute_batch("ROLLBACK").in_file(path)?;
        }
        synchronous(connection, "FULL").in_file(path)?;
        begin(connection).in_file(path)
    }

    /// Returns the run for reading, with all records up to now.
    pub fn file(&self) -> &RunFile {
        &self.file
    }

    /// Adds a version to the header, such as that of another program that continues the run.
    ///
    /// # Errors
    /// [`BadHeader`](StoreError::BadHeader) if there is a version of this name or the text is too
    /// long, or an error of the file.
    pub fn add_version(&mut self, name: &str, version: &str) -> Result<()> {
        let mut header = self.file.header().clone();
        header.versions.push((name.to_string(), version.to_string()));
        header_table::guard(&header)?;
        self.transact(|file| header_table::add_version(file.database.sql(), &header).in_file(&file.path))?;
        self.file.set_header(header);
        Ok(())
    }

    /// Adds a trial with status [`Running`](TrialStatus::Running).
    ///
    /// # Errors
    /// [`AlreadyRecorded`](StoreError::AlreadyRecorded), or another error of the file.
    pub fn start_trial(&mut self, trial: u32, seed: u64) -> Result<()> {
        self.transact(|file| {
            let row = TrialRecord { number: trial, seed, status: TrialStatus::Running };
            let inserted = row::insert_trial(file.database.sql(), &row);
            inserted.map(drop).map_err(|error| match constraint(&error) {
                Some(_) => StoreError::AlreadyRecorded { what: format!("trial {trial}") },
                None => StoreError::from_sqlite(&file.path, &error),
            })
        })
    }

    /// Sets the status of a trial.
    ///
    /// # Errors
    /// [`UnknownTrial`](StoreError::UnknownTrial), or another error of the file.
    pub fn end_trial(&mut self, trial: u32, status: TrialStatus) -> Result<()> {
        self.transact(|file| {
            let row = TrialRecord { status, ..file.trial(trial)? };
            let sql = "UPDATE trial SET status = ?2, row_hash = ?3 WHERE number = ?1";
            let values = params![trial, row::status_text(status), row::trial_hash(&row)];
            file.database.sql().execute(sql, values).map(drop).in_file(&file.path)
        })
    }

    /// Records simulations in one transaction: on an error, none of them is recorded.
    ///
    /// A simulation with a trace and without a digest gets the digest of its trace.
    ///
    /// # Errors
    /// [`UnknownTrial`](StoreError::UnknownTrial),
    /// [`AlreadyRecorded`](StoreError::AlreadyRecorded), [`WrongLength`](StoreError::WrongLength),
    /// [`NotANumber`](StoreError::NotANumber), [`SimulationZero`](StoreError::SimulationZero) and
    /// [`WrongDigest`](StoreError::WrongDigest) for a simulation that does not fit the run;
    /// [`DiskFull`](StoreError::DiskFull) or another error of the file. The writer remains usable
    /// after an error. If memory is exhausted at the end of the transaction, the simulations can be
    /// recorded in spite of the error.
    pub fn record(&mut self, simulations: &[Simulation]) -> Result<()> {
        for simulation in simulations {
            row::guard(simulation, self.file.header())?;
        }
        if simulations.is_empty() {
            return Ok(());
        }
        self.transact(|file| simulations.iter().try_for_each(|simulation| insert(file, simulation)))
    }

    /// Records steered simulations as [`record`](Self::record) does, and what their proposal
    /// remembers of each of them.
    ///
    /// # Errors
    /// Those of [`record`](Self::record).
    pub fn record_steered(&mut self, simulations: &[(Simulation, Vec<f64>)]) -> Result<()> {
        for (simulation, _) in simulations {
            row::guard(simulation, self.file.header())?;
        }
        self.transact(|file| {
            simulations.iter().try_for_each(|(simulation, memory)| {
                insert(file, simulation)?;
                memory::insert(file, simulation.trial, simulation.number, memory)
            })
        })
    }

    /// Records the outcomes of another physics engine in one transaction.
    ///
    /// # Errors
    /// [`DiskFull`](StoreError::DiskFull) or another error of the file. Then nothing is recorded.
    pub fn record_screened(&mut self, chunk: &ScreenedChunk) -> Result<()> {
        self.transact(|file| screened::insert(file, chunk))
    }

    /// Records answers of further simulations about recorded ones, in one transaction. A finding
    /// replaces an earlier one of its kind.
    ///
    /// # Errors
    /// An error of the file, also for a simulation that the run does not have. Then nothing is
    /// recorded.
    pub fn record_findings(&mut self, findings: &[Finding]) -> Result<()> {
        if findings.is_empty() {
            return Ok(());
        }
        self.transact(|file| finding::insert(file, findings))
    }

    /// Closes the run and moves all records into a single file.
    ///
    /// Dropping the writer does the same, but ignores errors. While another process reads the run,
    /// the log beside the file remains; the last reader removes it.
    ///
    /// # Errors
    /// An error of the file. The records are safe in the file and its log.
    pub fn close(self) -> Result<()> {
        merge_log(self.file.database.sql()).in_file(&self.file.path)
    }

    /// Runs `work` in the open transaction, commits it and begins the next one.
    fn transact(&mut self, work: impl FnOnce(&RunFile) -> Result<()>) -> Result<()> {
        let connection = self.file.database.sql();
        let path = &self.file.path;
        if self.needs_rollback && !connection.is_autocommit() {
            connection.execute_batch("ROLLBACK").in_file(path)?;
        }
        self.needs_rollback = false;
        if connection.is_autocommit() {
            begin(connection).in_file(path)?;
        }
        let done = work(&self.file).and_then(|()| connection.execute_batch("COMMIT").in_file(path));
        if done.is_err() && !connection.is_autocommit() {
            // If this fails, the next call tries again.
            self.needs_rollback = connection.execute_batch("ROLLBACK").is_err();
        }
        // If this fails, the next call tries again and reports the error.
        let _ = begin(connection);
        done
    }
}

impl Drop for RunWriter {
    fn drop(&mut self) {
        // An error cannot be reported here. The records are safe in the log.
        let _ = merge_log(self.file.database.sql());
    }
}

/// Converts an error during creation: unlike after [`StoreError::DiskFull`], there is no run to
/// resume.
fn creation_error(error: StoreError) -> StoreError {
    match error {
        StoreError::DiskFull { path } => StoreError::NoRoom { path },
        error => error,
    }
}

/// Creates an empty file. Of two processes that create the same run, one gets an error.
fn create_file(path: &Path) -> Result<File> {
    OpenOptions::new().write(true).create_new(true).open(path).map_err(|source| match source.kind() {
        ErrorKind::AlreadyExists => StoreError::Exists { path: path.into() },
        ErrorKind::NotFound => StoreError::Missing { what: "the folder", path: path.into() },
        _ => StoreError::from_io(path, "create", source),
    })
}

/// Writes tables and header to an empty file.
fn initialize(path: &Path, header: &RunHeader, writer_lock: FileLock) -> Result<RunWriter> {
    let database = Database::open(path, OpenFlags::SQLITE_OPEN_READ_WRITE)?;
    let connection = database.sql();
    prepare(connection, path)?;
    // A run without a header could not be resumed.
    synchronous(connection, "FULL").in_file(path)?;
    begin(connection).in_file(path)?;
    schema::create(connection, header).in_file(path)?;
    connection.pragma_update(None, "application_id", APPLICATION_ID).in_file(path)?;
    connection.pragma_update(None, "user_version", FORMAT_VERSION).in_file(path)?;
    header_table::write(connection, header).in_file(path)?;
    connection.execute_batch("COMMIT").in_file(path)?;
    synchronous(connection, "NORMAL").in_file(path)?;
    begin(connection).in_file(path)?;
    Ok(RunWriter { file: RunFile::of(database, path)?, needs_rollback: false, _lock: writer_lock })
}

/// Locks a run against other writers.
fn lock(path: &Path) -> Result<FileLock> {
    match FileLock::try_acquire(&lock_file(path)) {
        Ok(Some(lock)) => Ok(lock),
        Ok(None) => Err(StoreError::Locked { path: path.into() }),
        Err(source) if source.kind() == ErrorKind::NotFound => {
            Err(StoreError::Missing { what: "the folder", path: path.into() })
        }
        Err(source) => Err(StoreError::from_io(path, "lock", source)),
    }
}

fn lock_file(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".lock");
    name.into()
}

/// Sets the journal mode and other options of a writer.
fn prepare(connection: &Connection, path: &Path) -> Result<()> {
    if connection.is_readonly("main").in_file(path)? {
        return Err(StoreError::ReadOnly { path: path.into() });
    }
    connection.pragma_update(None, "journal_mode", "WAL").in_file(path)?;
    synchronous(connection, "NORMAL").in_file(path)?;
    connection.pragma_update(None, "foreign_keys", true).in_file(path)
}

/// Sets when SQLite syncs: `FULL` at each commit, `NORMAL` before it moves the log into the file.
fn synchronous(connection: &Connection, level: &str) -> rusqlite::Result<()> {
    connection.pragma_update(None, "synchronous", level)
}

/// Begins a transaction with the write lock, which the writer holds until the next transaction.
fn begin(connection: &Connection) -> rusqlite::Result<()> {
    connection.execute_batch("BEGIN IMMEDIATE")
}

/// Moves the log into the file and removes the log, unless a reader uses it.
fn merge_log(connection: &Connection) -> rusqlite::Result<()> {
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
    let trial = simulation.trial;
    let number = simulation.number;
    let mut trace_digest = simulation.trace_digest;
    if let Some(trace) = &simulation.trace {
        let computed = trace.digest();
        let given = trace_digest.unwrap_or(computed);
        if given != computed {
            return Err(StoreError::WrongDigest { trial, number, given, computed });
        }
        trace_digest = Some(computed);
    }
    let inserted = row::insert(file.database.sql(), file.header(), simulation, trace_digest);
    inserted.map_err(|error| match constraint(&error) {
        Some(ffi::SQLITE_CONSTRAINT_FOREIGNKEY) => StoreError::UnknownTrial { trial },
        Some(_) => StoreError::AlreadyRecorded { what: format!("simulation {number} of trial {trial}") },
        None => StoreError::from_sqlite(&file.path, &error),
    })?;
    reason::insert(file, trial, number, &simulation.reason)?;
    if let Some(trace) = &simulation.trace {
        let blob = trace_blob::encode(trace);
        let sql = "INSERT INTO trace (trial, number, blob) VALUES (?1, ?2, ?3)";
        let inserted = file
            .database
            .with_traces(|connection| connection.prepare_cached(sql)?.execute(params![trial, number, blob]));
        inserted.in_file(&file.path)?;
    }
    Ok(())
}

/// Returns SQLite's extended error code if a constraint of the tables was violated.
fn constraint(error: &rusqlite::Error) -> Option<i32> {
    let failure = error.sqlite_error()?;
    (failure.code == rusqlite::ErrorCode::ConstraintViolation).then_some(failure.extended_code)
}

/// Removes a run, complete or not. The caller has locked it.
fn remove(path: &Path) -> Result<()> {
    if !is_unfinished(path) {
        let database = Database::connect(path, OpenFlags::SQLITE_OPEN_READ_WRITE)?;
        // Runs of newer and older formats can be removed, too.
        match version::check(database.sql(), path) {
            Ok(()) | Err(StoreError::NewerVersion { .. } | StoreError::OlderVersion { .. }) => {}
            Err(error) => return Err(error),
        }
        begin(database.sql()).in_file(path)?;
    }
    remove_files(path)
}

/// Returns whether the file is empty or a database without tables: the creation of a run was
/// interrupted.
fn is_unfinished(path: &Path) -> bool {
    let is_file = std::fs::symlink_metadata(path).is_ok_and(|found| found.is_file());
    let version =
        Database::connect_for_reading(path).and_then(|database| version::check(database.sql(), path));
    is_file && matches!(version, Err(StoreError::Unfinished { .. }))
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
        // Noise, which does not compress.
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
            reason: String::new(),
            trace_digest: None,
            trace: Some(StoredTrace { columns: vec![column] }),
        }
    }

    #[test]
    fn a_full_disk_during_creation_is_an_error_without_the_advice_to_resume() {
        let full = StoreError::from_io(Path::new("run"), "create", ErrorKind::StorageFull.into());
        assert_eq!(
            creation_error(full).to_string(),
            "the disk is full, so the run could not be created: run"
        );
    }

    #[test]
    fn a_full_disk_loses_no_recorded_simulation() {
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
            preflight: vec![],
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.sqlite");
        let mut writer = RunWriter::create(&path, &header, IfExists::Refuse).unwrap();
        writer.start_trial(1, 0).unwrap();
        writer.file.database.sql().pragma_update(None, "max_page_count", 100).unwrap();

        let mut recorded = 0;
        let error = loop {
            match writer.record(&[traced(recorded + 1), traced(recorded + 2), traced(recorded + 3)]) {
                Ok(()) => recorded += 3,
                Err(error) => break error,
            }
        };
        assert!(matches!(error, StoreError::DiskFull { .. }), "{error}");
        assert!(recorded > 30, "{recorded}");
        assert_eq!(writer.file().last_simulation_number(1).unwrap(), recorded);

        // With free space, the same writer continues.
        writer.file.database.sql().pragma_update(None, "max_page_count", 10_000).unwrap();
        writer.record(&[traced(recorded + 1)]).unwrap();
        writer.close().unwrap();
        let run = RunFile::open(&path).unwrap();
        run.check().unwrap();
        assert_eq!(run.simulation(1, recorded).unwrap().trace, traced(recorded).trace);
        assert_eq!(run.last_simulation_number(1).unwrap(), recorded + 1);
    }
}
