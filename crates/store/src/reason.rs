//! Why simulations ended as they did, in the words of the target: a table of its own, which a run
//! has from its first reason on.
//!
//! Reasons contain the standard error of programs. The digest of the content leaves them out,
//! because they can differ when all numbers agree.

use std::path::Path;

use rusqlite::{OptionalExtension, params};

use crate::digest::Digest;
use crate::error::{InFile, StoreError};
use crate::{MAX_TRIALS, Result, RunFile};

/// The statement that creates the table: see [`TABLES`](crate::schema).
pub(crate) const TABLE: &str = "CREATE TABLE reason (
    trial INTEGER NOT NULL,
    number INTEGER NOT NULL,
    text TEXT NOT NULL,
    row_hash INTEGER NOT NULL,
    PRIMARY KEY (trial, number),
    FOREIGN KEY (trial, number) REFERENCES simulation (trial, number)
) STRICT";

/// Largest length of a reason, bytes. Longer ones are cut.
pub(crate) const MAX_BYTES: usize = 4096;

/// The simulations of a run with one end and a reason.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EndReasons {
    /// Name of the end, such as `crashed`.
    pub end: String,
    /// Number of these simulations.
    pub simulations: u64,
    /// Trial of the first of them.
    pub trial: u32,
    /// Number of the first of them.
    pub number: u32,
    /// Reason of the first of them.
    pub reason: String,
}

/// Writes the reason of a simulation that has one.
pub(crate) fn insert(file: &RunFile, trial: u32, number: u32, reason: &str) -> Result<()> {
    if reason.is_empty() {
        return Ok(());
    }
    // SQLite ends a text at a NUL for its tools.
    let text = reason.replace('\0', "\u{fffd}");
    let text = &text[..text.floor_char_boundary(MAX_BYTES)];
    if !file.has_table("reason")? {
        file.database.sql().execute(TABLE, []).in_file(&file.path)?;
    }
    let sql = "INSERT INTO reason (trial, number, text, row_hash) VALUES (?1, ?2, ?3, ?4)";
    let mut insert = file.database.sql().prepare_cached(sql).in_file(&file.path)?;
    insert.execute(params![trial, number, text, hash(trial, number, text)]).in_file(&file.path)?;
    Ok(())
}

/// Reads the reason of a simulation; empty if it has none.
pub(crate) fn read(file: &RunFile, trial: u32, number: u32) -> Result<String> {
    if !file.has_table("reason")? {
        return Ok(String::new());
    }
    let sql = "SELECT text, row_hash FROM reason WHERE trial = ?1 AND number = ?2";
    let mut select = file.database.sql().prepare_cached(sql).in_file(&file.path)?;
    let row = select.query_row([trial, number], |row| Ok((row.get(0)?, row.get(1)?))).optional();
    match row.in_file(&file.path)? {
        Some((text, found)) => checked(&file.path, trial, number, text, found),
        None => Ok(String::new()),
    }
}

/// Checks the hashes of all reasons.
pub(crate) fn check(file: &RunFile) -> Result<()> {
    if !file.has_table("reason")? {
        return Ok(());
    }
    let sql = "SELECT trial, number, text, row_hash FROM reason";
    let mut select = file.database.sql().prepare_cached(sql).in_file(&file.path)?;
    let rows = select.query_map([], |row| Ok((row.get(0)?, row.get(1)?, row.get(2)?, row.get(3)?)));
    for row in rows.in_file(&file.path)? {
        let (trial, number, text, found) = row.in_file(&file.path)?;
        checked(&file.path, trial, number, text, found)?;
    }
    Ok(())
}

fn checked(path: &Path, trial: u32, number: u32, text: String, found: i64) -> Result<String> {
    if text.len() > MAX_BYTES || hash(trial, number, &text) != found {
        let what = format!("the reason of simulation {number} of trial {trial} does not match its hash");
        return Err(StoreError::damaged(path, what));
    }
    Ok(text)
}

fn hash(trial: u32, number: u32, text: &str) -> i64 {
    let mut digest = Digest::of("reason");
    digest.integer(u64::from(trial));
    digest.integer(u64::from(number));
    digest.text(text);
    digest.finish_row()
}

impl RunFile {
    /// Returns the simulations of the question with a reason, by their end, the most frequent end
    /// first.
    ///
    /// # Errors
    /// [`Damaged`](StoreError::Damaged), or another error of the file.
    pub fn reasons(&self) -> Result<Vec<EndReasons>> {
        if !self.has_table("reason")? {
            return Ok(Vec::new());
        }
        let sql = format!(
            "SELECT ended, count(*), min(trial * 4294967296 + number) FROM reason JOIN simulation USING (trial, number)
             WHERE trial <= {MAX_TRIALS} GROUP BY ended ORDER BY count(*) DESC, ended"
        );
        let mut select = self.database.sql().prepare_cached(&sql).in_file(&self.path)?;
        let rows = select.query_map([], |row| Ok((row.get(0)?, row.get(1)?, row.get(2)?)));
        let mut found = Vec::new();
        for row in rows.in_file(&self.path)? {
            let (end, simulations, first): (String, i64, i64) = row.in_file(&self.path)?;
            let trial = (first >> 32) as u32;
            let number = first as u32;
            let reason = read(self, trial, number)?;
            let simulations = simulations.cast_unsigned();
            found.push(EndReasons { end, simulations, trial, number, reason });
        }
        Ok(found)
    }
}
