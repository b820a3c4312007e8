//! The tests of this package as one program, because linking takes longer than most of them.
//! A file of this folder is a module here.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod bases;
mod environment_batch;
mod episodes;
#[path = "../../rollout/tests/function_controller/mod.rs"]
mod function_controller;
mod harness;
mod history;
mod keeper;
mod line;
mod off_policy;
mod off_policy_losses;
mod on_policy;
mod replay;
mod scenarios;
mod start;
mod std_floor;
mod toy;
