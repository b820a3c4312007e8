//! Reasons of the ends of simulations.

use crate::sample::{header, record};
use mishandle_store::{EndReasons, IfExists, RunFile, RunWriter, Simulation, SimulationEnd, StoreError};
use rusqlite::Connection;
use tempfile::TempDir;

fn crashed(number: u32, reason: &str) -> Simulation {
    let end = SimulationEnd::Crashed { step: 1 };
    let simulation = Simulation { end, robustness: None, reason: reason.into(), ..record(1, number) };
    Simulation { robustness_low: None, robustness_high: None, ..simulation }
}

fn run(simulations: &[Simulation]) -> (TempDir, std::path::PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    let mut writer = RunWriter::create(&path, &header(), IfExists::Refuse).unwrap();
    writer.start_trial(1, 11).unwrap();
    writer.record(simulations).unwrap();
    writer.close().unwrap();
    (folder, path)
}

#[test]
fn a_reason_is_read_back_with_its_simulation_and_by_end() {
    let timed_out =
        Simulation { end: SimulationEnd::TimedOut { step: 2 }, ..crashed(4, "no answer within 60 s") };
    let rows = [record(1, 1), crashed(2, "no license\n\u{1b}[2J"), crashed(3, "another"), timed_out];
    let (_folder, path) = run(&rows);
    let run = RunFile::open(path).unwrap();
    run.check().unwrap();
    assert_eq!(run.simulation(1, 1).unwrap().reason, "");
    assert_eq!(run.simulation(1, 2).unwrap().reason, "no license\n\u{1b}[2J");
    let of = |end: &str, simulations, number, reason: &str| EndReasons {
        end: end.into(),
        simulations,
        trial: 1,
        number,
        reason: reason.into(),
    };
    let expected =
        [of("crashed", 2, 2, "no license\n\u{1b}[2J"), of("timed out", 1, 4, "no answer within 60 s")];
    assert_eq!(run.reasons().unwrap(), expected);
}

#[test]
fn a_run_without_reasons_has_the_tables_of_before_and_reasons_change_no_digest() {
    let (_folder, with) = run(&[crashed(1, "a reason")]);
    let (_other, without) = run(&[crashed(1, "")]);
    let tables = |path: &std::path::Path| -> i64 {
        let sql = "SELECT count(*) FROM sqlite_schema WHERE name = 'reason'";
        Connection::open(path).unwrap().query_row(sql, [], |row| row.get(0)).unwrap()
    };
    assert_eq!([tables(&with), tables(&without)], [1, 0]);
    let digest = |path| RunFile::open(path).unwrap().content_digest().unwrap();
    assert_eq!(digest(&with), digest(&without));
    assert!(RunFile::open(&without).unwrap().reasons().unwrap().is_empty());
}

#[test]
fn a_long_reason_is_cut_at_a_character() {
    let (_folder, path) = run(&[crashed(1, &"ä\0".repeat(5000))]);
    let reason = RunFile::open(path).unwrap().simulation(1, 1).unwrap().reason;
    assert!(reason.len() <= 4096 && reason.starts_with("ä\u{fffd}ä"));
}

#[test]
fn a_changed_reason_is_damage() {
    let (_folder, path) = run(&[crashed(1, "no license")]);
    let connection = Connection::open(&path).unwrap();
    connection.execute("UPDATE reason SET text = 'no reason'", []).unwrap();
    drop(connection);
    assert!(matches!(RunFile::open(path), Err(StoreError::Damaged { .. })));
}
