//! The tests of this package as one program, because linking takes longer than most of them.
//! A file of this folder is a module here.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod apart;
mod assets;
mod contacts;
mod containment;
mod field_changes;
mod files;
mod flex;
mod kinematics;
mod limits;
mod part_forces;
mod python;
mod sensing;
