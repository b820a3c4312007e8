//! Run files with changed bytes and pages.

use std::path::Path;
use std::sync::LazyLock;

use mishandle::store::{RunFile, RunHeader, Simulation, StoredTrace, TrialRecord, export_csv};

use crate::bytes::Bytes;
use crate::run;
use crate::scratch::Scratch;

/// SQLite's default page size, bytes.
const PAGE: usize = 4096;

/// A run as files, and its records.
struct Original {
    /// Bytes of the database, then those of its write-ahead log.
    files: Vec<u8>,
    /// Length of the database.
    database: usize,
    header: RunHeader,
    trials: Vec<TrialRecord>,
    simulations: Vec<Simulation>,
}

/// A closed run, and a run whose writer was killed.
static ORIGINALS: LazyLock<[Original; 2]> = LazyLock::new(|| {
    let scratch = Scratch::new();
    let closed = scratch.path("closed.sqlite");
    run::write(&closed).close().expect("a complete run");
    let open = scratch.path("open.sqlite");
    let writer = run::write(&open);
    let originals = [
        Original::of(&scratch, &read(&closed), &[]),
        Original::of(&scratch, &read(&open), &read(&scratch.path("open.sqlite-wal"))),
    ];
    drop(writer);
    originals
});

fn read(path: &Path) -> Vec<u8> {
    std::fs::read(path).expect("the file was written")
}

impl Original {
    fn of(scratch: &Scratch, database: &[u8], log: &[u8]) -> Original {
        let path = scratch.file("copy.sqlite", database);
        std::fs::write(scratch.path("copy.sqlite-wal"), log).expect("room for a temporary file");
        let run = RunFile::open(&path).expect("a valid run");
        run.check().expect("a valid run");
        let trials = run.trials().expect("a valid run").iter().map(|summary| summary.trial).collect();
        let numbers = run.simulations().map(|row| row.map(|row| (row.trial, row.number)));
        let numbers: Vec<(u32, u32)> = numbers.collect::<Result<_, _>>().expect("a valid run");
        let simulations = numbers.iter().map(|(trial, number)| run.simulation(*trial, *number));
        Original {
            files: [database, log].concat(),
            database: database.len(),
            header: run.header().clone(),
            trials,
            simulations: simulations.collect::<Result<_, _>>().expect("a valid run"),
        }
    }

    fn simulation(&self, trial: u32, number: u32) -> &Simulation {
        let is_it = |row: &&Simulation| (row.trial, row.number) == (trial, number);
        self.simulations.iter().find(is_it).unwrap_or_else(|| panic!("simulation {number} of trial {trial}"))
    }
}

/// Checks what a reader gets from a run whose bytes were changed at random. The first byte selects
/// the run, the rest are changes:
/// - the file is an error, or has the original header;
/// - every trial, simulation and trace that is read without an error has the bits of the original
///   with its numbers. Records can be missing;
/// - if [`RunFile::check`] accepts the file, no record is missing, except that a run that was not
///   closed can lose its last records.
pub fn check(bytes: &[u8]) {
    let mut bytes = Bytes(bytes);
    let which = bytes.below(ORIGINALS.len());
    let original = &ORIGINALS[which];
    let mut files = original.files.clone();
    for _ in 0..32 {
        if bytes.is_empty() {
            break;
        }
        change(&mut files, &mut bytes);
    }
    let (database, log) = files.split_at(original.database.min(files.len()));
    let scratch = Scratch::new();
    let path = scratch.file("run.sqlite", database);
    if !log.is_empty() {
        scratch.file("run.sqlite-wal", log);
    }
    match RunFile::open(&path) {
        Ok(run) => check_records(&run, original, which == 1),
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

fn check_records(run: &RunFile, original: &Original, can_lose_last: bool) {
    assert_eq!(text(run.header()), text(&original.header));
    let trials: Option<Vec<TrialRecord>> =
        run.trials().ok().map(|trials| trials.iter().map(|summary| summary.trial).collect());
    for trial in trials.iter().flatten() {
        let is_running = |known: &&TrialRecord| known.number == trial.number && known.seed == trial.seed;
        let known = original.trials.iter().find(is_running).expect("a trial of the run");
        assert!(trial == known || can_lose_last, "{trial:?}");
    }
    let rows: Result<Vec<Simulation>, _> = run.simulations().collect();
    for row in rows.iter().flatten() {
        let known = Simulation { trace: None, ..original.simulation(row.trial, row.number).clone() };
        assert_eq!(text(row), text(&known));
    }
    for known in &original.simulations {
        if let Ok(row) = run.simulation(known.trial, known.number) {
            let is_same =
                row.trace.is_none() || row.trace.as_ref().map(StoredTrace::digest) == known.trace_digest;
            assert!(is_same, "the trace of {row:?}");
            assert_eq!(
                text(&Simulation { trace: None, ..row }),
                text(&Simulation { trace: None, ..known.clone() })
            );
        }
    }
    // These must not panic. What they return is derived from the records above.
    let _ = (run.counts(), run.content_digest(), run.last_simulation_number(1));
    let _ = export_csv(run, &mut Vec::new());
    if run.check().is_err() {
        return;
    }
    let trials = trials.expect("checked");
    let rows = rows.expect("checked");
    let traces = run.stored_traces().expect("checked");
    let expected = original.simulations.iter().filter(|row| row.trace.is_some());
    let expected: Vec<(u32, u32)> = expected.map(|row| (row.trial, row.number)).collect();
    if can_lose_last {
        assert!(trials.len() <= original.trials.len());
        let is_prefix =
            rows.iter().zip(&original.simulations).all(|(a, b)| (a.trial, a.number) == (b.trial, b.number));
        assert!(is_prefix && expected.starts_with(&traces), "{rows:?}");
    } else {
        assert_eq!(
            (trials, rows.len(), traces),
            (original.trials.clone(), original.simulations.len(), expected)
        );
    }
}

/// Returns a text that differs for -0.0 and 0.0, which compare as equal.
fn text(value: &impl std::fmt::Debug) -> String {
    format!("{value:?}")
}

/// Changes the files.
fn change(files: &mut Vec<u8>, bytes: &mut Bytes<'_>) {
    let kind = bytes.below(7);
    let length = files.len();
    let pages = files.len() / PAGE;
    if pages == 0 {
        return;
    }
    match kind {
        // Overwrites up to 16 bytes.
        0 | 1 => {
            let at = bytes.wide() % length;
            for place in files[at..].iter_mut().take(1 + bytes.below(16)) {
                *place = bytes.next();
            }
        }
        2 => {
            let at = bytes.wide() % length;
            files[at] ^= 1 << bytes.below(8);
        }
        // Copies up to a page, for instance a whole row.
        3 => {
            let from = bytes.wide() % length;
            let to = bytes.wide() % length;
            let count = 1 + bytes.wide() % PAGE;
            let count = count.min(length - from).min(length - to);
            files.copy_within(from..from + count, to);
        }
        4 => {
            let one = bytes.below(pages.min(256)) * PAGE;
            let other = bytes.below(pages.min(256)) * PAGE;
            for offset in 0..PAGE {
                files.swap(one + offset, other + offset);
            }
        }
        5 => {
            let at = bytes.below(pages.min(256)) * PAGE;
            files[at..at + PAGE].fill(bytes.next());
        }
        _ => files.truncate(bytes.wide() % length),
    }
}

pub fn seeds() -> Vec<Vec<u8>> {
    let mut seeds: Vec<Vec<u8>> = (0..2).map(|which| vec![which]).collect();
    for (which, original) in (0_u8..).zip(&*ORIGINALS) {
        let [_, high, middle, low] = ((original.files.len() / 2) as u32).to_be_bytes();
        seeds.push(vec![which, 2, high, middle, low, 5]); // one bit
        seeds.push(vec![which, 0, 0, 0, 28, 3, 0, 0, 0, 1]); // the size in the header
        seeds.push(vec![which, 4, 2, 3]); // two pages
        seeds.push(vec![which, 5, 1, 0]); // a page of zeros
        seeds.push(vec![which, 6, high, middle, low]); // half of the file
        seeds.push(vec![which, 3, 0, 16, 0, high, middle, low, 0, 2, 0]); // 513 bytes elsewhere
    }
    seeds
}
