//! Simulators that are programs: they read questions as lines of JSON and write answers, in any
//! language. `docs/reference/simulator_protocol.md` describes the protocol.
//!
//! A [`Simulator`] is a command that has described itself, with its running processes. [`target`]
//! makes a target of it: its system simulates a batch on all threads, each with a process of its
//! own that lives on for the next batch. In the mode [`Mode::Step`], a controller acts between the
//! answers, with the delays, errors of sensors and faults of [`ControlLoop`].
//!
//! A [`ProgramPolicy`] is a controller that is a program, in the loop of any environment. A
//! [`SimulatorFile`] names a command, a time limit and a policy.
//!
//! [`check`](check()) asks a simulator questions whose right answers are known, as a test suite.
//!
//! A program can do anything at any time. Each failure ends the simulation, never with a verdict,
//! and replaces the process; no answer is taken for that to another question.
//! [`process`] runs the programs, also programs that answer once.
//!
//! [`ControlLoop`]: mishandle_rollout::ControlLoop

mod answer;
mod check;
mod description;
mod error;
mod file;
mod hello;
mod policy;
pub mod process;
mod program;
mod question;
mod simulator;
mod steps;
mod system;
mod target;
mod words;
mod worker;

pub use check::check;
pub use description::Description;
pub use error::SimulatorError;
pub use file::{FilePolicy, SimulatorFile};
pub use hello::{Mode, PROTOCOL};
pub use policy::{ProgramPolicy, ProgramSettings};
pub use program::program;
pub use simulator::Simulator;
pub use target::{IdentifiedController, KIND, SIMULATOR, target};
