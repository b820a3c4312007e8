//! The tests of this package as one program, because linking takes longer than most of them.
//! A file of this folder is a module here.

#![allow(clippy::print_stdout, clippy::unwrap_used, reason = "a test may panic and print")]

#[path = "../crates/tasks/tests/altered_worlds/mod.rs"]
mod altered_worlds;
mod bisect;
mod bits;
mod cart_pole;
mod check;
mod compare_memory;
mod compare_page;
#[path = "../examples/your_task/cube_flipping.rs"]
mod cube_flipping;
mod early_stopping;
mod files_equal_tasks;
mod forged_runs;
#[path = "../crates/rollout/tests/function_controller/mod.rs"]
mod function_controller;
#[path = "../crates/interchange/tests/graph/mod.rs"]
mod graph;
mod guard_tune;
mod harden;
mod harden_trainer;
mod hardening;
mod isolation;
mod keep_going;
mod library_page;
mod manner;
#[path = "../crates/store/tests/own_process.rs"]
mod own_process;
mod physics;
mod policy_view;
mod questions;
mod record;
mod robot_scene;
mod screening;
mod seeing;
mod sequential;
mod shipped;
mod silent;
mod target_file;
mod target_files_page;
mod tasks_as_files;
mod train_device;
mod train_robot;
mod train_scenarios;
mod train_start;
mod trajectory;
mod variant;
mod verdicts;
mod your_task;
