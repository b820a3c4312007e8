//! One file per command.

pub mod campaign;
pub mod compare;
pub mod completions;
pub mod controller;
pub mod counterexamples;
pub mod curve;
pub mod evaluate;
pub mod explain;
pub mod export;
pub mod falsify;
pub mod man;
pub mod margin;
pub mod monitor;
pub mod regress;
pub mod render;
pub mod replay;
pub mod report;
pub mod reproduce;
pub mod risk;
pub mod runs;
pub mod searches;
pub mod simulate;
pub mod targets;
pub mod tasks;
pub mod train;
