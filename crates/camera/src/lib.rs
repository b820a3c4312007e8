//! Cameras: images of world states, for policies that see.
//!
//! A [`Scene`] has everything that can be seen: shapes with materials, lamps and a background. A
//! [`Camera`] is a pose, a lens and what a sensor does to an image. Both are plain numbers, so that
//! an axis of a scenario sets a number and nothing else; [`Poses`] say where bodies are in a state.
//! A [`Renderer`] casts a ray through each pixel, and a [`Studio`] renders many states on many
//! threads.
//!
//! An image is a function: the same numbers give the same bytes on every machine and with any
//! number of threads. The renderer uses +, -, *, / and square root in single precision, in fixed
//! order, and neither a function of a mathematical library nor OpenGL.
//!
//! Units are SI; a camera looks along its -z, and its y is up in images.
//!
//! [`sight`] is what the cameras of a target see in a scenario.

// Loops over lanes have indices, which the compiler turns into vector instructions.
#![allow(clippy::needless_range_loop)]

mod camera;
mod compression;
mod develop;
mod form;
mod frame;
mod lanes;
mod material;
mod mesh;
mod of_model;
mod pattern;
mod renderer;
mod rows;
mod scene;
mod shadow;
pub mod sight;
mod studio;
mod surface;
mod vector;
mod view;

pub use camera::{Camera, CameraError, DeadRows, Effects, Optics, Patch, Size};
pub use develop::Developer;
pub use form::Form;
pub use material::{Color, Material, Pattern};
pub use mesh::Mesh;
pub use of_model::{PoseReader, focal_length};
pub use renderer::{Output, Renderer, Shot};
pub use rows::{ClothRows, MAX_RAYS, SightRow, compression_tables};
pub use scene::{Ambient, Background, Lamp, NO_SHAPE, Poses, Scene, Shape};
pub use studio::{StateRenderer, StateShot, Studio};
pub use vector::Pose;
