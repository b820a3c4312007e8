//! ONNX models as policies.
//!
//! - [`check`]: what a model may contain, before anything is computed.
//! - [`cost`]: memory and time of each operator, from the shapes of its inputs.
//! - [`interface`]: which input is the observation, which output the action.
//! - [`policy`]: runs a model as a controller.
//! - [`export`]: writes a controller as a model.

mod check;
mod cost;
mod export;
mod interface;
mod policy;
mod wire;

pub use export::onnx_bytes;
pub use interface::Interface;
pub use policy::OnnxPolicy;
