//! A safe interface to the physics engine MuJoCo: a [`Model`] shared by all threads, and a
//! [`World`] per thread.
//!
//! The state of a simulation is a vector of numbers, MuJoCo's full integration state. A [`World`]
//! loads a state, takes physics steps and returns the new state. All worlds of a model give the
//! same bits. Bodies, joints and other elements are looked up by name once, when a task is loaded,
//! and are then plain indices.
//!
//! A [`WorldBatch`] steps many worlds together, one per row. A [`WorldDevice`] makes it:
//! [`CpuDevice`], or another physics engine that reads the same MJCF document. A [`Probe`] names
//! the elements whose forces and motion are measured over the physics steps.
//!
//! [`Model::from_untrusted`] compiles a model of others after a child process has tried it.
//!
//! Units are SI, quaternions are (w, x, y, z), vectors and rotations are in the world frame, whose
//! origin is the base of the robot. This is the only crate with `unsafe` code. It knows no tasks.
//!
//! # Reference
//! Todorov, Erez and Tassa, "MuJoCo: A physics engine for model-based control", IROS 2012.

mod actuated;
mod batch;
mod change;
mod compile;
mod contacts;
mod containment;
mod coordinates;
mod element;
mod error;
mod field_change;
mod fields;
mod files;
pub mod frame;
mod full_state;
mod kinematics;
mod lookup;
mod model;
mod part_forces;
mod pending;
mod probe;
mod render;
mod rows;
mod sensing;
mod servo;
mod shapes;
mod solver;
mod state;
mod structure;

pub use batch::{
    BatchBuffers, BatchLayout, BatchSpec, CpuDevice, CpuWorlds, Outputs, RowStatus, WorldBatch, WorldDevice,
};
pub use change::{Change, FieldOperation};
pub use compile::{Visuals, mjcf_of_urdf, with_elements};
pub use contacts::ContactParts;
pub use containment::{
    CHILD_WORD, Opened, files_of_untrusted, mjcf_of_untrusted_urdf, run_child, set_child_program,
};
pub use coordinates::Coordinate;
pub use element::{Actuator, Body, ElementKind, Equality, Flex, Joint, JointKind, Mocap, Site};
pub use error::WorldError;
pub use fields::ModelField;
pub use files::{Assets, Open};
pub use full_state::{FullState, RowWorlds};
pub use kinematics::Arm;
pub use model::Model;
pub use part_forces::{Part, PartForces, PartMap};
pub use pending::{PendingRows, split_rows};
pub use probe::{FORCES, Probe, ProbeRecorder, ProbedJoint, Readings};
pub use render::{
    Arrow, CAMERAS, Caption, CaptionLayout, CaptionPart, Color, Picture, PictureModel, Quality, Renderer,
    Size, Stage, TimeBar, Viewpoint, animated_png, png,
};
pub use rows::Rows;
pub use servo::Servo;
pub use shapes::{CameraMount, Geom, GeomKind, Surface};
pub use state::World;

/// The robot, a Franka Emika Panda with its hand, as MJCF document.
pub const PANDA: &str = include_str!("../assets/panda.xml");

/// The version of MuJoCo that this crate was made for.
pub const MUJOCO_VERSION: &str = "3.17.0";

/// Returns the version of the linked MuJoCo library, for example `3.17.0`.
pub fn mujoco_version() -> String {
    mujoco_rs::mujoco_version().to_string()
}
