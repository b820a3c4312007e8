//! Upgrade from format version 1.
//!
//! Version 1 stored lists of numbers in blobs and seeds as signed integers, and had one kind of target: a task with a
//! controller. The upgrade reads each row in the format of version 1, checks its hash, and writes it in the current
//! format.

use std::path::Path;

use rusqlite::{Connection, Row};

use crate::digest::Digest;
use crate::error::{InFile, StoreError};
use crate::header_table::value;
use crate::{
    AxisRecord, BuildRecord, ComponentRecord, Result, RunHeader, RunKind, SignalRecord, Simulation,
    SimulationEnd, TargetRecord, TrialRecord, TrialStatus, header_table, row, schema,
};

/// The tables of version 1. The upgrade does not change the table `trace`.
const TABLES: &[&str] = &[
    "CREATE TABLE header (
    key TEXT PRIMARY KEY,
    value ANY NOT NULL
) STRICT, WITHOUT ROWID",
    "CREATE TABLE signal (
    position INTEGER PRIMARY KEY,
    name TEXT NOT NULL UNIQUE
) STRICT",
    "CREATE TABLE axis (
    position INTEGER PRIMARY KEY,
    name TEXT NOT NULL UNIQUE,
    unit TEXT NOT NULL,
    low ANY NOT NULL,
    high ANY NOT NULL
) STRICT",
    "CREATE TABLE verdict (
    position INTEGER PRIMARY KEY,
    name TEXT NOT NULL UNIQUE
) STRICT",
    "CREATE TABLE trial (
    number INTEGER PRIMARY KEY,
    seed INTEGER NOT NULL,
    status TEXT NOT NULL,
    row_hash INTEGER NOT NULL
) STRICT",
    "CREATE TABLE simulation (
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
) STRICT, WITHOUT ROWID",
    "CREATE TABLE trace (
    trial INTEGER NOT NULL,
    number INTEGER NOT NULL,
    blob BLOB NOT NULL,
    PRIMARY KEY (trial, number),
    FOREIGN KEY (trial, number) REFERENCES simulation (trial, number)
) STRICT",
];

/// Keys of the text values in the header, in the order in which version 1 hashed them.
const TEXTS: [&str; 15] = [
    "kind",
    "program_version",
    "git_commit",
    "target",
    "rustc",
    "mujoco_version",
    "architecture",
    "plan",
    "controller",
    "controller_hash",
    "controller_bytes_hash",
    "task",
    "preset",
    "formula",
    "search",
];

/// Bit pattern of `None` in the verdicts.
const ABSENT: u64 = 0x7ff8_0000_0000_0000;

/// Number of control steps of every episode in version 1.
const EPISODE_STEPS: u32 = 300;

/// Upgrades the file in the open transaction. Foreign keys must be off.
pub(super) fn step(connection: &Connection, path: &Path) -> Result<()> {
    schema::check(connection, path, TABLES)?;
    let header = header(connection, path)?;
    // Renames the table without the references of other tables: the traces must refer to the new table.
    connection.pragma_update(None, "legacy_alter_table", true).in_file(path)?;
    let renamed = connection.execute_batch(
        "DROP TABLE header; DROP TABLE signal; DROP TABLE axis; DROP TABLE verdict;
         ALTER TABLE trial RENAME TO trial_1; ALTER TABLE simulation RENAME TO simulation_1;",
    );
    renamed.in_file(path)?;
    connection.pragma_update(None, "legacy_alter_table", false).in_file(path)?;
    schema::create(connection, &header).in_file(path)?;
    header_table::write(connection, &header).in_file(path)?;
    copy_trials(connection, path)?;
    copy_simulations(connection, path, &header)?;
    connection.execute_batch("DROP TABLE simulation_1; DROP TABLE trial_1;").in_file(path)
}

fn header(connection: &Connection, path: &Path) -> Result<RunHeader> {
    let mut texts = Vec::with_capacity(TEXTS.len());
    for key in TEXTS {
        texts.push(value::<String>(connection, path, key)?);
    }
    let seed = value::<i64>(connection, path, "seed")?.cast_unsigned();
    let control_dt: f64 = value(connection, path, "control_dt")?;
    let names = |table| header_table::select_list(connection, path, table, "name", |row| row.get(0));
    let signals: Vec<String> = names("signal")?;
    let verdicts: Vec<String> = names("verdict")?;
    let axes = header_table::select_list(connection, path, "axis", "name, unit, low, high", axis)?;

    let mut digest = Digest::of("header");
    for (key, text) in TEXTS.iter().zip(&texts) {
        digest.text(key);
        digest.text(text);
    }
    digest.text("seed");
    digest.integer(seed);
    digest.text("control_dt");
    digest.float(control_dt);
    for names in [&signals, &verdicts] {
        digest.integer(names.len() as u64);
        names.iter().for_each(|name| digest.text(name));
    }
    for AxisRecord { name, unit, low, high, .. } in &axes {
        digest.text(name);
        digest.text(unit);
        digest.float(*low);
        digest.float(*high);
    }
    if digest.finish_row() != value::<i64>(connection, path, "header_hash")? {
        return Err(StoreError::damaged(path, "the header does not match its hash"));
    }

    let mut text = |key| {
        let index = TEXTS.iter().position(|known| *known == key)?;
        texts.get_mut(index).map(std::mem::take)
    };
    let mut text = |key| text(key).unwrap_or_default();
    let kind = match text("kind").as_str() {
        "falsify" => RunKind::Falsify,
        "evaluate" => RunKind::Evaluate,
        kind => return Err(StoreError::damaged(path, format!("its kind is {kind:?}"))),
    };
    Ok(RunHeader {
        kind,
        build: BuildRecord {
            program_version: text("program_version"),
            git_commit: text("git_commit"),
            target: text("target"),
            rustc: text("rustc"),
            architecture: text("architecture"),
        },
        versions: vec![("MuJoCo".into(), text("mujoco_version"))],
        plan: text("plan"),
        target: TargetRecord {
            kind: "task".into(),
            name: text("task"),
            hash: String::new(),
            is_deterministic: true,
        },
        components: vec![ComponentRecord {
            role: "controller".into(),
            name: text("controller"),
            hash: text("controller_hash"),
            file_hash: text("controller_bytes_hash"),
        }],
        space: "starts".into(),
        formula: text("formula"),
        formulas: vec![],
        search: text("search"),
        seed,
        control_dt,
        episode_steps: EPISODE_STEPS,
        signals: signals.into_iter().map(|name| SignalRecord { name, unit: String::new() }).collect(),
        axes,
        verdicts,
    })
}

fn axis(row: &Row<'_>) -> rusqlite::Result<AxisRecord> {
    let (low, high): (f64, f64) = (row.get(2)?, row.get(3)?);
    Ok(AxisRecord {
        name: row.get(0)?,
        unit: row.get(1)?,
        kind: "start".into(),
        low,
        high,
        nominal: Some(low * 0.5 + high * 0.5),
        values: "continuous".into(),
        meaning: String::new(),
    })
}

fn copy_trials(connection: &Connection, path: &Path) -> Result<()> {
    let sql = "SELECT number, seed, status, row_hash FROM trial_1 ORDER BY number";
    let mut select = connection.prepare(sql).in_file(path)?;
    let mut rows = select.query([]).in_file(path)?;
    while let Some(row) = rows.next().in_file(path)? {
        row::insert_trial(connection, &trial(row, path)?).in_file(path)?;
    }
    Ok(())
}

fn trial(row: &Row<'_>, path: &Path) -> Result<TrialRecord> {
    let number: u32 = row.get(0).in_file(path)?;
    let damaged = |what: &str| StoreError::damaged(path, format!("trial {number}: {what}"));
    let seed = row.get::<_, i64>(1).in_file(path)?.cast_unsigned();
    let text: String = row.get(2).in_file(path)?;
    let status = match text.as_str() {
        "running" => TrialStatus::Running,
        "falsified" => TrialStatus::Falsified,
        "budget spent" => TrialStatus::BudgetSpent,
        "converged" => TrialStatus::Converged,
        _ => return Err(damaged("its status is unknown")),
    };
    let mut digest = Digest::of("trial");
    digest.integer(u64::from(number));
    digest.integer(seed);
    digest.text(&text);
    if digest.finish_row() != row.get::<_, i64>(3).in_file(path)? {
        return Err(damaged("it does not match its hash"));
    }
    Ok(TrialRecord { number, seed, status })
}

fn copy_simulations(connection: &Connection, path: &Path, header: &RunHeader) -> Result<()> {
    let sql =
        "SELECT trial, number, seed, robustness, ended, end_step, steps, unit_point, initial_configuration,
             verdicts, trace_digest, row_hash
         FROM simulation_1 ORDER BY trial, number";
    let mut select = connection.prepare(sql).in_file(path)?;
    let mut rows = select.query([]).in_file(path)?;
    while let Some(row) = rows.next().in_file(path)? {
        let simulation = simulation(row, path)?;
        // Without this check, a list with too many elements would be truncated.
        row::guard(&simulation, header).map_err(|error| StoreError::damaged(path, error.to_string()))?;
        row::insert(connection, header, &simulation, simulation.trace_digest).in_file(path)?;
    }
    Ok(())
}

fn simulation(row: &Row<'_>, path: &Path) -> Result<Simulation> {
    let (trial, number): (u32, u32) = (row.get(0).in_file(path)?, row.get(1).in_file(path)?);
    let damaged =
        |what: &str| StoreError::damaged(path, format!("simulation {number} of trial {trial}: {what}"));
    let words = |column| -> Result<Vec<u64>> {
        let blob: Vec<u8> = row.get(column).in_file(path)?;
        let (words, rest) = blob.as_chunks::<8>();
        if !rest.is_empty() {
            return Err(damaged("a list of doubles has a broken length"));
        }
        Ok(words.iter().map(|&word| u64::from_le_bytes(word)).collect())
    };
    let floats =
        |column| -> Result<Vec<f64>> { Ok(words(column)?.into_iter().map(f64::from_bits).collect()) };
    let seed = row.get::<_, i64>(2).in_file(path)?.cast_unsigned();
    let robustness: Option<f64> = row.get(3).in_file(path)?;
    let ended: String = row.get(4).in_file(path)?;
    let end_step: Option<u32> = row.get(5).in_file(path)?;
    let steps: u32 = row.get(6).in_file(path)?;
    let unit_point = floats(7)?;
    let initial_configuration = floats(8)?;
    let verdicts: Vec<Option<f64>> =
        words(9)?.into_iter().map(|bits| (bits != ABSENT).then(|| f64::from_bits(bits))).collect();
    let trace_digest = row.get::<_, Option<[u8; 16]>>(10).in_file(path)?.map(u128::from_be_bytes);

    let mut digest = Digest::of("simulation");
    digest.integer(u64::from(trial));
    digest.integer(u64::from(number));
    digest.integer(seed);
    digest.floats(&unit_point);
    digest.floats(&initial_configuration);
    digest.optional(robustness);
    digest.text(&ended);
    digest.integer(end_step.map_or(0, u64::from));
    digest.integer(u64::from(steps));
    digest.optionals(&verdicts);
    digest.integer(trace_digest.is_some().into());
    digest.integer(trace_digest.unwrap_or(0) as u64);
    digest.integer((trace_digest.unwrap_or(0) >> 64) as u64);
    if digest.finish_row() != row.get::<_, i64>(11).in_file(path)? {
        return Err(damaged("it does not match its hash"));
    }

    let end = match (ended.as_str(), end_step) {
        ("horizon", None) => SimulationEnd::Completed,
        ("stopped", Some(step)) => SimulationEnd::Stopped { step },
        ("diverged", Some(step)) => SimulationEnd::Diverged { step },
        ("undefined", Some(step)) => SimulationEnd::Undefined { step },
        _ => return Err(damaged("its end is unknown")),
    };
    // Version 1 did not record bounds of the robustness for incomplete episodes.
    let proven = robustness.filter(|_| end == SimulationEnd::Completed);
    Ok(Simulation {
        trial,
        number,
        seed,
        unit_point,
        scenario: initial_configuration.into_iter().map(Some).collect(),
        robustness,
        robustness_low: proven,
        robustness_high: proven,
        stop_threshold: None,
        end,
        steps,
        verdicts,
        trace_digest,
        trace: None,
    })
}
