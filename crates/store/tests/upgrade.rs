//! Runs of older formats are upgraded bit for bit; damaged ones are reported and left unchanged.
#![allow(clippy::unwrap_used)] // clippy does not count helper functions as tests

mod sample;

use mishandle_store::{IfExists, RunFile, RunWriter, Simulation, SimulationEnd, StoreError};
use rusqlite::Connection;
use sample::version_1::{Row, add, copy};
use sample::{header, record};

/// Returns a row of trial 3, which has no rows in the fixture.
fn row(number: u32) -> Row {
    let x = f64::from(number) / 7.0;
    Row {
        trial: 3,
        number,
        seed: u64::from(number).wrapping_mul(0x9e37_79b9_7f4a_7c15),
        unit_point: if number.is_multiple_of(4) { vec![] } else { vec![x.fract(), -0.0] },
        initial_configuration: [x, -1e-300 * x],
        robustness: [None, Some(x.sin()), Some(-0.0), Some(f64::INFINITY), Some(5e-324)][number as usize % 5],
        ended: [("horizon", None), ("stopped", Some(number)), ("diverged", Some(7)), ("undefined", Some(0))]
            [number as usize % 4],
        steps: number,
        verdicts: [Some(f64::NEG_INFINITY), number.is_multiple_of(2).then_some(x)],
        trace_digest: number.is_multiple_of(3).then_some(u128::MAX - u128::from(number)),
    }
}

/// Returns the simulation that the current version stores for the row.
fn upgraded(row: &Row) -> Simulation {
    let end = match row.ended {
        ("horizon", _) => SimulationEnd::Completed,
        ("stopped", Some(step)) => SimulationEnd::Stopped { step },
        ("diverged", Some(step)) => SimulationEnd::Diverged { step },
        (_, step) => SimulationEnd::Undefined { step: step.unwrap() },
    };
    let bound = if end == SimulationEnd::Completed { row.robustness } else { None };
    Simulation {
        trial: row.trial,
        number: row.number,
        seed: row.seed,
        unit_point: row.unit_point.clone(),
        scenario: row.initial_configuration.map(Some).to_vec(),
        robustness: row.robustness,
        robustness_low: bound,
        robustness_high: bound,
        stop_threshold: None,
        end,
        steps: row.steps,
        verdicts: row.verdicts.to_vec(),
        trace_digest: row.trace_digest,
        trace: None,
    }
}

#[test]
fn rows_of_many_pages_are_upgraded_bit_for_bit() {
    let (_folder, path) = copy();
    add(&path, (1..=1000).map(row));
    let run = RunFile::open(&path).unwrap();
    let mut count = 0;
    for (number, read) in (1..).zip(run.trial_simulations(3)) {
        // Debug output distinguishes -0.0 from 0.0, and every float from its neighbors.
        assert_eq!(format!("{:?}", read.unwrap()), format!("{:?}", upgraded(&row(number))));
        count += 1;
    }
    assert_eq!(count, 1000);
    assert_eq!(run.trial_simulations(1).count() + run.trial_simulations(2).count(), 5);
    run.check().unwrap();
}

#[test]
fn an_upgraded_run_has_the_tables_of_a_new_run_and_can_be_resumed() {
    let (_folder, path) = copy();
    let mut writer = RunWriter::resume(&path).unwrap();
    writer.start_trial(9, 9).unwrap();
    writer.record(&[Simulation { scenario: vec![None, Some(1.0)], ..record(9, 1) }]).unwrap();
    // The traces refer to the new table, so foreign keys are valid.
    assert!(matches!(writer.record(&[record(10, 1)]), Err(StoreError::UnknownTrial { trial: 10 })));
    writer.close().unwrap();
    RunFile::open(&path).unwrap().check().unwrap();
    let connection = Connection::open(&path).unwrap();
    let violations = connection.prepare("PRAGMA foreign_key_check").unwrap().exists([]).unwrap();
    assert!(!violations);

    let new_folder = tempfile::tempdir().unwrap();
    let new_path = new_folder.path().join("run.sqlite");
    RunWriter::create(&new_path, &header(), IfExists::Refuse).unwrap().close().unwrap();
    let tables = |connection: &Connection| -> Vec<String> {
        let sql = "SELECT sql FROM sqlite_schema WHERE type = 'table' ORDER BY name";
        let mut select = connection.prepare(sql).unwrap();
        select.query_map([], |row| row.get(0)).unwrap().map(Result::unwrap).collect()
    };
    assert_eq!(tables(&connection), tables(&Connection::open(&new_path).unwrap()));
}

#[test]
fn a_killed_run_is_upgraded_with_the_records_in_its_log() {
    let (_folder, path) = copy();
    let killed = path.with_file_name("killed.sqlite");
    let connection = Connection::open(&path).unwrap();
    connection.pragma_update(None, "journal_mode", "WAL").unwrap();
    // A reader, so that the log stays.
    connection.query_row("SELECT count(*) FROM trial", [], |_| Ok(())).unwrap();
    add(&path, (1..=3).map(row));
    std::fs::copy(&path, &killed).unwrap();
    std::fs::copy(path.with_file_name("run.sqlite-wal"), path.with_file_name("killed.sqlite-wal")).unwrap();
    drop(connection);
    let run = RunFile::open(&killed).unwrap();
    run.check().unwrap();
    assert_eq!(run.last_simulation_number(3).unwrap(), 3);
}

#[test]
fn a_damaged_file_is_an_error_and_left_unchanged() {
    let row_hash = "does not match its hash";
    for (sql, what) in [
        ("UPDATE simulation SET robustness = 0.5 WHERE number = 700", row_hash),
        (
            "UPDATE simulation SET unit_point = x'00' WHERE number = 700",
            "a list of doubles has a broken length",
        ),
        ("UPDATE simulation SET ended = 'horizon', end_step = NULL WHERE number = 701", row_hash),
        ("UPDATE simulation SET row_hash = 1 WHERE number = 702", row_hash),
        ("UPDATE trial SET seed = 5 WHERE number = 2", "trial 2: it does not match its hash"),
        ("UPDATE trial SET status = 'gone' WHERE number = 2", "trial 2: its status is unknown"),
        ("UPDATE header SET value = 'code?' WHERE key = 'preset'", "the header does not match its hash"),
        ("UPDATE axis SET high = 9.0 WHERE position = 1", "the header does not match its hash"),
        ("DELETE FROM header WHERE key = 'task'", "its header lacks `task`"),
        // These are found before the list is in memory.
        ("UPDATE axis SET unit = CAST(zeroblob(28 << 20) AS TEXT)", "its table axis is too large"),
        (
            "UPDATE signal SET name = name || CAST(zeroblob(7 << 20) AS TEXT)",
            "its table signal contains a name of 73400",
        ),
        ("CREATE TABLE trial_1 (x)", "it contains table trial_1, which this program did not create"),
        ("CREATE TRIGGER t AFTER DELETE ON trial BEGIN SELECT 1; END", "it contains trigger t"),
        ("DROP TABLE trace", "its table trace is missing or was changed"),
    ] {
        let (_folder, path) = copy();
        add(&path, (1..=800).map(row));
        Connection::open(&path).unwrap().execute_batch(sql).unwrap();
        let before = std::fs::read(&path).unwrap();
        let error = RunFile::open(&path).unwrap_err();
        let expected = matches!(error, StoreError::Damaged { .. }) && error.to_string().contains(what);
        assert!(expected, "{sql}: {error}");
        assert!(std::fs::read(&path).unwrap() == before, "{sql}");
    }
}

#[test]
fn a_damaged_file_of_version_2_is_an_error_and_left_unchanged() {
    for (sql, what) in [
        ("UPDATE simulation SET steps = 149 WHERE number = 6", "does not match its hash"),
        ("UPDATE simulation SET ended = 'invalid action' WHERE number = 5", "does not match its hash"),
        ("UPDATE trial SET seed = '5' WHERE number = 2", "trial 2: it does not match its hash"),
        ("UPDATE header SET value = 'x' WHERE key = 'formula'", "the header does not match its hash"),
        (
            "CREATE TABLE simulation_2 (x)",
            "it contains table simulation_2, which this program did not create",
        ),
        (
            "ALTER TABLE simulation ADD COLUMN end_index INTEGER",
            "its table simulation is missing or was changed",
        ),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.sqlite");
        std::fs::copy("tests/fixtures/v2.sqlite", &path).unwrap();
        Connection::open(&path).unwrap().execute_batch(sql).unwrap();
        let before = std::fs::read(&path).unwrap();
        let error = RunFile::open(&path).unwrap_err();
        let expected = matches!(error, StoreError::Damaged { .. }) && error.to_string().contains(what);
        assert!(expected, "{sql}: {error}");
        assert!(std::fs::read(&path).unwrap() == before, "{sql}");
    }
}
