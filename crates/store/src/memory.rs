//! The memory of a proposal of importance sampling of simulations: a table of its own, which a run
//! has from its first steered simulation on.
//!
//! A question that is asked again, of a run that is continued or of a report, needs it: it follows
//! from the states that the proposal saw, which a run does not keep. The digest of the content
//! leaves it out, because it says nothing of the simulation itself.

use rusqlite::{Connection, OptionalExtension, params};

use crate::digest::Digest;
use crate::error::{InFile, StoreError};
use crate::{Result, RunFile};

/// The statement that creates the table: see [`TABLES`](crate::schema).
pub(crate) const TABLE: &str = "CREATE TABLE memory (
    trial INTEGER NOT NULL,
    number INTEGER NOT NULL,
    numbers BLOB NOT NULL,
    row_hash INTEGER NOT NULL,
    PRIMARY KEY (trial, number),
    FOREIGN KEY (trial, number) REFERENCES simulation (trial, number)
) STRICT";

/// Largest length of a memory, bytes.
const MAX_BYTES: usize = 1 << 24;

/// Writes the memory of a simulation.
pub(crate) fn insert(file: &RunFile, trial: u32, number: u32, memory: &[f64]) -> Result<()> {
    if !file.has_table("memory")? {
        file.database.sql().execute(TABLE, []).in_file(&file.path)?;
    }
    let numbers: Vec<u8> = memory.iter().flat_map(|value| value.to_le_bytes()).collect();
    let sql = "INSERT INTO memory (trial, number, numbers, row_hash) VALUES (?1, ?2, ?3, ?4)";
    let values = params![trial, number, numbers, hash(trial, number, &numbers)];
    let insert = |connection: &Connection| connection.prepare_cached(sql)?.execute(values);
    file.database.with_traces(insert).map(drop).in_file(&file.path)
}

/// Checks the hashes of all memories.
pub(crate) fn check(file: &RunFile) -> Result<()> {
    if !file.has_table("memory")? {
        return Ok(());
    }
    let select = |connection: &Connection| {
        let mut select = connection.prepare_cached("SELECT trial, number, numbers, row_hash FROM memory")?;
        let mut rows = select.query([])?;
        while let Some(row) = rows.next()? {
            let numbers: Vec<u8> = row.get(2)?;
            if let Err(error) = checked(file, row.get(0)?, row.get(1)?, &numbers, row.get(3)?) {
                return Ok(Err(error));
            }
        }
        Ok(Ok(()))
    };
    file.database.with_traces(select).in_file(&file.path)?
}

fn checked(file: &RunFile, trial: u32, number: u32, numbers: &[u8], found: i64) -> Result<Vec<f64>> {
    if numbers.len() > MAX_BYTES || hash(trial, number, numbers) != found {
        let what = format!("the memory of simulation {number} of trial {trial} does not match its hash");
        return Err(StoreError::damaged(&file.path, what));
    }
    let (chunks, _) = numbers.as_chunks::<8>();
    Ok(chunks.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect())
}

fn hash(trial: u32, number: u32, numbers: &[u8]) -> i64 {
    let mut digest = Digest::of("memory");
    digest.integer(u64::from(trial));
    digest.integer(u64::from(number));
    digest.bytes(numbers);
    digest.finish_row()
}

impl RunFile {
    /// Returns what a proposal remembers of a simulation; `None` if the run does not have it.
    ///
    /// # Errors
    /// [`Damaged`](StoreError::Damaged), or another error of the file.
    pub fn memory(&self, trial: u32, number: u32) -> Result<Option<Vec<f64>>> {
        if !self.has_table("memory")? {
            return Ok(None);
        }
        let sql = "SELECT numbers, row_hash FROM memory WHERE trial = ?1 AND number = ?2";
        let select = |connection: &Connection| {
            let mut select = connection.prepare_cached(sql)?;
            select.query_row([trial, number], |row| Ok((row.get::<_, Vec<u8>>(0)?, row.get(1)?))).optional()
        };
        let found = self.database.with_traces(select).in_file(&self.path)?;
        found.map(|(numbers, hash)| checked(self, trial, number, &numbers, hash)).transpose()
    }
}
