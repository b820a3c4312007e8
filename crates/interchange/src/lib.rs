//! Policies in the formats of other tools.
//!
//! [`OnnxPolicy`] runs an ONNX model as a [`Controller`](mishandle_rollout::Controller).
//! [`onnx_bytes`] writes a controller as an ONNX model, with its normalizer and the clipping of
//! observations and actions. [`import`] reads the weights of a policy of Stable-Baselines3, skrl or
//! PyTorch.
//!
//! A file is data. No pickle is executed, no path in a file is opened, and sizes are checked before
//! memory is allocated.

mod error;
mod onnx;
mod torch;

pub use error::{InterchangeError, OnnxProblem, PolicyPart, TorchProblem};
#[cfg(feature = "onnx")]
pub use onnx::{Chunk, Interface, Padding};
pub use onnx::{OnnxDescription, OnnxPolicy, OnnxSummary, OnnxTensor, onnx_bytes};
pub use torch::{ACTIVATIONS, ImportOptions, Imported, Normalization, ObservationNormalizer, import};
