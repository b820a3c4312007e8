//! ONNX models as policies.
//!
//! Without the feature `onnx`, models can be written but not read: `absent` says so.
//!
//! - [`chunk`]: models that predict several actions ahead.
//! - [`check`]: what a model may contain, before anything is computed.
//! - [`cost`]: memory and time of each operator, from the shapes of its inputs.
//! - [`history`]: models that get the last observations and images.
//! - [`images`]: the inputs that get images of cameras.
//! - [`interface`]: which input is the observation, which output the action.
//! - [`meaning`]: operators that the runtime computes in another way than the standard says.
//! - [`names`]: the values that a control step reads and writes.
//! - [`dry_run`]: computes a model once, with bounds.
//! - [`order`]: the order in which values are computed.
//! - [`policy`]: runs a model as a controller.
//! - [`rewrite`]: replaces operators that the runtime computes wrongly or does not have.
//! - [`summary`]: what a model says about itself, without running it.
//! - [`export`]: writes a controller as a model.

#[cfg(not(feature = "onnx"))]
mod absent;
#[cfg(feature = "onnx")]
mod check;
#[cfg(feature = "onnx")]
mod chunk;
#[cfg(feature = "onnx")]
mod cost;
#[cfg(feature = "onnx")]
mod dry_run;
mod export;
#[cfg(feature = "onnx")]
mod fields;
#[cfg(feature = "onnx")]
mod history;
#[cfg(feature = "onnx")]
mod images;
#[cfg(feature = "onnx")]
mod interface;
#[cfg(feature = "onnx")]
mod meaning;
mod message;
#[cfg(feature = "onnx")]
mod names;
#[cfg(feature = "onnx")]
mod order;
#[cfg(feature = "onnx")]
mod policy;
#[cfg(feature = "onnx")]
mod rewrite;
#[cfg(feature = "onnx")]
mod summary;

use mishandle_controllers::ActionInterface;

#[cfg(not(feature = "onnx"))]
pub use absent::OnnxPolicy;
#[cfg(feature = "onnx")]
pub use chunk::Chunk;
pub use export::onnx_bytes;
#[cfg(feature = "onnx")]
pub use history::Padding;
#[cfg(feature = "onnx")]
pub use interface::Interface;
#[cfg(feature = "onnx")]
pub use policy::OnnxPolicy;

/// Metadata and shapes of a model, read without running it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct OnnxSummary {
    /// Keys and values of the metadata.
    pub metadata: Vec<(String, String)>,
    /// The inputs that are not weights.
    pub inputs: Vec<OnnxTensor>,
    /// The outputs.
    pub outputs: Vec<OnnxTensor>,
}

/// The statements of a model about its controller, read without running it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OnnxDescription {
    /// The task that it names.
    pub task: Option<String>,
    /// The parts of the observation that it names.
    pub parts: Vec<String>,
    /// How its actions become joint targets.
    pub action_interface: Option<ActionInterface>,
}

/// An input or an output of a model.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OnnxTensor {
    /// Its name.
    pub name: String,
    /// Its sizes; `None` for one that is free.
    pub shape: Vec<Option<usize>>,
}

/// The prefix of the keys in the metadata of a model.
const PREFIX: &str = "mishandle.";

/// Keys that describe where an exported model comes from. They are not read.
const PROVENANCE: [&str; 3] = ["algorithm", "controller_hash", "version"];
