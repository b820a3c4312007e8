//! Checkpoints of PyTorch as controllers, without PyTorch and without executing a pickle.
//!
//! - [`zip`]: entries of an archive whose entries are stored, not compressed.
//! - [`pickle`]: the data that a state dictionary consists of; everything else in a pickle is an
//!   error.
//! - [`tensor`]: the tensors of a checkpoint.
//! - [`import`]: the layers of a policy of Stable-Baselines3, skrl or plain PyTorch.

mod import;
mod normalizer;
mod pickle;
mod tensor;
mod zip;

pub use import::{ImportOptions, Imported, import};
pub use normalizer::ObservationNormalizer;
