//! Findings: answers of simulations that follow a search, about a recorded one. A run has their
//! table from the first of them on.
//!
//! These simulations, such as the ones under another solver of the physics, are in no other table,
//! and whoever reads the run needs their answers. The digest of the content leaves them out,
//! because they say nothing of the simulations of the run itself.

use rusqlite::{OptionalExtension, params};

use crate::digest::Digest;
use crate::error::{InFile, StoreError};
use crate::{Result, RunFile};

/// The statement that creates the table: see [`TABLES`](crate::schema).
pub(crate) const TABLE: &str = "CREATE TABLE finding (
    trial INTEGER NOT NULL,
    number INTEGER NOT NULL,
    kind TEXT NOT NULL,
    value TEXT NOT NULL,
    row_hash INTEGER NOT NULL,
    PRIMARY KEY (trial, number, kind),
    FOREIGN KEY (trial, number) REFERENCES simulation (trial, number)
) STRICT";

/// An answer of further simulations about a simulation of a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// Number of its trial.
    pub trial: u32,
    /// Its number in the trial.
    pub number: u32,
    /// The question. A simulation has one finding of each kind.
    pub kind: String,
    /// The answer as JSON.
    pub value: String,
}

/// Writes findings; each replaces an earlier one of its kind.
pub(crate) fn insert(file: &RunFile, findings: &[Finding]) -> Result<()> {
    if !file.has_table("finding")? {
        file.database.sql().execute(TABLE, []).in_file(&file.path)?;
    }
    let sql =
        "INSERT OR REPLACE INTO finding (trial, number, kind, value, row_hash) VALUES (?1, ?2, ?3, ?4, ?5)";
    let mut insert = file.database.sql().prepare_cached(sql).in_file(&file.path)?;
    for finding in findings {
        let Finding { trial, number, kind, value } = finding;
        insert.execute(params![trial, number, kind, value, hash(finding)]).in_file(&file.path)?;
    }
    Ok(())
}

/// Checks the hashes of all findings.
pub(crate) fn check(file: &RunFile) -> Result<()> {
    if !file.has_table("finding")? {
        return Ok(());
    }
    let sql = "SELECT trial, number, kind, value, row_hash FROM finding";
    let mut select = file.database.sql().prepare_cached(sql).in_file(&file.path)?;
    let mut rows = select.query([]).in_file(&file.path)?;
    while let Some(row) = rows.next().in_file(&file.path)? {
        let read = || -> rusqlite::Result<(Finding, i64)> {
            let finding =
                Finding { trial: row.get(0)?, number: row.get(1)?, kind: row.get(2)?, value: row.get(3)? };
            Ok((finding, row.get(4)?))
        };
        let (finding, found) = read().in_file(&file.path)?;
        checked(file, finding, found)?;
    }
    Ok(())
}

fn checked(file: &RunFile, finding: Finding, found: i64) -> Result<String> {
    if hash(&finding) != found {
        let Finding { trial, number, .. } = finding;
        let what = format!("a finding of simulation {number} of trial {trial} does not match its hash");
        return Err(StoreError::damaged(&file.path, what));
    }
    Ok(finding.value)
}

fn hash(finding: &Finding) -> i64 {
    let mut digest = Digest::of("finding");
    digest.integer(u64::from(finding.trial));
    digest.integer(u64::from(finding.number));
    digest.text(&finding.kind);
    digest.text(&finding.value);
    digest.finish_row()
}

impl RunFile {
    /// Returns the value of the finding of this kind about a simulation; `None` if the run does not
    /// have it.
    ///
    /// # Errors
    /// [`Damaged`](StoreError::Damaged), or another error of the file.
    pub fn finding(&self, trial: u32, number: u32, kind: &str) -> Result<Option<String>> {
        if !self.has_table("finding")? {
            return Ok(None);
        }
        let sql = "SELECT value, row_hash FROM finding WHERE trial = ?1 AND number = ?2 AND kind = ?3";
        let mut select = self.database.sql().prepare_cached(sql).in_file(&self.path)?;
        let found = select.query_row(params![trial, number, kind], |row| Ok((row.get(0)?, row.get(1)?)));
        let found = found.optional().in_file(&self.path)?;
        found
            .map(|(value, hash)| {
                checked(self, Finding { trial, number, kind: kind.to_string(), value }, hash)
            })
            .transpose()
    }
}
