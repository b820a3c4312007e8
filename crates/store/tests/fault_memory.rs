//! A failed allocation of SQLite loses no record and damages nothing, and the run continues.
//!
//! `MISHANDLE_FAULTS=all` fails every allocation of each step; otherwise some are left out.

use crate::faults;
use crate::faults::failing::{FailingRun, Reaction, is_out_of_memory};
use crate::faults::life::{Content, Session, Step, continuation};
use crate::faults::{memory, vfs};
use crate::own_process::own_process;

/// Lets about `tried` allocations of step `number` fail. Returns the number of failures, and of
/// errors.
fn fail_everywhere(run: &FailingRun, number: usize, tried: u64) -> (u64, u64) {
    let mut total = 0;
    run.perform(|next| {
        if next == number + 1 {
            total = memory::allocations();
        }
        memory::fail(0, false);
    });
    let stride = if faults::all() { 1 } else { total.div_ceil(tried) };
    let mut errors = 0;
    // The first allocations of every step, and then every `stride`-th one, from another one in each
    // step.
    let chosen = (1..=total).filter(|nth| *nth <= 10 || nth % stride == number as u64 % stride);
    let chosen: Vec<u64> = chosen.collect();
    for &nth in &chosen {
        let lasts = nth % 2 == 0;
        let reaction = if nth % 4 < 2 { Reaction::Retry } else { Reaction::Resume };
        // Shown if the test fails.
        println!("{:?}, allocation {nth} of {total}, lasts: {lasts}, {reaction:?}", run.steps[number]);
        let error = run.fail(number, || memory::fail(nth, lasts), || memory::fail(0, false), reaction);
        if let Some(error) = error {
            errors += 1;
            assert!(is_out_of_memory(&error), "{error}");
        }
    }
    (chosen.len() as u64, errors)
}

fn install() {
    memory::install();
    vfs::install();
}

#[test]
fn a_failed_allocation_during_creation_leaves_no_file() {
    own_process("fault_memory::a_failed_allocation_during_creation_leaves_no_file", || {
        install();
        let run = FailingRun::new(vec![Step::Create, Step::Close], None);
        let (failures, errors) = fail_everywhere(&run, 0, 100);
        assert!(errors > failures / 2, "{errors} errors after {failures} failures");
    });
}

#[test]
fn a_failed_allocation_loses_no_record() {
    own_process("fault_memory::a_failed_allocation_loses_no_record", || {
        install();
        let folder = faults::folder();
        let path = folder.path().join("run.sqlite");
        let mut session = Session::new(&path, false);
        for step in [
            Step::Create,
            Step::Start { trial: 1 },
            Step::Record { trial: 1, first: 1, last: 3 },
            Step::Close,
        ] {
            session.perform(step).unwrap();
        }
        let run = FailingRun::new(continuation(), Some(&path));
        for number in 0..run.steps.len() {
            let (failures, errors) = fail_everywhere(&run, number, 60);
            assert!(errors > failures / 2, "{errors} errors after {failures} failures");
        }
    });
}

/// If memory is still exhausted, SQLite cannot roll back the rows of the failed call at once. They
/// must not be part of the next transaction.
#[test]
fn a_failed_rollback_is_repeated_before_the_next_transaction() {
    own_process("fault_memory::a_failed_rollback_is_repeated_before_the_next_transaction", || {
        install();
        let folder = faults::folder();
        let path = folder.path().join("run.sqlite");
        let mut session = Session::new(&path, false);
        session.perform(Step::Create).unwrap();
        session.perform(Step::Start { trial: 1 }).unwrap();
        let mut nth = 0;
        let mut errors = 0;
        loop {
            nth += 1;
            let first = 3 * nth - 2;
            let last = 3 * nth;
            memory::fail(u64::from(nth), true);
            let failed = session.perform(Step::Record { trial: 1, first, last });
            memory::fail(0, false);
            let Err(error) = failed else { break };
            errors += 1;
            // Another record: the failed ones must not appear with it.
            session.perform(Step::Start { trial: nth + 1 }).unwrap();
            let found = Content::read(&path).unwrap();
            let of_failed = found.simulations.iter().filter(|row| row.number >= first).count();
            // The commit itself can succeed and be reported as an error.
            assert!(of_failed == 0 || of_failed == 3, "allocation {nth}: {of_failed} of 3 rows: {error}");
        }
        assert!(errors > 10, "{errors}");
    });
}
