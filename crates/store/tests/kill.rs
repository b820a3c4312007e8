//! A process that is killed while it writes loses at most its current transaction.
//!
//! The test starts its own binary again and kills that process.
#![allow(clippy::unwrap_used)] // clippy does not count helper functions as tests

mod sample;

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

use mishandle_store::{IfExists, RunFile, RunWriter, StoreError};
use sample::{header, record, traced_record};

const BATCH: u32 = 8;
const RUN: &str = "MISHANDLE_STORE_TEST_RUN";

/// The process to be killed. It prints the number of recorded simulations after each batch. Without the environment
/// variable, as an ordinary test, it does nothing.
#[test]
fn writes_until_killed() {
    let Some(path) = std::env::var_os(RUN) else { return };
    let mut writer = match RunWriter::resume(&path) {
        Err(StoreError::Missing { .. }) => {
            let mut writer = RunWriter::create(&path, &header(), IfExists::Refuse).unwrap();
            writer.start_trial(1, 1).unwrap();
            writer
        }
        resumed => resumed.unwrap(),
    };
    let first = writer.file().last_simulation_number(1).unwrap() + 1;
    for first in (first..).step_by(BATCH as usize) {
        let records = (first..first + BATCH).map(|number| match number % BATCH {
            0 => traced_record(1, number),
            _ => record(1, number),
        });
        writer.record(&records.collect::<Vec<_>>()).unwrap();
        println!("\nrecorded {}", first + BATCH - 1);
    }
}

/// Starts the process, kills it after `batches` batches, and returns the last number that it printed.
fn run_and_kill(path: &Path, batches: usize) -> u32 {
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "writes_until_killed", "--nocapture"])
        .env(RUN, path)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap);
    let mut printed = lines.by_ref().filter_map(|line| line.strip_prefix("recorded ")?.parse().ok());
    let mut last = printed.nth(batches).unwrap();
    // SIGKILL on Unix, which a process cannot handle. Its output up to then is still in the pipe.
    child.kill().unwrap();
    last = printed.last().unwrap_or(last);
    child.wait().unwrap();
    last
}

#[test]
fn a_kill_loses_at_most_the_current_transaction() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    // Fibonacci numbers of batches: early kills, and kills after SQLite has moved the log into the file several times.
    for batches in [0, 1, 2, 3, 5, 8, 13, 21, 34, 55, 89, 144, 233] {
        let printed = run_and_kill(&path, batches);
        let run = RunFile::open(&path).unwrap();
        run.check().unwrap();
        let found = run.last_simulation_number(1).unwrap();
        assert!(found == printed || found == printed + BATCH, "printed {printed}, found {found}");
        assert_eq!(run.counts().unwrap().simulations, u64::from(found));
    }
    let run = RunFile::open(&path).unwrap();
    for simulation in run.simulations().map(Result::unwrap) {
        let number = simulation.number;
        let expected = if number % BATCH == 0 { traced_record(1, number) } else { record(1, number) };
        assert_eq!(run.simulation(1, number).unwrap(), expected);
    }
    // The next writer removes the log.
    drop(run);
    RunWriter::resume(&path).unwrap().close().unwrap();
    assert!(!folder.path().join("run.sqlite-wal").exists());
    RunFile::open(&path).unwrap().check().unwrap();
}
