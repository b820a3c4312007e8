//! Metadata and shapes of a model, read without running it.

use std::collections::HashSet;
use std::path::Path;

use mishandle_files::limits;
use rten_onnx::onnx::ValueInfoProto;

use super::policy::read;
use super::{OnnxSummary, OnnxTensor, check};
use crate::InterchangeError;

impl OnnxSummary {
    /// Reads the metadata and the shapes of a model.
    ///
    /// # Errors
    /// If the file cannot be read or is too large, or the model is not supported.
    pub fn read(path: &Path) -> Result<OnnxSummary, InterchangeError> {
        let bytes = read(path, limits::ONNX)?;
        let model = check::parse(&bytes)
            .map_err(|problem| InterchangeError::Onnx { problem, path: path.to_path_buf() })?;
        let property = |(key, value): (&Option<String>, &Option<String>)| {
            (key.clone().unwrap_or_default(), value.clone().unwrap_or_default())
        };
        let metadata =
            model.metadata_props.iter().map(|entry| property((&entry.key, &entry.value))).collect();
        let graph = model.graph.unwrap_or_default();
        // Old models list their weights as inputs, too.
        let weights: HashSet<&str> =
            graph.initializer.iter().filter_map(|tensor| tensor.name.as_deref()).collect();
        let inputs = graph.input.iter().map(tensor).filter(|input| !weights.contains(input.name.as_str()));
        Ok(OnnxSummary {
            metadata,
            inputs: inputs.collect(),
            outputs: graph.output.iter().map(tensor).collect(),
        })
    }
}

fn tensor(value: &ValueInfoProto) -> OnnxTensor {
    let kind = value.r#type.as_ref().and_then(|kind| kind.tensor_type.as_ref());
    let shape = kind.and_then(|tensor| tensor.shape.as_ref());
    let size = |dim: Option<i64>| dim.and_then(|size| usize::try_from(size).ok());
    OnnxTensor {
        name: value.name.clone().unwrap_or_default(),
        shape: shape.map_or_else(Vec::new, |shape| shape.dim.iter().map(|dim| size(dim.dim_value)).collect()),
    }
}
