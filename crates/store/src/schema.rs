//! The tables and views of a run file.
//!
//! `docs/reference/run_file.md` explains the columns to readers with plain `sqlite3`. Columns of
//! floats have the type `ANY`, because a column of type `REAL` turns −0.0 into 0. Seeds are decimal
//! text, because SQLite's integers are signed. Hashes of rows are the first 64 bits of a SHA-256.
//!
//! `simulation` is not `WITHOUT ROWID`: in such a table, SQLite moves a row of more than 1,000
//! bytes (about 20 axes) to overflow pages.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use rusqlite::Connection;

use crate::error::{InFile, StoreError};
use crate::row::COUNTS;
use crate::{MAX_TRIALS, Result, RunHeader, finding, header_table, memory, reason};

/// The statements that create the tables. SQLite stores their text, and opening a file compares it,
/// so every character is part of the format.
const TABLES: &[&str] = &[
    "CREATE TABLE header (
    key TEXT PRIMARY KEY,
    value ANY NOT NULL
) STRICT, WITHOUT ROWID",
    "CREATE TABLE version (
    position INTEGER PRIMARY KEY,
    name TEXT NOT NULL UNIQUE,
    version TEXT NOT NULL
) STRICT",
    "CREATE TABLE component (
    position INTEGER PRIMARY KEY,
    role TEXT NOT NULL,
    name TEXT NOT NULL,
    hash TEXT NOT NULL,
    file_hash TEXT NOT NULL
) STRICT",
    "CREATE TABLE formula (
    position INTEGER PRIMARY KEY,
    name TEXT NOT NULL UNIQUE,
    text TEXT NOT NULL
) STRICT",
    "CREATE TABLE signal (
    position INTEGER PRIMARY KEY,
    name TEXT NOT NULL UNIQUE,
    unit TEXT NOT NULL
) STRICT",
    "CREATE TABLE axis (
    position INTEGER PRIMARY KEY,
    name TEXT NOT NULL UNIQUE,
    unit TEXT NOT NULL,
    kind TEXT NOT NULL,
    low ANY NOT NULL,
    high ANY NOT NULL,
    nominal ANY,
    domain TEXT NOT NULL,
    meaning TEXT NOT NULL
) STRICT",
    "CREATE TABLE verdict (
    position INTEGER PRIMARY KEY,
    name TEXT NOT NULL UNIQUE
) STRICT",
    "CREATE TABLE preflight (
    position INTEGER PRIMARY KEY,
    name TEXT NOT NULL
) STRICT",
    "CREATE TABLE trial (
    number INTEGER PRIMARY KEY,
    seed TEXT NOT NULL,
    status TEXT NOT NULL,
    row_hash INTEGER NOT NULL
) STRICT",
    "CREATE TABLE simulation (
    trial INTEGER NOT NULL REFERENCES trial (number),
    number INTEGER NOT NULL,
    seed TEXT NOT NULL,
    scenario TEXT NOT NULL,
    unit_point TEXT,
    robustness ANY,
    violated INTEGER,
    robustness_low ANY,
    robustness_high ANY,
    stop_threshold ANY,
    ended TEXT NOT NULL,
    end_step INTEGER,
    end_index INTEGER,
    steps INTEGER NOT NULL,
    verdicts TEXT NOT NULL,
    trace_digest TEXT,
    row_hash INTEGER NOT NULL,
    PRIMARY KEY (trial, number)
) STRICT",
    "CREATE TABLE trace (
    trial INTEGER NOT NULL,
    number INTEGER NOT NULL,
    blob BLOB NOT NULL,
    PRIMARY KEY (trial, number),
    FOREIGN KEY (trial, number) REFERENCES simulation (trial, number)
) STRICT",
    "CREATE TABLE screened (
    chunk INTEGER PRIMARY KEY,
    simulations INTEGER NOT NULL,
    violated INTEGER NOT NULL,
    without_verdict INTEGER NOT NULL,
    requests TEXT NOT NULL,
    outcomes BLOB NOT NULL,
    row_hash INTEGER NOT NULL
) STRICT",
];

/// Columns of the table that the view `simulations` contains unchanged.
const SIMULATION_COLUMNS: [&str; 13] = [
    "trial",
    "number",
    "seed",
    "robustness",
    "violated",
    "robustness_low",
    "robustness_high",
    "stop_threshold",
    "ended",
    "end_step",
    "end_index",
    "steps",
    "trace_digest",
];

/// Largest number of columns of a view. SQLite returns at most 2,000 columns; further axes and
/// verdicts are only in the JSON.
const MAX_COLUMNS: usize = 1900;

/// Checks that the file contains the tables and views of this version and nothing else, and returns
/// its header.
///
/// A malicious file can contain triggers, or views in place of the tables.
pub(crate) fn read_header(connection: &Connection, path: &Path) -> Result<RunHeader> {
    let found = statements(connection).in_file(path)?;
    let mut others = without(found, path, TABLES.iter().copied())?;
    others.remove(reason::TABLE);
    others.remove(memory::TABLE);
    others.remove(finding::TABLE);
    let header = header_table::read(connection, path)?;
    check_empty(&without(others, path, views(&header).iter().map(String::as_str))?, path)?;
    Ok(header)
}

/// Returns the statements that create the views. They depend on the header: one column per axis and
/// verdict. Their text is part of the format.
fn views(header: &RunHeader) -> [String; 2] {
    let mut taken: BTreeSet<String> = SIMULATION_COLUMNS.iter().map(ToString::to_string).collect();
    let mut columns: Vec<String> = SIMULATION_COLUMNS.iter().map(ToString::to_string).collect();
    for axis in &header.axes {
        let value = extract("scenario", &axis.name);
        columns.push(format!("{value} AS {}", identifier(&free_name("axis", &axis.name, &mut taken))));
    }
    for name in &header.verdicts {
        let value = extract("verdicts", name);
        // As a string, an infinity would compare greater than every number.
        let value = format!("CASE {value} WHEN 'inf' THEN 9e999 WHEN '-inf' THEN -9e999 ELSE {value} END");
        columns.push(format!("{value} AS {}", identifier(&free_name("verdict", name, &mut taken))));
    }
    // SQLite ends a statement at a NUL.
    columns.retain(|column| !column.contains('\0'));
    columns.truncate(MAX_COLUMNS);
    [
        format!(
            "CREATE VIEW simulations AS SELECT\n    {}\nFROM simulation WHERE trial <= {MAX_TRIALS}",
            columns.join(",\n    ")
        ),
        format!(
            "CREATE VIEW trials AS SELECT trial.number AS number, trial.seed AS seed, trial.status AS status,
    {COUNTS}, min(robustness) AS minimum_robustness
FROM trial LEFT JOIN simulation ON simulation.trial = trial.number
WHERE trial.number <= {MAX_TRIALS}
GROUP BY trial.number"
        ),
    ]
}

/// Creates the tables and views.
pub(crate) fn create(connection: &Connection, header: &RunHeader) -> rusqlite::Result<()> {
    let views = views(header);
    let mut statements = TABLES.iter().copied().chain(views.iter().map(String::as_str));
    statements.try_for_each(|sql| connection.execute(sql, []).map(drop))
}

/// Kind and name of each table, view, index and trigger, by the statement that created it.
type Statements = BTreeMap<String, String>;

/// Removes `expected` from `found`.
fn without<'a>(
    mut found: Statements,
    path: &Path,
    expected: impl Iterator<Item = &'a str>,
) -> Result<Statements> {
    for sql in expected {
        if found.remove(sql).is_none() {
            let kind_and_name: Vec<&str> = sql.split_whitespace().skip(1).take(2).collect();
            let what = format!("its {} is missing or was changed", kind_and_name.join(" ").to_lowercase());
            return Err(StoreError::damaged(path, what));
        }
    }
    Ok(found)
}

fn check_empty(others: &Statements, path: &Path) -> Result<()> {
    match others.values().next() {
        Some(other) => {
            Err(StoreError::damaged(path, format!("it contains {other}, which this program did not create")))
        }
        None => Ok(()),
    }
}

fn statements(connection: &Connection) -> rusqlite::Result<Statements> {
    // Indexes of primary keys have no statement. `ANALYZE` of a SQLite tool adds the tables of its
    // statistics.
    let mut select = connection.prepare(
        "SELECT ifnull(sql, ''), type || ' ' || name FROM sqlite_schema
         WHERE NOT (type = 'index' AND name GLOB 'sqlite_autoindex_*' AND sql IS NULL)
             AND ifnull(sql, '') NOT IN (
                 'CREATE TABLE sqlite_stat1(tbl,idx,stat)',
                 'CREATE TABLE sqlite_stat4(tbl,idx,neq,nlt,ndlt,sample)'
             )",
    )?;
    select.query_map([], |row| Ok((row.get(0)?, row.get(1)?)))?.collect()
}

/// Returns `name`, or a name derived from it if another column has it. SQLite ignores the case of
/// names.
fn free_name(kind: &str, name: &str, taken: &mut BTreeSet<String>) -> String {
    let numbered = (2..).map(|number: u32| format!("{kind}_{name}_{number}"));
    let mut candidates = [name.to_owned(), format!("{kind}_{name}")].into_iter().chain(numbered);
    candidates.find(|candidate| taken.insert(candidate.to_ascii_lowercase())).unwrap_or_default()
}

/// Returns an SQL expression for the member `name` of the JSON object in `column`.
fn extract(column: &str, name: &str) -> String {
    let is_plain = |c: char| c != '"' && c != '\\' && !c.is_control();
    if !name.is_empty() && name.chars().all(is_plain) {
        format!("json_extract({column}, {})", literal(&format!("$.\"{name}\"")))
    } else {
        // Before version 3.45, the paths of SQLite have no escapes.
        format!("(SELECT value FROM json_each({column}) WHERE key = {})", literal(name))
    }
}

fn identifier(name: &str) -> String {
    format!("\"{}\"", name.replace('"', "\"\""))
}

fn literal(text: &str) -> String {
    format!("'{}'", text.replace('\'', "''"))
}
