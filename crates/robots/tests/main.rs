//! The tests of this package as one program, because linking takes longer than most of them.
//! A file of this folder is a module here.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod cameras;
mod cartpole;
mod contract;
mod events;
mod expression;
mod first_file;
mod first_file_models;
#[path = "../../rollout/tests/function_controller/mod.rs"]
mod function_controller;
mod mjcf_edit;
mod mjcf_read;
mod names;
mod noise;
mod program;
mod screening;
mod solver;
mod start;
