//! The tests of this package as one program, because linking takes longer than most of them.
//! A file of this folder is a module here.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod altered_worlds;
mod ball_contact;
mod batch;
mod catch_contact;
mod cloth_contact;
mod cube_contact;
mod cube_stacking;
mod door_contact;
mod every_axis;
mod every_task;
mod faults;
mod frozen;
#[path = "../../rollout/tests/function_controller/mod.rs"]
mod function_controller;
mod manner;
mod manner_reward;
mod mistakes;
mod peg_contact;
mod posture;
mod seeing;
mod sight;
mod solver;
mod stepped;
mod takeover;
