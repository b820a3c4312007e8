//! One file for each command.

pub mod controller;
pub mod curve;
pub mod evaluate;
pub mod falsify;
pub mod monitor;
pub mod render;
pub mod replay;
pub mod tasks;
pub mod train;
