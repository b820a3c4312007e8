//! The tests of this package as one program, because linking takes longer than most of them.
//! A file of this folder is a module here.

mod bounded;
mod mining;
mod patterns;
#[path = "../../stl/tests/processor_time.rs"]
mod processor_time;
mod templates;
mod traps;
