//! Upgrade from format version 2, which did not store the index of an invalid value.
//!
//! Only the table `simulation`, the view of its columns and the counts of the view `trials` differ. The hashes of the rows
//! stay the same.

use std::path::Path;

use rusqlite::Connection;

use crate::Result;
use crate::error::InFile;
use crate::schema::{self, Schema};

const SIMULATION: &str = "CREATE TABLE simulation (
    trial INTEGER NOT NULL REFERENCES trial (number),
    number INTEGER NOT NULL,
    seed TEXT NOT NULL,
    scenario TEXT NOT NULL,
    unit_point TEXT,
    robustness ANY,
    robustness_low ANY,
    robustness_high ANY,
    stop_threshold ANY,
    ended TEXT NOT NULL,
    end_step INTEGER,
    steps INTEGER NOT NULL,
    verdicts TEXT NOT NULL,
    trace_digest TEXT,
    row_hash INTEGER NOT NULL,
    PRIMARY KEY (trial, number)
) STRICT";

const SIMULATION_COLUMNS: [&str; 11] = [
    "trial",
    "number",
    "seed",
    "robustness",
    "robustness_low",
    "robustness_high",
    "stop_threshold",
    "ended",
    "end_step",
    "steps",
    "trace_digest",
];

const COUNTS: &str = "count(simulation.number) AS simulations,
    count(*) FILTER (WHERE robustness < 0) AS falsified,
    count(*) FILTER (WHERE simulation.number IS NOT NULL AND robustness IS NULL) AS undecided,
    count(*) FILTER (WHERE ended = 'diverged') AS diverged";

/// An action was the only invalid value of version 2. Its index is unknown and becomes 0.
const COPY: &str = "INSERT INTO simulation
    SELECT trial, number, seed, scenario, unit_point, robustness, robustness_low, robustness_high, stop_threshold, ended,
        end_step, CASE ended WHEN 'invalid action' THEN 0 END, steps, verdicts, trace_digest, row_hash
    FROM simulation_2";

/// Upgrades the file in the open transaction. Foreign keys must be off.
pub(super) fn step(connection: &Connection, path: &Path) -> Result<()> {
    let differs = ["CREATE TABLE simulation ", "CREATE TABLE screened "];
    let is_other = |sql: &&&str| differs.iter().all(|start| !sql.starts_with(start));
    let tables: Vec<&str> =
        schema::TABLES.iter().filter(is_other).copied().chain(std::iter::once(SIMULATION)).collect();
    let old = Schema { tables: &tables, simulation_columns: &SIMULATION_COLUMNS, counts: COUNTS };
    let header = old.read_header(connection, path)?;
    // Renames the table without the references of other tables: the traces must refer to the new table.
    connection.pragma_update(None, "legacy_alter_table", true).in_file(path)?;
    let renamed = connection.execute_batch(
        "DROP VIEW simulations; DROP VIEW trials; ALTER TABLE simulation RENAME TO simulation_2;",
    );
    renamed.in_file(path)?;
    connection.pragma_update(None, "legacy_alter_table", false).in_file(path)?;
    schema::create(connection, &header).in_file(path)?;
    connection.execute_batch(COPY).in_file(path)?;
    connection.execute_batch("DROP TABLE simulation_2").in_file(path)
}
