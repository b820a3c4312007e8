//! The tests of this package as one program, because linking takes longer than most of them.
//! A file of this folder is a module here.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

#[path = "../../rollout/tests/function_controller/mod.rs"]
mod function_controller;
mod known;
mod sequence;
mod sequences;
mod systems;
