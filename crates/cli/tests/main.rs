//! The tests of this package as one program, because linking takes longer than most of them.
//! A file of this folder is a module here.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod axes;
mod bench;
mod bisect;
mod calls;
#[path = "../../../tests/cart_pole/mod.rs"]
mod cart_pole;
mod check;
mod compare;
mod counterexamples;
mod evidence;
mod evidence_law;
mod evidence_limits;
mod exact;
mod explain;
mod firefox;
mod follow;
mod formula;
#[path = "../../interchange/tests/graph/mod.rs"]
mod graph;
mod guards;
mod hostile_models;
mod interrupt;
mod invalid_action;
mod json;
mod keys;
mod logs;
mod margin;
mod messages;
mod metamorphic;
mod program;
mod render;
mod replay_page;
mod report;
mod report_browser;
mod risk;
mod robots_guide;
mod run;
mod runs;
mod security;
mod seeing;
mod settings;
mod signatures;
mod simulate;
mod simulators;
mod simulators_guide;
mod target;
mod terminal;
mod train;
mod train_failures;
mod training;
mod vacuous;
mod verdict_lines;
mod verdicts;
mod view;
