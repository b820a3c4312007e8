//! The tests of this package as one program, because linking takes longer than most of them.
//! A file of this folder is a module here.

#![allow(clippy::print_stdout, clippy::unwrap_used, reason = "a test may panic and print")]

mod bad_files;
mod export;
mod fault_io;
mod fault_memory;
mod faults;
mod findings;
mod fixture;
mod kill;
mod memory;
mod own_process;
mod plain_sqlite;
mod power_cut;
mod read_only;
mod reasons;
mod run_file;
mod sample;
mod steered;
