//! An error of any single call to the file system loses no record and damages nothing, and the run
//! continues.
//!
//! A virtual file system returns an error from the n-th write, sync, truncation or other call, for
//! every n of a small run. `MISHANDLE_FAULTS=all` tries each with every reaction to the error.

use crate::faults;
use crate::own_process::own_process;
use std::collections::BTreeMap;
use std::ffi::c_int;

use crate::faults::failing::{FailingRun, Reaction};
use crate::faults::life::{Session, campaign};
use crate::faults::vfs::{self, Call, Fault};
use mishandle_store::{RunFile, StoreError};
use rusqlite::ffi;

const FAULTS: [(Call, c_int); 13] = [
    (Call::Write, ffi::SQLITE_IOERR_WRITE),
    (Call::Write, ffi::SQLITE_FULL),
    (Call::Sync, ffi::SQLITE_IOERR_FSYNC),
    (Call::Truncate, ffi::SQLITE_IOERR_TRUNCATE),
    (Call::Open, ffi::SQLITE_CANTOPEN),
    (Call::Delete, ffi::SQLITE_IOERR_DELETE),
    (Call::Access, ffi::SQLITE_IOERR_ACCESS),
    (Call::Read, ffi::SQLITE_IOERR_READ),
    (Call::FileSize, ffi::SQLITE_IOERR_FSTAT),
    (Call::Lock, ffi::SQLITE_IOERR_LOCK),
    (Call::ShmMap, ffi::SQLITE_IOERR_SHMMAP),
    (Call::ShmMap, ffi::SQLITE_IOERR_SHMSIZE),
    (Call::ShmLock, ffi::SQLITE_IOERR_SHMLOCK),
];

/// Whether the fault lasts, and the reaction to it.
const REACTIONS: [(bool, Reaction); 4] =
    [(false, Reaction::Retry), (true, Reaction::Resume), (true, Reaction::Retry), (false, Reaction::Resume)];

/// Lets each call of the run fail. Returns the number of failed steps by call and code.
fn fail_everywhere(run: &FailingRun) -> BTreeMap<(String, c_int), usize> {
    let mut totals = [0; FAULTS.len()];
    vfs::set_fault(None);
    run.perform(|_| totals = FAULTS.map(|(call, _)| vfs::calls(call)));
    let mut failed = BTreeMap::new();
    for (index, ((call, code), total)) in (0..).zip(FAULTS.into_iter().zip(totals)) {
        for nth in 1..=total {
            // A call that fails in two ways meets another reaction in each.
            let one = (nth as usize + index) % 2;
            let reactions = if faults::all() { &REACTIONS[..] } else { &REACTIONS[one..=one] };
            for &(lasts, reaction) in reactions {
                // Shown if the test fails.
                println!("{call:?} {nth} of {total}, code {code}, lasts: {lasts}, {reaction:?}");
                let fault = Fault { call, nth, lasts, code };
                let end_fault = || {
                    assert!(vfs::has_failed(), "the call did not happen");
                    vfs::set_fault(None);
                };
                let error = run.fail(0, || vfs::set_fault(Some(fault)), end_fault, reaction);
                if let Some(error) = error {
                    check_message(fault, &error);
                    *failed.entry((format!("{call:?}"), code)).or_default() += 1;
                }
            }
        }
    }
    failed
}

/// Checks that the error names the problem.
fn check_message(fault: Fault, error: &StoreError) {
    use StoreError::{CannotOpen, DiskFull, Io, NoRoom, NotClosed, Write};
    let is_right = match fault.code {
        ffi::SQLITE_FULL | ffi::SQLITE_IOERR_SHMSIZE => {
            matches!(error, DiskFull { .. } | NoRoom { .. })
        }
        ffi::SQLITE_CANTOPEN => {
            matches!(error, CannotOpen { .. } | NotClosed { .. })
        }
        ffi::SQLITE_IOERR_WRITE => matches!(error, Write { .. }),
        _ => matches!(error, Io { .. }),
    };
    assert!(is_right, "{fault:?}: {error}");
}

#[test]
fn no_failed_call_loses_a_record() {
    own_process("fault_io::no_failed_call_loses_a_record", || {
        let failed = fail_everywhere(&FailingRun::new(campaign(), None));
        // Failures of each kind reach the caller.
        assert_eq!(failed.len(), FAULTS.len(), "{failed:?}");
        let writes = failed[&("Write".to_owned(), ffi::SQLITE_FULL)];
        assert!(writes > 80, "{failed:?}");
    });
}

/// The integrity check of SQLite reports a page that it cannot read in the words of a damaged one.
#[test]
fn a_check_that_cannot_read_a_page_does_not_report_damage() {
    own_process("fault_io::a_check_that_cannot_read_a_page_does_not_report_damage", || {
        vfs::install();
        let folder = faults::folder();
        let path = folder.path().join("run.sqlite");
        let mut session = Session::new(&path, false);
        campaign().into_iter().for_each(|step| session.perform(step).unwrap());
        let run = RunFile::open(&path).unwrap();
        let mut failures = 0;
        for nth in 1.. {
            vfs::set_fault(Some(Fault { call: Call::Read, nth, lasts: false, code: ffi::SQLITE_IOERR_READ }));
            // The cache of another connection is empty.
            let checked = RunFile::open(&path).and_then(|run| run.check());
            let has_failed = vfs::has_failed();
            vfs::set_fault(None);
            if !has_failed {
                break;
            }
            // SQLite repeats some reads.
            if let Err(error) = checked {
                failures += 1;
                assert!(matches!(error, StoreError::Io { .. }), "read {nth}: {error}");
            }
        }
        assert!(failures > 5, "{failures}");
        run.check().unwrap();
    });
}
