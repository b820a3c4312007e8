//! MJCF documents as text: a model with the files that it refers to, and edits of it.
//!
//! - [`Source::read`] follows includes and collects meshes and textures. A model is untrusted: no
//!   file outside its folder is read, sizes and counts are bounded, plugins are refused.
//! - [`Source::edit`] adds elements, sets attributes and makes actuators.
//!
//! The text changes only where something is replaced or inserted, so all numbers keep their digits
//! and a model that is compiled from it has the bits of the file. URDF can be read, not edited.

mod add;
mod assets;
mod classes;
mod compose;
mod edit;
mod error;
mod folder;
mod matching;
mod source;
mod splice;
mod tree;
mod urdf;

pub use edit::{Edit, Select};
pub use error::MjcfError;
pub use source::Source;
