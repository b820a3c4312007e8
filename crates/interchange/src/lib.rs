//! Policies in the formats of other tools.
//!
//! [`OnnxPolicy`] runs an ONNX model as a [`Controller`](mishandle_rollout::Controller). [`onnx_bytes`] writes a
//! controller as an ONNX model, with its normalizer and the clipping of observations and actions.
//!
//! A file is data. No pickle is executed, no path in a file is opened, and sizes are checked before memory is allocated.

mod error;
mod onnx;

pub use error::{InterchangeError, OnnxProblem};
pub use onnx::{Interface, OnnxPolicy, onnx_bytes};
