//! Run files read with plain SQLite.

use std::path::{Path, PathBuf};

use crate::sample::{axis, header, record, traced_record};
use mishandle_store::{IfExists, RunFile, RunHeader, RunWriter, Simulation, StoreError, TrialStatus};
use rusqlite::Connection;
use rusqlite::types::Value;
use tempfile::TempDir;

/// Creates a run with these simulations, all in trial 1.
fn run_of(header: &RunHeader, simulations: &[Simulation]) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    let mut writer = RunWriter::create(&path, header, IfExists::Refuse).unwrap();
    writer.start_trial(1, u64::MAX).unwrap();
    writer.record(simulations).unwrap();
    writer.end_trial(1, TrialStatus::Falsified).unwrap();
    writer.start_trial(2, 0).unwrap();
    writer.close().unwrap();
    (folder, path)
}

/// Returns the rows of a query in the format of `sqlite3`.
fn query(path: &Path, sql: &str) -> Vec<String> {
    let connection = Connection::open(path).unwrap();
    let mut select = connection.prepare(sql).unwrap();
    let columns = select.column_count();
    let cell = |value| match value {
        Value::Null => String::new(),
        Value::Integer(integer) => integer.to_string(),
        Value::Real(real) => real.to_string(),
        Value::Text(text) => text,
        Value::Blob(blob) => format!("{} bytes", blob.len()),
    };
    let rows = select
        .query_map([], |row| {
            let cells: rusqlite::Result<Vec<String>> = (0..columns).map(|i| row.get(i).map(cell)).collect();
            Ok(cells?.join("|"))
        })
        .unwrap();
    rows.map(Result::unwrap).collect()
}

fn columns(path: &Path, view: &str) -> Vec<String> {
    let connection = Connection::open(path).unwrap();
    let select = connection.prepare(&format!("SELECT * FROM {view}")).unwrap();
    select.column_names().map(Into::into).collect()
}

fn with_robustness(number: u32, robustness: f64) -> Simulation {
    let robustness = Some(robustness);
    Simulation { robustness, robustness_low: robustness, robustness_high: robustness, ..record(1, number) }
}

#[test]
fn the_documented_queries_return_what_the_page_states() {
    let mut inside = with_robustness(1, 0.5);
    inside.end = mishandle_store::SimulationEnd::Completed;
    let mut outside = with_robustness(2, -0.25);
    outside.scenario = vec![Some(0.5), None];
    outside.end = mishandle_store::SimulationEnd::Stopped { step: 70 };
    let (_folder, path) =
        run_of(&header(), &[inside, outside, Simulation { robustness: None, ..record(1, 3) }]);

    let page = std::fs::read_to_string("../../docs/reference/run_file.md").unwrap();
    let queries: Vec<&str> =
        page.split("```sql\n").skip(1).map(|rest| rest.split("```").next().unwrap()).collect();
    let [worst, results, scenarios] = queries[..] else { panic!("{} queries", queries.len()) };
    assert_eq!(query(&path, worst), ["1|2|-0.25|stopped|70", "1|1|0.5|completed|"]);
    assert_eq!(query(&path, results), ["falsified|1|3|-0.25", "running|1|0|"]);
    assert_eq!(query(&path, scenarios), ["1|2|ball_x|0.5|m", "1|2|ball_velocity_x||m/s"]);

    // The page lists every table, view and column.
    let names = query(&path, "SELECT name FROM sqlite_schema WHERE sql IS NOT NULL");
    let header_keys = query(&path, "SELECT key FROM header");
    let tables = names.iter().flat_map(|name| columns(&path, name)).filter(|name| !name.starts_with("ball_"));
    let verdicts = header().verdicts;
    for name in names.iter().cloned().chain(header_keys).chain(tables) {
        assert!(verdicts.contains(&name) || page.contains(&format!("`{name}`")), "{name} is not documented");
    }
}

#[test]
fn a_row_is_readable_text() {
    let mut simulation = traced_record(1, 1);
    simulation.seed = u64::MAX;
    simulation.scenario = vec![Some(0.5), None];
    simulation.unit_point = vec![0.25, 1e-7];
    simulation.verdicts = vec![Some(f64::NEG_INFINITY), None];
    let digest = format!("{:032x}", simulation.trace_digest.unwrap());
    let (_folder, path) = run_of(&header(), &[simulation, Simulation { unit_point: vec![], ..record(1, 2) }]);
    let sql = "SELECT seed, scenario, unit_point, verdicts, trace_digest FROM simulation";
    assert_eq!(
        query(&path, sql)[0],
        format!(
            "18446744073709551615|{{\"ball_x\":0.5,\"ball_velocity_x\":null}}|[0.25,1e-7]|\
             {{\"strict_robustness\":\"-inf\",\"completion_step\":null}}|{digest}"
        )
    );
    assert_eq!(query(&path, "SELECT number FROM simulation WHERE unit_point IS NULL"), ["2"]);
    assert_eq!(
        query(&path, "SELECT seed, status FROM trials"),
        ["18446744073709551615|falsified", "0|running"]
    );
    // In the view an infinity is a number. As a string it would be greater than 0.
    let sql = "SELECT number, strict_robustness FROM simulations WHERE strict_robustness < -1000";
    assert_eq!(query(&path, sql), ["1|-inf"]);
}

#[test]
fn a_column_has_the_value_of_its_axis_for_every_axis_name() {
    let names = [
        "mass",
        "MASS",
        "seed",
        "robustness",
        "axis_seed",
        "a \"quoted\" name",
        "it's",
        "a\\b",
        "a.b[0]",
        "$",
        "",
        "tab\there",
        "ρ",
        "select",
        "x; DROP TABLE simulation",
    ];
    let axes: Vec<_> = names.iter().map(|name| axis(name, "", 0.0, 100.0)).collect();
    let verdicts = ["seed", "mass", "return"].map(String::from).to_vec();
    let header = RunHeader { axes, verdicts, ..header() };
    let scenario: Vec<_> = (10_u32..).take(names.len()).map(|value| Some(f64::from(value))).collect();
    let mut simulation = record(1, 1);
    simulation.unit_point.clear();
    simulation.verdicts = vec![Some(1.0), Some(2.0), Some(3.0)];
    let simulation = Simulation { scenario, ..simulation };
    let (_folder, path) = run_of(&header, std::slice::from_ref(&simulation));

    let columns = columns(&path, "simulations");
    assert_eq!(
        columns[13..],
        [
            "mass",
            "axis_MASS",
            "axis_seed",
            "axis_robustness",
            "axis_axis_seed",
            "a \"quoted\" name",
            "it's",
            "a\\b",
            "a.b[0]",
            "$",
            "",
            "tab\there",
            "ρ",
            "select",
            "x; DROP TABLE simulation",
            "verdict_seed",
            "verdict_mass",
            "return",
        ]
    );
    let row = query(&path, "SELECT * FROM simulations").remove(0);
    let values: Vec<&str> = row.split('|').skip(13).collect();
    let expected: Vec<String> = (10..10 + names.len()).chain(1..=3).map(|value| value.to_string()).collect();
    assert_eq!(values, expected);

    let run = RunFile::open(&path).unwrap();
    run.check().unwrap();
    assert_eq!(run.header(), &header);
    assert_eq!(run.simulation(1, 1).unwrap(), simulation);
}

#[test]
fn axes_beyond_the_column_limit_of_sqlite_are_recorded() {
    let axes: Vec<_> = (0..3000).map(|i| axis(&format!("x{i}"), "", 0.0, 1.0)).collect();
    let nul = axis("with a \0", "", 0.0, 1.0);
    let header = RunHeader { axes: [vec![nul], axes].concat(), verdicts: vec![], ..header() };
    let scenario: Vec<_> = (0..3001).map(|i| Some(f64::from(i) / 7.0)).collect();
    let simulation = Simulation { scenario, unit_point: vec![], verdicts: vec![], ..record(1, 1) };
    let (_folder, path) = run_of(&header, std::slice::from_ref(&simulation));
    assert_eq!(columns(&path, "simulations").len(), 1900);
    assert_eq!(query(&path, "SELECT x2 FROM simulations"), [(3.0_f64 / 7.0).to_string()]);
    assert_eq!(RunFile::open(&path).unwrap().simulation(1, 1).unwrap(), simulation);
}

#[track_caller]
fn check_damaged(sql: &str, what: &str) {
    let (_folder, path) = run_of(&header(), &[record(1, 1)]);
    Connection::open(&path).unwrap().execute_batch(sql).unwrap();
    let message = format!("the run file is damaged, restore it from a copy: {what}: {}", path.display());
    assert_eq!(RunFile::open(&path).unwrap_err().to_string(), message);
    let error = RunWriter::resume(&path).unwrap_err();
    assert!(matches!(error, StoreError::Damaged { .. }), "{error}");
}

#[test]
fn other_tables_views_indexes_and_triggers_are_reported_as_damage() {
    check_damaged("CREATE TABLE mine (x)", "it contains table mine, which this program did not create");
    check_damaged("CREATE VIEW mine AS SELECT 1", "it contains view mine, which this program did not create");
    check_damaged(
        "CREATE INDEX mine ON simulation (robustness)",
        "it contains index mine, which this program did not create",
    );
    check_damaged(
        "CREATE TRIGGER trial AFTER INSERT ON simulation BEGIN DELETE FROM trial; END",
        "it contains trigger trial, which this program did not create",
    );
    check_damaged("DROP VIEW trials", "its view trials is missing or was changed");
    check_damaged(
        "DROP VIEW simulations; CREATE VIEW simulations AS SELECT * FROM simulation",
        "its view simulations is missing or was changed",
    );
    check_damaged(
        "ALTER TABLE signal RENAME TO other; CREATE VIEW signal AS SELECT * FROM other",
        "its table signal is missing or was changed",
    );
    check_damaged("ALTER TABLE trace ADD COLUMN note TEXT", "its table trace is missing or was changed");
    check_damaged(
        "CREATE TABLE mine (x);
         PRAGMA writable_schema = on;
         UPDATE sqlite_schema SET name = 'sqlite_mine', tbl_name = 'sqlite_mine', sql = 'CREATE TABLE sqlite_mine (x)'
         WHERE name = 'mine'",
        "it contains table sqlite_mine, which this program did not create",
    );
    // SQLite's own statistics are allowed.
    let (_folder, path) = run_of(&header(), &[record(1, 1)]);
    Connection::open(&path).unwrap().execute_batch("ANALYZE").unwrap();
    RunFile::open(&path).unwrap().check().unwrap();
}

#[test]
fn rows_that_no_reader_would_see_are_damage() {
    let copy = |number: i64| {
        format!(
            "CREATE TEMP TABLE copy AS SELECT * FROM simulation; UPDATE copy SET number = {number};
             INSERT INTO simulation SELECT * FROM copy"
        )
    };
    let impossible = "a simulation or a trial has an impossible number";
    for number in [0, -1, 1 << 32] {
        check_damaged(&copy(number), impossible);
    }
    check_damaged("INSERT INTO trial VALUES (-1, '1', 'running', 0)", impossible);
    check_damaged(
        "PRAGMA foreign_keys = off; UPDATE simulation SET trial = 7",
        "a row of table `simulation` refers to a missing row of table `trial`",
    );
}

#[test]
fn a_changed_value_does_not_match_its_hash() {
    let changes = [
        "UPDATE simulation SET seed = '3'",
        "UPDATE simulation SET scenario = json_set(scenario, '$.ball_x', 0.5)",
        "UPDATE simulation SET unit_point = NULL",
        "UPDATE simulation SET robustness = 0.25",
        "UPDATE simulation SET robustness_low = 0.25",
        "UPDATE simulation SET robustness_high = 0.25",
        "UPDATE simulation SET stop_threshold = 0.25",
        "UPDATE simulation SET ended = 'completed', end_step = NULL",
        "UPDATE simulation SET ended = 'invalid signal', end_index = 0",
        "UPDATE simulation SET ended = 'invalid signal', end_index = 1",
        "UPDATE simulation SET end_step = end_step + 1",
        "UPDATE simulation SET steps = 7",
        "UPDATE simulation SET verdicts = json_set(verdicts, '$.strict_robustness', NULL)",
        "UPDATE simulation SET trace_digest = NULL",
        "UPDATE simulation SET number = 3",
        "UPDATE trial SET seed = '3'",
        "UPDATE trial SET status = 'converged'",
    ];
    for sql in changes {
        let (_folder, path) = run_of(&header(), &[record(1, 2)]);
        let connection = Connection::open(&path).unwrap();
        assert_ne!(connection.execute(sql, []).unwrap(), 0);
        let error = RunFile::open(&path).unwrap_err();
        assert!(error.to_string().contains("does not match its hash"), "{sql}: {error}");
        let error = RunWriter::resume(&path).unwrap_err();
        assert!(error.to_string().contains("does not match its hash"), "{sql}: {error}");
        // The check can be skipped; reading the row still fails.
        assert!(RunFile::open_unchecked(&path).unwrap().check().is_err());
    }
    for (table, column) in [
        ("header", "value"),
        ("version", "version"),
        ("component", "file_hash"),
        ("formula", "text"),
        ("signal", "unit"),
        ("axis", "nominal"),
        ("axis", "domain"),
        ("axis", "meaning"),
    ] {
        let (_folder, path) = run_of(&header(), &[]);
        let which = if table == "header" { "key = 'episode_steps'" } else { "position = 0" };
        let sql = format!("UPDATE {table} SET {column} = 9 WHERE {which}");
        assert_eq!(Connection::open(&path).unwrap().execute(&sql, []).unwrap(), 1);
        let error = RunFile::open(&path).unwrap_err();
        assert!(error.to_string().contains("the header does not match its hash"), "{sql}: {error}");
    }
}

#[test]
fn an_index_that_does_not_match_its_table_is_detected() {
    let (_folder, path) = run_of(&header(), &[record(1, 1), record(1, 2)]);
    // Changes the index of the primary key: simulation 2 gets the number 3.
    let connection = Connection::open(&path).unwrap();
    let root: u32 = connection
        .query_row(
            "SELECT rootpage FROM sqlite_schema WHERE name = 'sqlite_autoindex_simulation_1'",
            [],
            |row| row.get(0),
        )
        .unwrap();
    drop(connection);
    let mut bytes = std::fs::read(&path).unwrap();
    let page = &mut bytes[(root as usize - 1) * 4096..][..4096];
    // The keys (1, 1, 1) and (1, 2, 2), the second before the first: the length of the header, then
    // the types of the columns (9 is the constant 1, 1 is a byte), then the bytes.
    let key = [4, 9, 1, 1, 2, 2];
    let place = page.windows(key.len()).position(|window| window == key).unwrap();
    page[place + 4] = 3;
    std::fs::write(&path, bytes).unwrap();

    assert!(matches!(RunFile::open(&path), Err(StoreError::Damaged { .. })));
    let run = RunFile::open_unchecked(&path).unwrap();
    assert!(matches!(run.check(), Err(StoreError::Damaged { .. })));
    for number in [2, 3] {
        let read = run.simulation(1, number);
        let expected = matches!(read, Err(StoreError::Damaged { .. } | StoreError::UnknownSimulation { .. }));
        assert!(expected, "{number}: {read:?}");
    }
}

#[test]
fn another_text_of_the_same_value_is_damage() {
    for sql in [
        "UPDATE simulation SET seed = '+' || seed",
        "UPDATE simulation SET seed = '0' || seed",
        "UPDATE simulation SET scenario = ' ' || scenario",
        "UPDATE simulation SET verdicts = verdicts || ' '",
        "UPDATE simulation SET unit_point = '[ ' || substr(unit_point, 2)",
        "UPDATE simulation SET unit_point = CAST(x'ff' AS TEXT)",
        "UPDATE simulation SET trace_digest = upper(trace_digest)",
        "UPDATE trial SET seed = '+' || seed",
        "UPDATE header SET value = '+' || value WHERE key = 'seed'",
    ] {
        let simulation = Simulation { trace_digest: Some(0xabc), ..record(1, 1) };
        let (_folder, path) = run_of(&header(), &[simulation]);
        Connection::open(&path).unwrap().execute_batch(sql).unwrap();
        let error = RunFile::open(&path).expect_err(sql);
        assert!(matches!(error, StoreError::Damaged { .. }), "{sql}: {error}");
    }
}

#[test]
fn values_that_are_too_large_are_damage_and_are_not_read() {
    let mebibytes = |count: usize| format!("CAST(zeroblob({}) AS TEXT)", count << 20);
    for (sql, what) in [
        (format!("UPDATE simulation SET scenario = {}", mebibytes(9)), "a value is too large"),
        (format!("UPDATE simulation SET trace_digest = {}", mebibytes(9)), "a value is too large"),
        (
            format!("UPDATE header SET value = {} WHERE key = 'plan'", mebibytes(2)),
            "`plan` of its header has a wrong type or is too large",
        ),
        (format!("UPDATE axis SET meaning = {}", mebibytes(20)), "its table axis is too large"),
        (
            "WITH RECURSIVE n(x) AS (SELECT 10 UNION ALL SELECT x + 1 FROM n WHERE x < 200000)
             INSERT INTO verdict SELECT x, 'v' || x FROM n"
                .to_owned(),
            "its table verdict is too large",
        ),
        (
            "UPDATE signal SET name = CAST(zeroblob(5000) AS TEXT) WHERE position = 0".to_owned(),
            "its table signal contains a name of 5000 bytes",
        ),
        ("INSERT INTO header VALUES ('note', 1)".to_owned(), "its header has 19 keys instead of 18"),
        (
            "WITH RECURSIVE n(x) AS (SELECT 10 UNION ALL SELECT x + 1 FROM n WHERE x < 2100000)
             INSERT INTO trial SELECT x, '0', 'running', 0 FROM n"
                .to_owned(),
            "it has more than 1000000 trials",
        ),
    ] {
        let (_folder, path) = run_of(&header(), &[record(1, 1)]);
        Connection::open(&path).unwrap().execute_batch(&sql).unwrap();
        let error = RunFile::open(&path).unwrap_err().to_string();
        assert!(error.contains(what), "{what}: {error}");
    }
}
