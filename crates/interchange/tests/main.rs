//! The tests of this package as one program, because linking takes longer than most of them.
//! A file of this folder is a module here.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod checkpoint;
mod chunks;
mod graph;
mod history;
mod images;
mod onnx;
mod operators;
#[path = "../../stl/tests/processor_time.rs"]
mod processor_time;
mod stable_baselines;
mod torch;
