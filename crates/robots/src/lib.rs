//! Robots that a file describes: `target.toml` names a MuJoCo model, start, actions, observation,
//! policy, signals, axes and formulas, and needs no code.
//!
//! [`RobotFile::read`] reads and checks a file; [`RobotFile::target`] makes a
//! [`Target`](mishandle_rollout::Target) of it and a controller. `document` is the tree of the
//! text, `description` what it says, `axis_table` what it says about axes, `axes`, `change` and
//! `events` what these axes set, `library` the names that its expressions may use, `phase` the
//! expressions that are evaluated together, `environment` the simulation, which `worker` runs in
//! the same engine as every task, `batch` many of its rows in another engine, `controlled` the
//! robot with a controller in the loop, `cameras` what its cameras see, and `training` what a
//! training run needs. `contract` checks
//! a policy before the first episode, and `init` writes a first file for a policy of another tool.
//! [`expression`] checks and evaluates expressions, and [`mjcf`] reads and edits the model as text.

mod axes;
mod axis_table;
mod batch;
mod cameras;
mod change;
mod contract;
mod controlled;
mod description;
mod document;
mod environment;
mod error;
mod events;
pub mod expression;
mod init;
mod inside;
mod library;
pub mod mjcf;
mod model;
mod pattern;
mod phase;
mod policy;
mod quantity;
mod target;
mod task_space;
mod training;
mod worker;

pub use crate::expression::functions;
pub use batch::RobotBatch;
pub use controlled::ControlledRobot;
pub use environment::RobotEnvironment;
pub use error::RobotError;
pub use init::{
    FirstFile, FirstPolicy, Measured, Paths, PolicyFacts, PolicySizes, first_file, isaac_facts, mjlab_facts,
};
pub use inside::check_inside;
pub use library::{QUANTITY_FUNCTIONS, QuantityFunction};
pub use target::{DeviceRobot, FILE_ROLES, KIND, RobotFile, RobotPolicy};
pub use training::{RobotBatches, RobotTraining};
