//! A process that is killed while it writes loses at most the transaction in flight.
//!
//! The test starts its own binary again as the process to be killed.
#![allow(clippy::unwrap_used)] // what serves tests is a test

mod sample;

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

use mishandle_store::{IfExists, RunFile, RunWriter, StoreError};
use sample::{header, record, traced_record};

const BATCH: u32 = 8;
const RUN: &str = "MISHANDLE_STORE_TEST_RUN";

/// The process to be killed: it says after each batch how many simulations are recorded. Without the
/// variable, as one of the tests, it does nothing.
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
    let first = writer.file().last_number(1).unwrap() + 1;
    for first in (first..).step_by(BATCH as usize) {
        let records = (first..first + BATCH).map(|number| match number % BATCH {
            0 => traced_record(1, number),
            _ => record(1, number),
        });
        writer.record(&records.collect::<Vec<_>>()).unwrap();
        println!("\nrecorded {}", first + BATCH - 1);
    }
}

/// Starts the process, kills it after `batches` more of them, and gives back what it last said.
fn run_and_kill(path: &Path, batches: usize) -> u32 {
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "writes_until_killed", "--nocapture"])
        .env(RUN, path)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap);
    let mut said = lines.by_ref().filter_map(|line| line.strip_prefix("recorded ")?.parse().ok());
    let mut last = said.nth(batches).unwrap();
    // SIGKILL on Unix: the process has no say in it. What it said until then is still in the pipe.
    child.kill().unwrap();
    last = said.last().unwrap_or(last);
    child.wait().unwrap();
    last
}

#[test]
fn a_kill_loses_at_most_the_transaction_in_flight() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    // Fibonacci numbers of batches: killed early, and past several moves of the log into the file.
    for batches in [0, 1, 2, 3, 5, 8, 13, 21, 34, 55, 89, 144, 233] {
        let said = run_and_kill(&path, batches);
        let run = RunFile::open(&path).unwrap();
        run.check().unwrap();
        let found = run.last_number(1).unwrap();
        assert!(found == said || found == said + BATCH, "said {said}, found {found}");
        assert_eq!(run.counts().unwrap().simulations, u64::from(found));
    }
    let run = RunFile::open(&path).unwrap();
    for simulation in run.simulations().map(Result::unwrap) {
        let number = simulation.number;
        let expected = if number % BATCH == 0 { traced_record(1, number) } else { record(1, number) };
        assert_eq!(run.simulation(1, number).unwrap(), expected);
    }
    // The next writer tidies up.
    drop(run);
    RunWriter::resume(&path).unwrap().close().unwrap();
    assert!(!folder.path().join("run.sqlite-wal").exists());
    RunFile::open(&path).unwrap().check().unwrap();
}
