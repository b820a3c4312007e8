//! MuJoCo behind a small safe interface: a [`Model`] shared by all threads, a [`World`] for each of them.
//!
//! A simulation is a row of numbers, MuJoCo's full integration state. A [`World`] takes a row, steps it and gives it
//! back, with the same bits as any other world of the model would. Elements are found by name, once, when a task is
//! loaded; in a step they are plain indices.
//!
//! Units are SI, quaternions are (w, x, y, z), vectors and rotations are in the world frame, whose origin is the base
//! of the robot. This is the one crate with `unsafe` code; it knows no tasks.

mod change;
mod element;
mod error;
pub mod frame;
mod kinematics;
mod model;
mod render;
mod rows;
mod state;

pub use change::Change;
pub use element::{Actuator, Body, Equality, Flex, Joint, Mocap, Site};
pub use error::WorldError;
pub use kinematics::Arm;
pub use model::Model;
pub use render::{Renderer, Size, png};
pub use rows::Rows;
pub use state::World;

/// The robot: a Franka Emika Panda with its hand, as an MJCF document.
pub const PANDA: &str = include_str!("../assets/panda.xml");

/// Version of the MuJoCo library that is linked, for instance `3.17.0`.
pub fn mujoco_version() -> String {
    mujoco_rs::mujoco_version().to_string()
}
