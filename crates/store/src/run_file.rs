//! Reads a run file.

use std::path::{Path, PathBuf};
use std::time::Duration;

use rusqlite::{Connection, OpenFlags, OptionalExtension, Row, params};

use crate::digest::Digest;
use crate::error::{InFile, StoreError};
use crate::run_writer::RunWriter;
use crate::upgrade::{STEPS, Step};
use crate::{
    Counts, Result, RunHeader, Simulation, StoredTrace, TrialRecord, TrialSummary, row, schema, trace_blob,
    upgrade,
};

/// How long to wait for the short moments in which another process needs the file for itself.
const PATIENCE: Duration = Duration::from_secs(1);

/// Simulations fetched at once by [`Simulations`].
const PAGE: u32 = 256;

/// A run that can be read, by any number of processes, also while one writes it.
///
/// Each call sees what was recorded by then.
#[derive(Debug)]
pub struct RunFile {
    pub(crate) path: PathBuf,
    pub(crate) connection: Connection,
    header: RunHeader,
}

impl RunFile {
    /// Opens a run for reading. A file of an older format is upgraded first, in place.
    ///
    /// # Errors
    /// [`Missing`](StoreError::Missing), [`NotARun`](StoreError::NotARun),
    /// [`NewerVersion`](StoreError::NewerVersion) and [`Damaged`](StoreError::Damaged) as their names say;
    /// [`NotClosed`](StoreError::NotClosed) for a run that was killed and now lies in a read-only folder;
    /// [`CannotUpgrade`](StoreError::CannotUpgrade) for a file of an older format in a read-only folder, and all
    /// of [`RunWriter::resume`] for one elsewhere.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        Self::open_with(path.as_ref(), STEPS)
    }

    /// `open` for a program that knows these steps.
    pub(crate) fn open_with(path: &Path, steps: &[Step]) -> Result<Self> {
        let connection = connect(path, OpenFlags::SQLITE_OPEN_READ_ONLY)?;
        let version = upgrade::version(&connection, path, steps).map_err(|error| match error {
            // The file itself has been opened; what SQLite cannot make is the index of the log beside it.
            StoreError::ReadOnly { path } | StoreError::CannotOpen { path } => StoreError::NotClosed { path },
            error => error,
        })?;
        if version > steps.len() as i64 {
            return Self::of(connection, path);
        }
        drop(connection);
        let writer = RunWriter::resume_with(path, steps).map_err(|error| match error {
            StoreError::ReadOnly { path } | StoreError::CannotOpen { path } => {
                StoreError::CannotUpgrade { found: version, current: steps.len() as i64 + 1, path }
            }
            error => error,
        })?;
        writer.close()?;
        Self::of(connect(path, OpenFlags::SQLITE_OPEN_READ_ONLY)?, path)
    }

    /// The run behind a connection, whose version has been found right.
    pub(crate) fn of(connection: Connection, path: &Path) -> Result<Self> {
        let header = schema::read_header(&connection, path)?;
        Ok(Self { path: path.into(), connection, header })
    }

    /// Where the file is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What was run, by which build, from which plan.
    pub fn header(&self) -> &RunHeader {
        &self.header
    }

    /// The trials, by number, with what their simulations amount to. Reads every simulation.
    ///
    /// # Errors
    /// [`Damaged`](StoreError::Damaged), or another failure of the file.
    pub fn trials(&self) -> Result<Vec<TrialSummary>> {
        let sql = format!(
            "SELECT trial.number, trial.seed, trial.status, trial.row_hash, min(robustness), {}
             FROM trial LEFT JOIN simulation ON simulation.trial = trial.number
             GROUP BY trial.number ORDER BY trial.number",
            row::COUNTS
        );
        let mut select = self.connection.prepare_cached(&sql).in_file(&self.path)?;
        let mut rows = select.query([]).in_file(&self.path)?;
        let mut trials = Vec::new();
        while let Some(row) = rows.next().in_file(&self.path)? {
            let trial = row::read_trial(row, &self.path)?;
            let minimum_robustness = row.get(4).in_file(&self.path)?;
            trials.push(TrialSummary {
                trial,
                counts: counts(row, 5).in_file(&self.path)?,
                minimum_robustness,
            });
        }
        Ok(trials)
    }

    /// One trial.
    ///
    /// # Errors
    /// [`UnknownTrial`](StoreError::UnknownTrial), or a failure of the file.
    pub fn trial(&self, trial: u32) -> Result<TrialRecord> {
        let sql = "SELECT number, seed, status, row_hash FROM trial WHERE number = ?1";
        let mut select = self.connection.prepare_cached(sql).in_file(&self.path)?;
        let mut rows = select.query([trial]).in_file(&self.path)?;
        match rows.next().in_file(&self.path)? {
            Some(row) => row::read_trial(row, &self.path),
            None => Err(StoreError::UnknownTrial { trial }),
        }
    }

    /// How many simulations the run holds. Reads every one.
    ///
    /// # Errors
    /// A failure of the file.
    pub fn counts(&self) -> Result<Counts> {
        let sql = format!("SELECT {} FROM simulation", row::COUNTS);
        self.connection.query_row(&sql, [], |row| counts(row, 0)).in_file(&self.path)
    }

    /// The number of the last simulation of a trial; 0 if it has none. A resumed trial goes on with the next.
    ///
    /// # Errors
    /// A failure of the file.
    pub fn last_number(&self, trial: u32) -> Result<u32> {
        let sql = "SELECT ifnull(max(number), 0) FROM simulation WHERE trial = ?1";
        self.connection.query_row(sql, [trial], |row| row.get(0)).in_file(&self.path)
    }

    /// All simulations without their traces, ordered by trial and number, a few at a time: memory does not grow
    /// with their number.
    pub fn simulations(&self) -> Simulations<'_> {
        Simulations::between(self, 0, u32::MAX)
    }

    /// The simulations of one trial without their traces, ordered by number, a few at a time.
    pub fn simulations_of(&self, trial: u32) -> Simulations<'_> {
        Simulations::between(self, trial, trial)
    }

    /// One simulation, with its trace if that is stored.
    ///
    /// # Errors
    /// [`UnknownSimulation`](StoreError::UnknownSimulation), [`Damaged`](StoreError::Damaged), or another
    /// failure of the file.
    pub fn simulation(&self, trial: u32, number: u32) -> Result<Simulation> {
        let sql = format!("SELECT {} FROM simulation WHERE trial = ?1 AND number = ?2", row::COLUMNS);
        let mut select = self.connection.prepare_cached(&sql).in_file(&self.path)?;
        let mut rows = select.query([trial, number]).in_file(&self.path)?;
        let simulation = match rows.next().in_file(&self.path)? {
            Some(row) => row::read(row, &self.path, &self.header)?,
            None => return Err(StoreError::UnknownSimulation { trial, number }),
        };
        if (simulation.trial, simulation.number) != (trial, number) {
            let what = format!("the index of simulations is wrong at simulation {number} of trial {trial}");
            return Err(StoreError::damaged(&self.path, what));
        }
        Ok(Simulation { trace: self.trace_of(&simulation)?, ..simulation })
    }

    /// The trials and numbers of the simulations whose traces are stored, in order.
    ///
    /// # Errors
    /// A failure of the file.
    pub fn traced(&self) -> Result<Vec<(u32, u32)>> {
        let sql = "SELECT trial, number FROM trace ORDER BY trial, number";
        let mut select = self.connection.prepare_cached(sql).in_file(&self.path)?;
        let rows = select.query_map([], |row| Ok((row.get(0)?, row.get(1)?))).in_file(&self.path)?;
        rows.collect::<rusqlite::Result<_>>().in_file(&self.path)
    }

    /// A digest of all trials and simulations in order, and of which traces are stored: equal for two runs in
    /// which the same was recorded, in whatever batches. The header is left out, so that two builds can be
    /// compared; traces count by their digests. For a run that is being written, ask its writer's
    /// [`file`](RunWriter::file): another process may see simulations come in between.
    ///
    /// # Errors
    /// [`Damaged`](StoreError::Damaged), or another failure of the file.
    pub fn content_digest(&self) -> Result<u128> {
        let mut digest = Digest::of("content");
        for summary in self.trials()? {
            row::feed_trial(&mut digest, &summary.trial);
        }
        for simulation in self.simulations() {
            let simulation = simulation?;
            row::feed(&mut digest, &simulation, simulation.trace_digest);
        }
        for (trial, number) in self.traced()? {
            digest.integer(u64::from(trial));
            digest.integer(u64::from(number));
        }
        Ok(digest.finish())
    }

    /// Reads everything, and lets SQLite check the file's structure.
    ///
    /// # Errors
    /// [`Damaged`](StoreError::Damaged) at the first thing that is not as it was written.
    pub fn check(&self) -> Result<()> {
        let verdict: String = self
            .connection
            .query_row("PRAGMA integrity_check(1)", [], |row| row.get(0))
            .in_file(&self.path)?;
        if verdict != "ok" {
            return Err(StoreError::damaged(&self.path, verdict));
        }
        self.trials()?;
        self.simulations().try_for_each(|simulation| simulation.map(drop))?;
        self.traced()?.into_iter().try_for_each(|(trial, number)| self.simulation(trial, number).map(drop))
    }

    fn trace_of(&self, simulation: &Simulation) -> Result<Option<StoredTrace>> {
        let (trial, number) = (simulation.trial, simulation.number);
        let sql = "SELECT blob FROM trace WHERE trial = ?1 AND number = ?2";
        let mut select = self.connection.prepare_cached(sql).in_file(&self.path)?;
        let blob: Option<Vec<u8>> =
            select.query_row(params![trial, number], |row| row.get(0)).optional().in_file(&self.path)?;
        let damaged =
            |what| StoreError::damaged(&self.path, format!("trace {number} of trial {trial}: {what}"));
        let Some(blob) = blob else { return Ok(None) };
        let trace = trace_blob::decode(&blob).map_err(&damaged)?;
        if Some(trace.digest()) != simulation.trace_digest {
            return Err(damaged("it does not match its digest".into()));
        }
        Ok(Some(trace))
    }
}

fn counts(row: &Row<'_>, first: usize) -> rusqlite::Result<Counts> {
    let count = |column: usize| row.get::<_, i64>(first + column).map(i64::cast_unsigned);
    Ok(Counts { simulations: count(0)?, falsified: count(1)?, undecided: count(2)?, diverged: count(3)? })
}

/// The simulations of a run, in order; see [`RunFile::simulations`]. Ends after the first error.
#[derive(Debug)]
pub struct Simulations<'a> {
    file: &'a RunFile,
    /// Trial and number of the last simulation fetched.
    after: (u32, u32),
    last_trial: u32,
    page: std::vec::IntoIter<Simulation>,
    ended: bool,
}

impl<'a> Simulations<'a> {
    fn between(file: &'a RunFile, first_trial: u32, last_trial: u32) -> Self {
        Self { file, after: (first_trial, 0), last_trial, page: Vec::new().into_iter(), ended: false }
    }

    fn fetch(&mut self) -> Result<()> {
        let path = &self.file.path;
        let sql = format!(
            "SELECT {} FROM simulation WHERE (trial, number) > (?1, ?2) AND trial <= ?3
             ORDER BY trial, number LIMIT {PAGE}",
            row::COLUMNS
        );
        let mut select = self.file.connection.prepare_cached(&sql).in_file(path)?;
        let mut rows = select.query(params![self.after.0, self.after.1, self.last_trial]).in_file(path)?;
        let mut page = Vec::with_capacity(PAGE as usize);
        while let Some(row) = rows.next().in_file(path)? {
            let simulation = row::read(row, path, &self.file.header)?;
            let (trial, number) = (simulation.trial, simulation.number);
            // A damaged index could lead round in circles.
            if (trial, number) <= self.after {
                let what =
                    format!("the index of simulations is wrong at simulation {number} of trial {trial}");
                return Err(StoreError::damaged(path, what));
            }
            self.after = (trial, number);
            page.push(simulation);
        }
        self.ended = page.len() < PAGE as usize;
        self.page = page.into_iter();
        Ok(())
    }
}

impl Iterator for Simulations<'_> {
    type Item = Result<Simulation>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.page.len() == 0
            && !self.ended
            && let Err(error) = self.fetch()
        {
            self.ended = true;
            return Some(Err(error));
        }
        self.page.next().map(Ok)
    }
}

/// Opens what is there, without looking into it yet.
pub(crate) fn connect(path: &Path, access: OpenFlags) -> Result<Connection> {
    let found = std::fs::metadata(path).map_err(|source| match source.kind() {
        std::io::ErrorKind::NotFound => StoreError::Missing { what: "the file", path: path.into() },
        _ => StoreError::Io { what: format!("cannot open the run {}", path.display()), source },
    })?;
    if !found.is_file() {
        return Err(StoreError::NotARun { found: "a folder or a device".into(), path: path.into() });
    }
    if found.len() == 0 {
        return Err(StoreError::NotARun { found: "an empty file".into(), path: path.into() });
    }
    open(path, access)
}

/// Opens a file that is there, an empty one too.
pub(crate) fn open(path: &Path, access: OpenFlags) -> Result<Connection> {
    let connection =
        Connection::open_with_flags(path, access | OpenFlags::SQLITE_OPEN_NO_MUTEX).in_file(path)?;
    connection.busy_timeout(PATIENCE).in_file(path)?;
    // A damaged or foreign file must not lead SQLite astray.
    connection.pragma_update(None, "cell_size_check", true).in_file(path)?;
    connection.pragma_update(None, "trusted_schema", false).in_file(path)?;
    Ok(connection)
}
