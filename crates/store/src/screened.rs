//! Outcomes of another physics engine. They propose simulations; they are not simulations
//! themselves.
//!
//! A chunk holds the outcomes of the requests that were screened together. A run that continues
//! takes them from the file instead of screening again. `requests` is a digest of the requests, so
//! that outcomes never answer other ones.

use std::path::Path;

use rusqlite::{Connection, params};

use crate::digest::Digest;
use crate::error::{InFile, StoreError};
use crate::{Result, RunFile, StoredTrace, trace_blob};

/// The outcomes of requests that were screened together.
#[derive(Clone, Debug, PartialEq)]
pub struct ScreenedChunk {
    /// Number of the chunk in its run, from 1.
    pub number: u32,
    /// Number of outcomes that violate the requirement.
    pub violated: u64,
    /// Number of outcomes without a verdict.
    pub without_verdict: u64,
    /// Digest of the requests.
    pub requests: u128,
    /// One column for each value of an outcome, with one number per request.
    pub outcomes: StoredTrace,
}

/// A row of the table, with its outcomes as they are stored.
struct Row {
    number: u32,
    simulations: i64,
    violated: i64,
    without_verdict: i64,
    requests: String,
    blob: Vec<u8>,
}

const COLUMNS: &str = "chunk, simulations, violated, without_verdict, requests, outcomes, row_hash";

impl Row {
    fn hash(&self) -> i64 {
        let mut digest = Digest::of("screened");
        digest.integer(self.number.into());
        for count in [self.simulations, self.violated, self.without_verdict] {
            digest.integer(count.cast_unsigned());
        }
        digest.text(&self.requests);
        digest.bytes(&self.blob);
        digest.finish_row()
    }

    /// Reads a row and checks its hash.
    fn read(row: &rusqlite::Row<'_>, path: &Path) -> Result<Row> {
        let parse = || {
            let read = Row {
                number: row.get(0)?,
                simulations: row.get(1)?,
                violated: row.get(2)?,
                without_verdict: row.get(3)?,
                requests: row.get(4)?,
                blob: row.get(5)?,
            };
            Ok((read, row.get::<_, i64>(6)?))
        };
        let (read, hash) = parse().in_file(path)?;
        if read.hash() == hash {
            Ok(read)
        } else {
            Err(damaged(path, read.number, "it does not match its hash"))
        }
    }
}

fn damaged(path: &Path, number: u32, what: &str) -> StoreError {
    StoreError::damaged(path, format!("screened chunk {number}: {what}"))
}

/// Writes a chunk in the open transaction.
pub(crate) fn insert(file: &RunFile, chunk: &ScreenedChunk) -> Result<()> {
    let row = Row {
        number: chunk.number,
        simulations: chunk.outcomes.samples() as i64,
        violated: chunk.violated.cast_signed(),
        without_verdict: chunk.without_verdict.cast_signed(),
        requests: format!("{:032x}", chunk.requests),
        blob: trace_blob::encode(&chunk.outcomes),
    };
    let hash = row.hash();
    let Row { number, simulations, violated, without_verdict, requests, blob } = row;
    let sql = format!("INSERT INTO screened ({COLUMNS}) VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)");
    let values = params![number, simulations, violated, without_verdict, requests, blob, hash];
    let insert = |connection: &Connection| connection.prepare_cached(&sql)?.execute(values);
    file.database.with_traces(insert).map(drop).in_file(&file.path)
}

/// Calls `with` with each chunk of the run in order, or with the one of this number.
fn each(file: &RunFile, number: Option<u32>, mut with: impl FnMut(Row) -> Result<()>) -> Result<()> {
    let sql = format!("SELECT {COLUMNS} FROM screened WHERE ?1 IS NULL OR chunk = ?1 ORDER BY chunk");
    let path = &file.path;
    let select = |connection: &Connection| {
        let mut select = connection.prepare_cached(&sql)?;
        let mut rows = select.query([number])?;
        while let Some(row) = rows.next()? {
            let done = Row::read(row, path).and_then(&mut with);
            if done.is_err() {
                return Ok(done);
            }
        }
        Ok(Ok(()))
    };
    file.database.with_traces(select).in_file(path)?
}

/// Reads a chunk whose outcomes have this number of columns; `None` if the run has no chunk with
/// this number.
pub(crate) fn read(file: &RunFile, number: u32, columns: usize) -> Result<Option<ScreenedChunk>> {
    let mut found = None;
    each(file, Some(number), |row| {
        let damaged = |what: &str| damaged(&file.path, number, what);
        found = Some(ScreenedChunk {
            number,
            violated: row.violated.cast_unsigned(),
            without_verdict: row.without_verdict.cast_unsigned(),
            requests: u128::from_str_radix(&row.requests, 16)
                .map_err(|_| damaged("its digest is no hexadecimal number"))?,
            outcomes: trace_blob::decode(&row.blob, columns).map_err(|problem| damaged(&problem))?,
        });
        Ok(())
    })?;
    Ok(found)
}

/// Feeds the hashes of all chunks, and checks them.
pub(crate) fn feed(file: &RunFile, digest: &mut Digest) -> Result<()> {
    each(file, None, |row| {
        digest.integer(row.hash().cast_unsigned());
        Ok(())
    })
}

/// Returns a digest of requests: of the bits of each number of each of them.
pub fn requests_digest<'a>(requests: impl Iterator<Item = (u64, &'a [Option<f64>])>) -> u128 {
    let mut digest = Digest::of("requests");
    for (seed, scenario) in requests {
        digest.integer(seed);
        digest.optionals(scenario);
    }
    digest.finish()
}
