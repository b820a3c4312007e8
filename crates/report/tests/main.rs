//! The tests of this package as one program, because linking takes longer than most of them.
//! A file of this folder is a module here.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod answers;
mod hardening;
mod kept;
mod page;

/// Names commands by their data.
fn data(command: &mishandle::results::Command) -> String {
    format!("{command:?}")
}
