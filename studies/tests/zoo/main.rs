//! The controllers that come with the repository: records, pages, the program, and the plan with a
//! runner that trains in no time.

#![allow(clippy::unwrap_used)]

mod pages;
mod plan;
mod program;
mod runner;
mod shipped;
