//! Checks what a model contains before the runtime reads it.

use std::collections::HashSet;

use rten_onnx::onnx::{DataLocation, GraphProto, ModelProto, TensorProto};

use super::cost::OPERATORS;
use super::wire::Fields;
use crate::OnnxProblem;

/// Largest number of operators of a model.
const MAX_NODES: usize = 10_000;

/// Numbers of fields in the messages of `onnx.proto`.
mod field {
    pub const MODEL_GRAPH: u64 = 7;
    pub const GRAPH_NODE: u64 = 1;
    pub const NODE_ATTRIBUTE: u64 = 5;
    pub const ATTRIBUTE_GRAPH: u64 = 6;
    pub const ATTRIBUTE_GRAPHS: u64 = 11;
    pub const GRAPH_INPUT: u64 = 11;
    pub const GRAPH_VALUE_INFO: u64 = 13;
    pub const VALUE_TYPE: u64 = 2;
    /// Sequence, map, sparse tensor and optional.
    pub const TYPES_WITHOUT_TENSORS: [u64; 4] = [4, 5, 8, 9];
}

/// Parses a model of which the messages are nested to a known depth only: no subgraphs, no types but tensors.
pub(super) fn parse(bytes: &[u8]) -> Result<ModelProto, OnnxProblem> {
    check_nesting(bytes)?;
    let format = |reason: String| OnnxProblem::Format { reason };
    let model = ModelProto::parse_buf(bytes).map_err(|error| format(error.to_string()))?;
    let graph = model.graph.as_ref().ok_or_else(|| format("it has no graph".to_string()))?;
    check_graph(graph)?;
    Ok(model)
}

fn check_nesting(bytes: &[u8]) -> Result<(), OnnxProblem> {
    for field in Fields::new(bytes) {
        let field = field?;
        if field.number == field::MODEL_GRAPH {
            for part in Fields::new(field.bytes) {
                let part = part?;
                match part.number {
                    field::GRAPH_NODE => check_node_nesting(part.bytes)?,
                    field::GRAPH_INPUT..=field::GRAPH_VALUE_INFO => check_type_nesting(part.bytes)?,
                    _ => {}
                }
            }
        }
    }
    Ok(())
}

fn check_node_nesting(node: &[u8]) -> Result<(), OnnxProblem> {
    for field in Fields::new(node) {
        let field = field?;
        if field.number != field::NODE_ATTRIBUTE {
            continue;
        }
        for part in Fields::new(field.bytes) {
            if matches!(part?.number, field::ATTRIBUTE_GRAPH | field::ATTRIBUTE_GRAPHS) {
                return Err(OnnxProblem::Unsupported {
                    found: "a subgraph (an operator such as `If`, `Loop` or `Scan`)".to_string(),
                    hint: "export a policy without branches and loops, one control step per call".to_string(),
                });
            }
        }
    }
    Ok(())
}

fn check_type_nesting(value: &[u8]) -> Result<(), OnnxProblem> {
    for field in Fields::new(value) {
        let field = field?;
        if field.number != field::VALUE_TYPE {
            continue;
        }
        for kind in Fields::new(field.bytes) {
            if field::TYPES_WITHOUT_TENSORS.contains(&kind?.number) {
                return Err(OnnxProblem::Unsupported {
                    found: "a value that is no tensor, such as a sequence or a map".to_string(),
                    hint: "export a policy of tensors".to_string(),
                });
            }
        }
    }
    Ok(())
}

fn check_graph(graph: &GraphProto) -> Result<(), OnnxProblem> {
    if graph.node.len() > MAX_NODES {
        let reason = format!("{} operators; the limit is {MAX_NODES}", graph.node.len());
        return Err(OnnxProblem::Size { reason });
    }
    let mut defined = HashSet::new();
    let mut define = |name: &str| {
        let reason = format!("two values have the name `{name}`");
        if defined.insert(name.to_string()) { Ok(()) } else { Err(OnnxProblem::Format { reason }) }
    };
    for tensor in &graph.initializer {
        check_tensor(tensor)?;
        define(tensor.name.as_deref().unwrap_or_default())?;
    }
    for node in &graph.node {
        let operator = node.op_type.as_deref().unwrap_or_default();
        let is_standard = matches!(node.domain.as_deref().unwrap_or_default(), "" | "ai.onnx");
        if !is_standard || (operator != "Constant" && OPERATORS.iter().all(|(known, _)| *known != operator)) {
            let domain = node.domain.as_deref().filter(|_| !is_standard);
            let domain = domain.map(|domain| format!(" of the domain `{domain}`")).unwrap_or_default();
            return Err(OnnxProblem::Unsupported {
                found: format!("the operator `{operator}`{domain}"),
                hint: "docs/onnx.md lists the supported operators".to_string(),
            });
        }
        node.attribute.iter().filter_map(|attribute| attribute.t.as_ref()).try_for_each(check_tensor)?;
        node.output.iter().filter(|name| !name.is_empty()).try_for_each(|name| define(name))?;
    }
    Ok(())
}

fn check_tensor(tensor: &TensorProto) -> Result<(), OnnxProblem> {
    let is_external =
        tensor.data_location == Some(DataLocation::EXTERNAL) || !tensor.external_data.is_empty();
    if is_external {
        return Err(OnnxProblem::Unsupported {
            found: format!("weights in another file (`{}`)", tensor.name.as_deref().unwrap_or_default()),
            hint: "export it with `torch.onnx.export(..., external_data=False)`, or join the files in Python with \
                   `onnx.save(onnx.load(FILE), FILE, save_as_external_data=False)`"
                .to_string(),
        });
    }
    if tensor.dims.iter().any(|dim| *dim < 0) {
        let reason = format!("`{}` has a negative size", tensor.name.as_deref().unwrap_or_default());
        return Err(OnnxProblem::Format { reason });
    }
    Ok(())
}
