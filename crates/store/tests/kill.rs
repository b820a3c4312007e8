//! A process that is killed loses at most its current transaction.
//!
//! The test starts its own binary again and kills that process.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::sample::{header, record, traced_record};
use mishandle_random::Sequence;
use mishandle_store::{IfExists, RunFile, RunWriter, Simulation, StoreError, TrialStatus};

const BATCH: u32 = 8;
const RUN: &str = "MISHANDLE_STORE_TEST_RUN";
const LIFE: &str = "MISHANDLE_STORE_TEST_LIFE";

/// The process to be killed. It prints the number of recorded simulations after each batch. Without
/// the environment variable, as an ordinary test, it does nothing.
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

/// Starts the process, kills it after `batches` batches, and returns the last number that it
/// printed.
fn run_and_kill(path: &Path, batches: usize) -> u32 {
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "kill::writes_until_killed", "--nocapture"])
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
    // Fibonacci numbers of batches: early kills, and kills after SQLite has moved the log into the
    // file several times.
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

/// Number of calls of a trial: its start, six batches of four simulations, and its end.
const CALLS: u32 = 8;

/// The process to be killed at any moment. It creates or resumes the run, closes and resumes it
/// after each trial, and prints the number of calls that have returned. Without the environment
/// variable, as an ordinary test, it does nothing.
#[test]
fn lives_until_killed() {
    let Some(path) = std::env::var_os(LIFE) else { return };
    println!("\nstarted");
    let mut writer = match RunWriter::resume(&path) {
        // The process was killed before the run was complete.
        Err(StoreError::Missing { .. } | StoreError::Unfinished { .. }) => {
            RunWriter::create(&path, &header(), IfExists::Replace).unwrap()
        }
        resumed => resumed.unwrap(),
    };
    for call in calls(writer.file()).. {
        println!("\nreturned {call}");
        let trial = call / CALLS + 1;
        let call = call % CALLS;
        match call {
            0 => writer.start_trial(trial, u64::from(trial)).unwrap(),
            7 => {
                writer.end_trial(trial, TrialStatus::BudgetSpent).unwrap();
                writer.close().unwrap();
                writer = RunWriter::resume(&path).unwrap();
            }
            batch => {
                let first = 4 * (batch - 1) + 1;
                let records: Vec<_> = (first..first + 4).map(|number| simulation(trial, number)).collect();
                writer.record(&records).unwrap();
            }
        }
    }
}

fn simulation(trial: u32, number: u32) -> Simulation {
    if number.is_multiple_of(4) { traced_record(trial, number) } else { record(trial, number) }
}

/// Returns the number of calls whose records a run contains, and checks all records.
fn calls(run: &RunFile) -> u32 {
    run.check().unwrap();
    let trials = run.trials().unwrap();
    let Some(last) = trials.last() else { return 0 };
    for (expected, trial) in (1..).zip(&trials) {
        let number = trial.trial.number;
        assert_eq!((number, trial.trial.seed), (expected, u64::from(expected)));
        let is_last = number == last.trial.number;
        assert!(is_last || trial.trial.status == TrialStatus::BudgetSpent);
        let recorded: Vec<_> = run.trial_simulations(number).map(Result::unwrap).collect();
        let expected = (1..=recorded.len() as u32)
            .map(|simulation_number| Simulation { trace: None, ..simulation(number, simulation_number) });
        assert!(recorded.iter().cloned().eq(expected), "trial {number} has other rows");
        assert!(is_last || recorded.len() == 24);
    }
    let batches = last.counts.simulations as u32 / 4;
    CALLS * (last.trial.number - 1) + 1 + batches + u32::from(last.trial.status != TrialStatus::Running)
}

#[test]
fn a_kill_at_a_random_moment_loses_no_committed_row() {
    let end = Instant::now() + Duration::from_secs(4);
    let mut random = Sequence::new(1, 0);
    let mut kills = 0;
    while Instant::now() < end && kills < 200 {
        // A new run: its creation can be killed, too.
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.sqlite");
        let mut before = 0;
        for longest in [1_000, 3_000, 10_000, 30_000] {
            let moment = Duration::from_micros(random.below(longest));
            let returned = kill_after(&path, moment);
            kills += 1;
            match RunFile::open(&path) {
                Ok(run) => {
                    // A process that was killed while it resumed the run printed no number.
                    let found = calls(&run);
                    let returned = returned.unwrap_or(before);
                    assert!(found == returned || found == returned + 1, "{returned} calls, found {found}");
                    before = found;
                }
                Err(StoreError::Missing { .. } | StoreError::Unfinished { .. }) if returned.is_none() => {}
                Err(error) => {
                    panic!("killed {moment:?} after its start, {returned:?} calls returned: {error}")
                }
            }
        }
        if let Ok(writer) = RunWriter::resume(&path) {
            writer.close().unwrap();
        }
    }
    println!("{kills} kills");
}

/// Starts the process, kills it some time after it has started, and returns the number of calls
/// that it printed.
fn kill_after(path: &Path, moment: Duration) -> Option<u32> {
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "kill::lives_until_killed", "--nocapture"])
        .env(LIFE, path)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap);
    assert!(lines.by_ref().any(|line| line == "started"));
    std::thread::sleep(moment);
    child.kill().unwrap();
    let returned = lines.filter_map(|line| line.strip_prefix("returned ")?.parse().ok()).last();
    let status = child.wait().unwrap();
    assert_eq!(status.code(), None, "the process ended before it was killed");
    returned
}
