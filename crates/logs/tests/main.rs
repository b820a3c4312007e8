//! The tests of this package as one program, because linking takes longer than most of them.
//! A file of this folder is a module here.

mod choices;
mod csv;
mod follow;
mod formats;
mod memory;
#[path = "../../stl/tests/processor_time.rs"]
mod processor_time;
mod verdicts;

use mishandle_logs::LogError;
use mishandle_results::Key;

/// Returns whether a choice is missing and a remedy has this setting.
fn names(error: &LogError, key: Key) -> bool {
    error.is_undecided() && error.remedies().iter().any(|remedy| remedy.keys().contains(&key))
}
