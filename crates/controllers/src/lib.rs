//! Learned policies and their file format.

mod error;
mod file;
mod layout;
mod policy;
mod seal;
pub mod squashed;

pub use error::{ControllerError, FileProblem};
pub use file::{
    ControllerFile, FORMAT_VERSION, Header, TrainingRecord, ValidationRecord, WRITTEN_VERSIONS, bytes_hash,
};
pub use layout::{Entry, Layout};
pub use policy::Policy;
pub use seal::{UNSEALED, is_sealed, seal};
