//! Files of format version 1: the fixture with additional rows, each with the hash of version 1.

use std::path::{Path, PathBuf};

use rusqlite::{Connection, params};
use sha2::{Digest, Sha256};
use tempfile::TempDir;

/// A row of a simulation. The fixture has two axes and two verdicts.
#[derive(Debug, Clone)]
pub struct Row {
    pub trial: u32,
    pub number: u32,
    pub seed: u64,
    pub unit_point: Vec<f64>,
    pub initial_configuration: [f64; 2],
    pub robustness: Option<f64>,
    pub ended: (&'static str, Option<u32>),
    pub steps: u32,
    pub verdicts: [Option<f64>; 2],
    pub trace_digest: Option<u128>,
}

/// Copies the fixture to a temporary folder.
pub fn copy() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    std::fs::copy("tests/fixtures/v1.sqlite", &path).unwrap();
    (folder, path)
}

/// Adds rows to the trials 1 to 4 of the fixture.
pub fn add(path: &Path, rows: impl Iterator<Item = Row>) {
    let connection = Connection::open(path).unwrap();
    connection.execute_batch("BEGIN").unwrap();
    let sql = "INSERT INTO simulation VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12)";
    let mut insert = connection.prepare(sql).unwrap();
    let bytes = |values: &[f64]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
    for row in rows {
        let verdicts = row.verdicts.map(|verdict| verdict.unwrap_or(f64::from_bits(0x7ff8_0000_0000_0000)));
        let values = params![
            row.trial,
            row.number,
            row.seed.cast_signed(),
            row.robustness,
            row.ended.0,
            row.ended.1,
            row.steps,
            bytes(&row.unit_point),
            bytes(&row.initial_configuration),
            bytes(&verdicts),
            row.trace_digest.map(u128::to_be_bytes),
            hash(&row),
        ];
        insert.execute(values).unwrap();
    }
    connection.execute_batch("COMMIT").unwrap();
}

/// Returns the first 8 bytes of the SHA-256 of all values: numbers as 8 little-endian bytes, texts and lists preceded
/// by their length.
fn hash(row: &Row) -> i64 {
    let word = |value: u64| value.to_le_bytes().to_vec();
    let text = |text: &str| [word(text.len() as u64), text.into()].concat();
    let float = |value: &f64| word(value.to_bits());
    let floats = |values: &[f64]| {
        let values: Vec<u8> = values.iter().flat_map(float).collect();
        [word(values.len() as u64 / 8), values].concat()
    };
    let optional = |value: Option<f64>| [word(value.is_some().into()), float(&value.unwrap_or(0.0))].concat();
    let trace_digest = row.trace_digest.unwrap_or(0);
    let bytes = [
        text("simulation"),
        word(row.trial.into()),
        word(row.number.into()),
        word(row.seed),
        floats(&row.unit_point),
        floats(&row.initial_configuration),
        optional(row.robustness),
        text(row.ended.0),
        word(row.ended.1.unwrap_or(0).into()),
        word(row.steps.into()),
        word(2),
        optional(row.verdicts[0]),
        optional(row.verdicts[1]),
        word(row.trace_digest.is_some().into()),
        trace_digest.to_le_bytes().to_vec(),
    ];
    i64::from_be_bytes(*Sha256::digest(bytes.concat()).first_chunk().unwrap())
}
