//! The tables of a run file.
//!
//! Texts are words that a person can read with any SQLite tool. Numbers are little-endian doubles in blobs
//! where there are several; `seed` and the hashes are 64 bits in SQLite's signed integer. `robustness` is of
//! type `ANY`, since SQLite would turn −0.0 into 0 in a column of type `REAL`; NULL stands for undecided.

use crate::upgrade::STEPS;

/// The version of the file's format that this program writes, and the latest that it reads.
pub const FORMAT_VERSION: i64 = STEPS.len() as i64 + 1;

/// Marks a SQLite database as a run of ours: `MHdl` in ASCII.
pub(crate) const APPLICATION_ID: i64 = 0x4d48_646c;

pub(crate) const TABLES: &str = "
CREATE TABLE header (
    key TEXT PRIMARY KEY,
    value ANY NOT NULL
) STRICT, WITHOUT ROWID;

CREATE TABLE signal (
    position INTEGER PRIMARY KEY,
    name TEXT NOT NULL UNIQUE
) STRICT;

CREATE TABLE axis (
    position INTEGER PRIMARY KEY,
    name TEXT NOT NULL UNIQUE,
    unit TEXT NOT NULL,
    low ANY NOT NULL,
    high ANY NOT NULL
) STRICT;

CREATE TABLE verdict (
    position INTEGER PRIMARY KEY,
    name TEXT NOT NULL UNIQUE
) STRICT;

CREATE TABLE trial (
    number INTEGER PRIMARY KEY,
    seed INTEGER NOT NULL,
    status TEXT NOT NULL,
    row_hash INTEGER NOT NULL
) STRICT;

CREATE TABLE simulation (
    trial INTEGER NOT NULL REFERENCES trial (number),
    number INTEGER NOT NULL,
    seed INTEGER NOT NULL,
    robustness ANY,
    ended TEXT NOT NULL,
    end_step INTEGER,
    steps INTEGER NOT NULL,
    unit_point BLOB NOT NULL,
    initial_configuration BLOB NOT NULL,
    verdicts BLOB NOT NULL,
    trace_digest BLOB,
    row_hash INTEGER NOT NULL,
    PRIMARY KEY (trial, number)
) STRICT, WITHOUT ROWID;

CREATE TABLE trace (
    trial INTEGER NOT NULL,
    number INTEGER NOT NULL,
    blob BLOB NOT NULL,
    PRIMARY KEY (trial, number),
    FOREIGN KEY (trial, number) REFERENCES simulation (trial, number)
) STRICT;
";
