//! Documents of models: reading them with their files, and edits of MJCF.
//!
//! - [`Source::read`] lets MuJoCo read a model. A model is untrusted: MuJoCo gets no file outside
//!   its folder, sizes and counts are bounded.
//! - [`Source::edit`] adds elements, sets attributes and makes actuators, in the document and in
//!   those that it includes. Text changes only where something is replaced or inserted, so all
//!   numbers keep their digits. URDF can be read, not edited.

mod add;
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
pub(crate) use source::ModelFiles;
pub use source::Source;
