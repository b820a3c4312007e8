//! Reading of run files.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use rusqlite::{OptionalExtension, Row, params};

use crate::database::Database;
use crate::digest::Digest;
use crate::error::{InFile, StoreError};
use crate::{
    Counts, Result, RunHeader, ScreenedChunk, Simulation, SimulationEnd, StoredTrace, TrialRecord,
    TrialSummary, finding, memory, reason, row, schema, screened, trace_blob, version,
};

/// Largest number of simulations that [`Simulations`] reads at once.
const PAGE: usize = 256;

/// Largest number of trials, and of a trial of a question.
///
/// A trial with a larger number holds simulations that start from those of trial `number -
/// MAX_TRIALS`: they move its counterexample toward nominal. No rate, count or statement about the
/// space may use them, so only [`RunFile::derived_simulations`] returns them.
pub const MAX_TRIALS: u32 = 1_000_000;

/// Number of the trial of the random simulations of an evaluation.
pub const RANDOM_TRIAL: u32 = 1;

/// Largest number of axes and verdicts in all simulations that are read at once.
const PAGE_VALUES: usize = 1 << 18;

/// A run opened for reading.
///
/// Any number of processes can read a run, also while it is being written. Each call returns the
/// records committed before it.
#[derive(Debug)]
pub struct RunFile {
    pub(crate) path: PathBuf,
    pub(crate) database: Database,
    header: RunHeader,
}

impl RunFile {
    /// Opens a run for reading, and checks the structure of the file and the hashes of all trials
    /// and simulations.
    ///
    /// The check reads the whole file except for the traces: about 1 s for 100,000 simulations of
    /// two axes.
    ///
    /// # Errors
    /// - [`Missing`](StoreError::Missing), [`NotARun`](StoreError::NotARun),
    ///   [`NewerVersion`](StoreError::NewerVersion), [`OlderVersion`](StoreError::OlderVersion) or
    ///   [`Damaged`](StoreError::Damaged);
    /// - [`NotClosed`](StoreError::NotClosed) if the run was not closed and the folder is
    ///   read-only.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        let run = Self::open_unchecked(path)?;
        run.check_opened()?;
        Ok(run)
    }

    /// Opens a run as [`open`](Self::open) does, without the check. Each record is still checked
    /// when it is read.
    ///
    /// # Errors
    /// The errors of [`open`](Self::open).
    pub fn open_unchecked(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let database = Database::connect_for_reading(path)?;
        version::check(database.sql(), path).map_err(not_closed)?;
        Self::of(database, path)
    }

    /// Returns the run of a connection. The caller has checked the format version.
    pub(crate) fn of(database: Database, path: &Path) -> Result<Self> {
        let header = schema::read_header(database.sql(), path)?;
        Ok(Self { path: path.into(), database, header })
    }

    /// Returns the path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the header: plan, target, scenario space and build.
    pub fn header(&self) -> &RunHeader {
        &self.header
    }

    /// Replaces the header by the one that was written to the file.
    pub(crate) fn set_header(&mut self, header: RunHeader) {
        self.header = header;
    }

    /// Returns the trials of the question by number, with statistics of their simulations. Reads
    /// every simulation.
    ///
    /// # Errors
    /// [`Damaged`](StoreError::Damaged), or another error of the file.
    pub fn trials(&self) -> Result<Vec<TrialSummary>> {
        self.trials_between(0, MAX_TRIALS)
    }

    /// Returns the trials whose simulations start from those of other trials: see [`MAX_TRIALS`].
    ///
    /// # Errors
    /// [`Damaged`](StoreError::Damaged), or another error of the file.
    pub fn derived_trials(&self) -> Result<Vec<TrialSummary>> {
        self.trials_between(MAX_TRIALS + 1, u32::MAX)
    }

    fn trials_between(&self, first: u32, last: u32) -> Result<Vec<TrialSummary>> {
        let sql = format!(
            "SELECT trial.number, trial.seed, trial.status, trial.row_hash, min(robustness), {}
             FROM trial LEFT JOIN simulation ON simulation.trial = trial.number
             WHERE trial.number BETWEEN ?1 AND ?2
             GROUP BY trial.number ORDER BY trial.number",
            row::COUNTS
        );
        let mut select = self.database.sql().prepare_cached(&sql).in_file(&self.path)?;
        let mut rows = select.query([first, last]).in_file(&self.path)?;
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

    /// Returns the trial with this number.
    ///
    /// # Errors
    /// [`UnknownTrial`](StoreError::UnknownTrial), or another error of the file.
    pub fn trial(&self, trial: u32) -> Result<TrialRecord> {
        let sql = "SELECT number, seed, status, row_hash FROM trial WHERE number = ?1";
        let mut select = self.database.sql().prepare_cached(sql).in_file(&self.path)?;
        let mut rows = select.query([trial]).in_file(&self.path)?;
        match rows.next().in_file(&self.path)? {
            Some(row) => row::read_trial(row, &self.path),
            None => Err(StoreError::UnknownTrial { trial }),
        }
    }

    /// Returns the numbers of the question's simulations by result. Reads every simulation.
    ///
    /// # Errors
    /// An error of the file.
    pub fn counts(&self) -> Result<Counts> {
        let sql = format!("SELECT {} FROM simulation WHERE trial <= ?1", row::COUNTS);
        self.database.sql().query_row(&sql, [MAX_TRIALS], |row| counts(row, 0)).in_file(&self.path)
    }

    /// Returns the ends of the simulations of some trials, each with the numbers of simulations
    /// with and without a robustness. The step of an end is the first one of these simulations.
    ///
    /// # Errors
    /// [`Damaged`](StoreError::Damaged), or another error of the file.
    pub fn ends(&self, trials: RangeInclusive<u32>) -> Result<Vec<(SimulationEnd, [u64; 2])>> {
        let sql =
            "SELECT ended, min(end_step), min(end_index), count(robustness), count(*) - count(robustness)
             FROM simulation WHERE trial BETWEEN ?1 AND ?2 GROUP BY ended ORDER BY ended";
        let mut select = self.database.sql().prepare_cached(sql).in_file(&self.path)?;
        let mut rows = select.query([trials.start(), trials.end()]).in_file(&self.path)?;
        let mut ends = Vec::new();
        while let Some(row) = rows.next().in_file(&self.path)? {
            let count = |column: usize| row.get::<_, i64>(column).map(i64::cast_unsigned);
            let name: String = row.get(0).in_file(&self.path)?;
            let place = (row.get(1).in_file(&self.path)?, row.get(2).in_file(&self.path)?);
            let end = row::end_from_columns(&name, place.0, place.1);
            let end = end.ok_or_else(|| StoreError::damaged(&self.path, format!("unknown end {name:?}")))?;
            ends.push((end, [count(3).in_file(&self.path)?, count(4).in_file(&self.path)?]));
        }
        Ok(ends)
    }

    /// Returns the number of the last simulation of a trial, or 0 if it has none. A resumed trial
    /// continues with the next number.
    ///
    /// # Errors
    /// An error of the file.
    pub fn last_simulation_number(&self, trial: u32) -> Result<u32> {
        let sql = "SELECT ifnull(max(number), 0) FROM simulation WHERE trial = ?1";
        self.database.sql().query_row(sql, [trial], |row| row.get(0)).in_file(&self.path)
    }

    /// Iterates over the simulations of the question without their traces, ordered by trial and
    /// number. Memory use does not depend on their number.
    pub fn simulations(&self) -> Simulations<'_> {
        Simulations::between(self, 0, MAX_TRIALS)
    }

    /// Iterates over the simulations that start from those of `trial`, ordered by number: see
    /// [`MAX_TRIALS`].
    pub fn derived_simulations(&self, trial: u32) -> Simulations<'_> {
        self.trial_simulations(trial.saturating_add(MAX_TRIALS))
    }

    /// Iterates over the simulations of one trial without their traces, ordered by number.
    pub fn trial_simulations(&self, trial: u32) -> Simulations<'_> {
        Simulations::between(self, trial, trial)
    }

    /// Returns one simulation, with its reason, and with its trace if the trace is stored.
    ///
    /// # Errors
    /// [`UnknownSimulation`](StoreError::UnknownSimulation), [`Damaged`](StoreError::Damaged), or
    /// another error of the file.
    pub fn simulation(&self, trial: u32, number: u32) -> Result<Simulation> {
        let simulation =
            self.recorded(trial, number)?.ok_or(StoreError::UnknownSimulation { trial, number })?;
        let reason = reason::read(self, trial, number)?;
        Ok(Simulation { trace: self.trace_of(&simulation)?, reason, ..simulation })
    }

    /// Returns one simulation without its trace; `None` if the run does not have it.
    ///
    /// # Errors
    /// [`Damaged`](StoreError::Damaged), or another error of the file.
    pub fn recorded(&self, trial: u32, number: u32) -> Result<Option<Simulation>> {
        let sql = format!("SELECT {} FROM simulation WHERE trial = ?1 AND number = ?2", row::COLUMNS);
        let mut select = self.database.sql().prepare_cached(&sql).in_file(&self.path)?;
        let mut rows = select.query([trial, number]).in_file(&self.path)?;
        let found = rows.next().in_file(&self.path)?;
        let simulation = found.map(|row| row::read(row, &self.path, &self.header)).transpose()?;
        if simulation.as_ref().is_some_and(|found| (found.trial, found.number) != (trial, number)) {
            let what = format!("the index of simulations is wrong at simulation {number} of trial {trial}");
            return Err(StoreError::damaged(&self.path, what));
        }
        Ok(simulation)
    }

    /// Returns the outcomes of another physics engine with this number, from 1, and this number of
    /// values for each request; `None` if the run does not have them.
    ///
    /// # Errors
    /// [`Damaged`](StoreError::Damaged), or another error of the file.
    pub fn screened_chunk(&self, number: u32, columns: usize) -> Result<Option<ScreenedChunk>> {
        screened::read(self, number, columns)
    }

    /// Returns trial and number of the simulations whose traces are stored, in order.
    ///
    /// # Errors
    /// An error of the file.
    pub fn stored_traces(&self) -> Result<Vec<(u32, u32)>> {
        let sql = "SELECT trial, number FROM trace ORDER BY trial, number";
        let mut select = self.database.sql().prepare_cached(sql).in_file(&self.path)?;
        let rows = select.query_map([], |row| Ok((row.get(0)?, row.get(1)?))).in_file(&self.path)?;
        rows.collect::<rusqlite::Result<_>>().in_file(&self.path)
    }

    /// Returns a digest of all trials, simulations and trace digests, and of the set of stored
    /// traces.
    ///
    /// Two runs with the same records have the same digest, whatever their batch sizes. The digest
    /// does not depend on the header, so that runs of two builds can be compared. For a run that is
    /// being written, call it on the writer's [`file`](crate::RunWriter::file): in another process,
    /// simulations can be added while the digest is computed.
    ///
    /// # Errors
    /// [`Damaged`](StoreError::Damaged), or another error of the file.
    pub fn content_digest(&self) -> Result<u128> {
        let mut digest = Digest::of("content");
        for summary in self.trials_between(0, u32::MAX)? {
            row::feed_trial(&mut digest, &summary.trial);
        }
        for simulation in Simulations::between(self, 0, u32::MAX) {
            let simulation = simulation?;
            row::feed(&mut digest, &simulation, simulation.trace_digest);
        }
        for (trial, number) in self.stored_traces()? {
            digest.integer(u64::from(trial));
            digest.integer(u64::from(number));
        }
        screened::feed(self, &mut digest)?;
        Ok(digest.finish())
    }

    /// Checks the structure of the file, its indexes, and the hashes of all trials, simulations and
    /// traces.
    ///
    /// # Errors
    /// [`Damaged`](StoreError::Damaged) for the first damage found.
    pub fn check(&self) -> Result<()> {
        self.check_structure("PRAGMA integrity_check(1)")?;
        self.check_rows()?;
        self.stored_traces()?
            .into_iter()
            .try_for_each(|(trial, number)| self.simulation(trial, number).map(drop))
    }

    /// Does the check of [`open`](Self::open).
    pub(crate) fn check_opened(&self) -> Result<()> {
        self.check_structure("PRAGMA quick_check(1)")?;
        self.check_numbers()?;
        self.check_references()?;
        self.check_rows()
    }

    /// Checks that all rows have numbers that can be read, and that [`trials`](Self::trials) is of
    /// bounded length. Rows with other numbers would be skipped.
    fn check_numbers(&self) -> Result<()> {
        let sql = "SELECT max(count(*) FILTER (WHERE number <= ?1), count(*) FILTER (WHERE number > ?1)) FROM trial";
        let count = self.database.sql().query_row(sql, [MAX_TRIALS], |row| row.get::<_, i64>(0));
        if count.in_file(&self.path)? > i64::from(MAX_TRIALS) {
            return Err(StoreError::damaged(&self.path, format!("it has more than {MAX_TRIALS} trials")));
        }
        let sql = "SELECT EXISTS (SELECT 1 FROM simulation
                WHERE trial NOT BETWEEN 0 AND ?1 OR number NOT BETWEEN 1 AND ?1)
            OR EXISTS (SELECT 1 FROM trial WHERE number NOT BETWEEN 0 AND ?1)";
        if self.database.sql().query_row(sql, [u32::MAX], |row| row.get(0)).in_file(&self.path)? {
            Err(StoreError::damaged(&self.path, "a simulation or a trial has an impossible number"))
        } else {
            Ok(())
        }
    }

    /// Returns whether the run has a table that not every run has.
    pub(crate) fn has_table(&self, name: &str) -> Result<bool> {
        let sql = "SELECT count(*) FROM sqlite_schema WHERE type = 'table' AND name = ?1";
        let count: i64 = self.database.sql().query_row(sql, [name], |row| row.get(0)).in_file(&self.path)?;
        Ok(count > 0)
    }

    /// Checks that all rows that other rows refer to exist.
    pub(crate) fn check_references(&self) -> Result<()> {
        let sql = "SELECT \"table\", \"parent\" FROM pragma_foreign_key_check";
        let missing: Option<(String, String)> = self
            .database
            .sql()
            .query_row(sql, [], |row| Ok((row.get(0)?, row.get(1)?)))
            .optional()
            .in_file(&self.path)?;
        match missing {
            Some((table, parent)) => Err(StoreError::damaged(
                &self.path,
                format!("a row of table `{table}` refers to a missing row of table `{parent}`"),
            )),
            None => Ok(()),
        }
    }

    fn check_structure(&self, pragma: &str) -> Result<()> {
        let verdict = self.database.sql().query_row(pragma, [], |row| row.get::<_, String>(0));
        match verdict.in_file(&self.path)?.as_str() {
            "ok" => Ok(()),
            damage => Err(integrity_error(&self.path, damage)),
        }
    }

    /// Checks the hashes of all trials, simulations and screened chunks.
    pub(crate) fn check_rows(&self) -> Result<()> {
        self.trials_between(0, u32::MAX)?;
        screened::feed(self, &mut Digest::of("check"))?;
        reason::check(self)?;
        memory::check(self)?;
        finding::check(self)?;
        Simulations::between(self, 0, u32::MAX).try_for_each(|simulation| simulation.map(drop))
    }

    fn trace_of(&self, simulation: &Simulation) -> Result<Option<StoredTrace>> {
        let trial = simulation.trial;
        let number = simulation.number;
        let sql = "SELECT blob FROM trace WHERE trial = ?1 AND number = ?2";
        let blob: Option<Vec<u8>> = self
            .database
            .with_traces(|connection| {
                let mut select = connection.prepare_cached(sql)?;
                select.query_row(params![trial, number], |row| row.get(0)).optional()
            })
            .in_file(&self.path)?;
        let damaged =
            |what| StoreError::damaged(&self.path, format!("trace {number} of trial {trial}: {what}"));
        let Some(blob) = blob else { return Ok(None) };
        let trace = trace_blob::decode(&blob, self.header.signals.len()).map_err(&damaged)?;
        if Some(trace.digest()) != simulation.trace_digest {
            return Err(damaged("it does not match its digest".into()));
        }
        Ok(Some(trace))
    }
}

fn counts(row: &Row<'_>, first: usize) -> rusqlite::Result<Counts> {
    let count = |column: usize| row.get::<_, i64>(first + column).map(i64::cast_unsigned);
    Ok(Counts {
        simulations: count(0)?,
        falsified: count(1)?,
        undecided: count(2)?,
        diverged: count(3)?,
        invalid: count(4)?,
    })
}

/// Iterator over simulations; see [`RunFile::simulations`]. It ends after the first error.
#[derive(Debug)]
pub struct Simulations<'a> {
    file: &'a RunFile,
    /// Trial and number of the last simulation that was read.
    after: (u32, u32),
    last_trial: u32,
    page_size: usize,
    page: std::vec::IntoIter<Simulation>,
    ended: bool,
}

impl<'a> Simulations<'a> {
    fn between(file: &'a RunFile, first_trial: u32, last_trial: u32) -> Self {
        let values = file.header.axes.len() + file.header.verdicts.len();
        let page_size = (PAGE_VALUES / values.max(1)).clamp(1, PAGE);
        Self {
            file,
            after: (first_trial, 0),
            last_trial,
            page_size,
            page: Vec::new().into_iter(),
            ended: false,
        }
    }

    fn fetch(&mut self) -> Result<()> {
        let path = &self.file.path;
        let sql = format!(
            "SELECT {} FROM simulation WHERE (trial, number) > (?1, ?2) AND trial <= ?3
             ORDER BY trial, number LIMIT {}",
            row::COLUMNS,
            self.page_size
        );
        let mut select = self.file.database.sql().prepare_cached(&sql).in_file(path)?;
        let mut rows = select.query(params![self.after.0, self.after.1, self.last_trial]).in_file(path)?;
        let mut page = Vec::with_capacity(self.page_size);
        while let Some(row) = rows.next().in_file(path)? {
            let simulation = row::read(row, path, &self.file.header)?;
            let trial = simulation.trial;
            let number = simulation.number;
            // A damaged index could cause an endless loop.
            if (trial, number) <= self.after {
                let what =
                    format!("the index of simulations is wrong at simulation {number} of trial {trial}");
                return Err(StoreError::damaged(path, what));
            }
            self.after = (trial, number);
            page.push(simulation);
        }
        self.ended = page.len() < self.page_size;
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

/// Converts the error of the first read: the file is open, but SQLite could not create the index of
/// the log beside it, or roll back the journal.
pub(crate) fn not_closed(error: StoreError) -> StoreError {
    match error {
        StoreError::ReadOnly { path } | StoreError::CannotOpen { path } => StoreError::NotClosed { path },
        error => error,
    }
}

/// Returns the error of an integrity check. SQLite also lists pages that it could not read, which
/// may not be damaged.
fn integrity_error(path: &Path, verdict: &str) -> StoreError {
    let out_of_memory = format!("error code={}", rusqlite::ffi::SQLITE_NOMEM);
    if verdict.lines().any(|line| line.ends_with(&out_of_memory)) {
        return StoreError::Sqlite { message: "out of memory".into(), path: path.into() };
    }
    if verdict.contains("unable to get the page") || verdict.contains("failed to get page") {
        let what = format!("cannot check {}", path.display());
        return StoreError::Io { what, source: std::io::Error::other(verdict.to_string()) };
    }
    StoreError::damaged(path, verdict)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_check_without_enough_memory_is_not_reported_as_damage_or_a_disk_error() {
        let error = |verdict: &str| integrity_error(Path::new("run"), verdict).to_string();
        let text = "*** in database main ***\nTree 5 page 5: unable to get the page. error code=";
        assert_eq!(error(&format!("{text}7")), "SQLite failed: out of memory: run");
        assert!(error(&format!("{text}266")).starts_with("cannot check run"), "an I/O error");
        assert!(error("row 1 missing from index").starts_with("the run file is damaged"));
    }
}
