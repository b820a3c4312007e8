//! Checkpoints of PyTorch as controllers, without PyTorch and without executing a pickle.
//!
//! - [`zip`]: entries of an archive whose entries are stored, not compressed.
//! - [`pickle`]: the data that a state dictionary consists of; everything else in a pickle is an
//!   error.
//! - [`tensor`]: the tensors of a checkpoint.
//! - [`chain`]: tensors as a chain of linear layers.
//! - [`assemble`]: the policy of such a chain, and of what the file or the user says about it.
//! - [`stable_baselines`]: the class, arguments and spaces of a policy of Stable-Baselines3.
//! - [`import`]: recognizes a checkpoint; those of skrl and plain PyTorch.

mod assemble;
mod chain;
mod import;
mod normalizer;
mod pickle;
mod stable_baselines;
mod tensor;
mod zip;

pub use assemble::ACTIVATIONS;
pub use import::{ImportOptions, Imported, Normalization, import};
pub use normalizer::ObservationNormalizer;
