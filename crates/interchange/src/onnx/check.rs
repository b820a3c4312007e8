//! Checks what a model contains before the runtime reads it.

use std::cell::RefCell;
use std::collections::HashSet;
use std::ops::RangeInclusive;

use mishandle_files::limits;
use rten_onnx::onnx::{DataLocation, GraphProto, ModelProto, TensorProto};

use super::cost::cost_of;
use super::fields::{Field, Fields};
use super::rewrite::MISSING;
use crate::OnnxProblem;

/// Largest number of operators of a model, of its weights, of its inputs, and of the outputs of all
/// operators.
const MAX_NODES: usize = 10_000;

/// Largest number of elements of a tensor: one per byte of the largest file.
const MAX_ELEMENTS: i64 = limits::ONNX as i64;

/// The messages of `onnx.proto` that the runtime's parser reads.
#[derive(Clone, Copy)]
enum Kind {
    Model,
    Graph,
    Node,
    Attribute,
    Tensor,
    Value,
    Type,
    TensorType,
    Shape,
    /// A message without messages inside.
    Leaf,
}

impl Kind {
    /// Returns the kind of the message in the field with this number, if it is one.
    fn inner(self, number: u64) -> Option<Kind> {
        match (self, number) {
            (Kind::Model, 7) => Some(Kind::Graph),
            (Kind::Model, 8 | 14) | (Kind::Tensor, 13) | (Kind::Shape, 1) => Some(Kind::Leaf),
            (Kind::Graph, 1) => Some(Kind::Node),
            (Kind::Graph, 5) | (Kind::Attribute, 5) => Some(Kind::Tensor),
            (Kind::Graph, 11..=13) => Some(Kind::Value),
            (Kind::Node, 5) => Some(Kind::Attribute),
            (Kind::Value, 2) => Some(Kind::Type),
            (Kind::Type, 1) => Some(Kind::TensorType),
            (Kind::TensorType, 2) => Some(Kind::Shape),
            _ => None,
        }
    }
}

/// The oldest and the newest set of operators that was compared with ONNX Runtime.
const OPSETS: RangeInclusive<i64> = 7..=22;

/// Parses a model of which the messages are nested to a known depth only: no subgraphs, no types
/// but tensors.
pub(super) fn parse(bytes: &[u8]) -> Result<ModelProto, OnnxProblem> {
    check_fields(Kind::Model, bytes)?;
    let format = |reason: String| OnnxProblem::Format { reason };
    let model = ModelProto::parse_buf(bytes).map_err(|error| format(error.to_string()))?;
    let graph = model.graph.as_ref().ok_or_else(|| format("it has no graph".to_string()))?;
    check_graph(graph)?;
    check_opset(&model)?;
    Ok(model)
}

/// Checks that the fields of a message, and of the messages inside, are inside it, and that no kind
/// of message is inside itself.
fn check_fields(kind: Kind, message: &[u8]) -> Result<(), OnnxProblem> {
    for field in Fields::new(message) {
        let Field { number, bytes } = field?;
        match (kind, number) {
            (Kind::Attribute, 6 | 11) => {
                return Err(OnnxProblem::Unsupported {
                    found: "a subgraph (an operator such as `If`, `Loop` or `Scan`)".to_string(),
                    hint: "export a policy without branches and loops, one control step per call".to_string(),
                });
            }
            (Kind::Type, 4 | 5 | 8 | 9) => {
                return Err(OnnxProblem::Unsupported {
                    found: "a value that is no tensor, such as a sequence or a map".to_string(),
                    hint: "export a policy of tensors".to_string(),
                });
            }
            _ => {
                if let Some(inner) = kind.inner(number) {
                    check_fields(inner, bytes)?;
                }
            }
        }
    }
    Ok(())
}

/// Returns the version of the standard operators, if the model has one.
pub(super) fn opset(model: &ModelProto) -> Option<i64> {
    let is_standard = |domain: Option<&str>| matches!(domain.unwrap_or_default(), "" | "ai.onnx");
    let mut opsets = model.opset_import.iter().filter(|opset| is_standard(opset.domain.as_deref()));
    let found = opsets.next().and_then(|opset| opset.version);
    found.filter(|_| opsets.next().is_none())
}

/// Checks the version of the standard operators: another one may give an operator another meaning.
fn check_opset(model: &ModelProto) -> Result<(), OnnxProblem> {
    let found = opset(model);
    if found.is_some_and(|found| OPSETS.contains(&found)) {
        return Ok(());
    }
    let first = OPSETS.start();
    let last = OPSETS.end();
    Err(OnnxProblem::Unsupported {
        found: found.map_or("no opset, or several".to_string(), |found| format!("the opset {found}")),
        hint: format!(
            "the opsets {first} to {last} are: export with `torch.onnx.export(..., opset_version=20)`"
        ),
    })
}

fn check_graph(graph: &GraphProto) -> Result<(), OnnxProblem> {
    let outputs = graph.node.iter().map(|node| node.output.len()).sum();
    for (what, found) in [
        ("operators", graph.node.len()),
        ("tensors of weights", graph.initializer.len()),
        ("inputs", graph.input.len()),
        ("outputs", graph.output.len()),
        ("outputs of operators", outputs),
    ] {
        if found > MAX_NODES {
            return Err(OnnxProblem::Size { reason: format!("{found} {what}; the limit is {MAX_NODES}") });
        }
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
    // Old models list their weights as inputs, too.
    let names: HashSet<&str> = graph.initializer.iter().filter_map(|tensor| tensor.name.as_deref()).collect();
    let inputs = graph.input.iter().map(|input| input.name.as_deref().unwrap_or_default());
    inputs.filter(|name| !names.contains(name)).try_for_each(&mut define)?;
    for node in &graph.node {
        let operator = node.op_type.as_deref().unwrap_or_default();
        let is_standard = matches!(node.domain.as_deref().unwrap_or_default(), "" | "ai.onnx");
        let is_known = operator == "Constant" || MISSING.contains(&operator) || cost_of(operator).is_some();
        if !is_standard || !is_known {
            let domain = node.domain.as_deref().filter(|_| !is_standard);
            let domain = domain.map(|domain| format!(" of the domain `{domain}`")).unwrap_or_default();
            return Err(OnnxProblem::Unsupported {
                found: format!("the operator `{operator}`{domain}"),
                hint: "docs/guide/onnx.md lists the supported operators".to_string(),
            });
        }
        node.attribute.iter().filter_map(|attribute| attribute.t.as_ref()).try_for_each(check_tensor)?;
        node.output.iter().filter(|name| !name.is_empty()).try_for_each(|name| define(name))?;
    }
    Ok(())
}

fn check_tensor(tensor: &TensorProto) -> Result<(), OnnxProblem> {
    let name = tensor.name.as_deref().unwrap_or_default();
    if tensor.dims.iter().any(|dim| *dim < 0) {
        return Err(OnnxProblem::Format { reason: format!("`{name}` has a negative size") });
    }
    // The runtime multiplies sizes without a check. Zeros are left out, because it multiplies in
    // any order.
    let elements = tensor.dims.iter().try_fold(1_i64, |product, dim| product.checked_mul((*dim).max(1)));
    if elements.is_none_or(|elements| elements > MAX_ELEMENTS) {
        let reason =
            format!("`{name}` has the sizes {:?}; the limit is {MAX_ELEMENTS} elements", tensor.dims);
        return Err(OnnxProblem::Size { reason });
    }
    Ok(())
}

/// A file of weights beside a model: its name and its content.
pub(super) type Weights<'b> = (&'b str, &'b [u8]);

/// Copies weights of another file into the model: `weights`, whatever name the model gives it. No
/// path in a model is opened, so weights in several files are an error.
pub(super) fn join(model: &mut ModelProto, weights: Option<Weights<'_>>) -> Result<(), OnnxProblem> {
    let Some(graph) = model.graph.as_mut() else { return Ok(()) };
    // Tensors may share bytes, but all of them together are not larger than the file.
    let mut first: Option<String> = None;
    let mut left = weights.map_or(0, |(_, content)| content.len());
    let attributes = graph.node.iter_mut().flat_map(|node| &mut node.attribute);
    let constants = attributes.filter_map(|attribute| attribute.t.as_mut());
    for tensor in graph.initializer.iter_mut().chain(constants) {
        if tensor.data_location != Some(DataLocation::EXTERNAL) && tensor.external_data.is_empty() {
            continue;
        }
        let value = |key: &str| {
            let mut entries = tensor.external_data.iter();
            entries.find(|entry| entry.key.as_deref() == Some(key)).and_then(|entry| entry.value.as_deref())
        };
        let location = value("location").unwrap_or_default();
        let Some((_, content)) = weights else {
            let reason = format!(
                "its weights are in another file, `{location}`, and there is no file MODEL.onnx.data beside MODEL.onnx; copy it \
                 there with that name, or export with `torch.onnx.export(..., external_data=False)`"
            );
            return Err(OnnxProblem::Format { reason });
        };
        // A model whose files were renamed together names the old file.
        if first.get_or_insert_with(|| location.to_string()).as_str() != location {
            return Err(OnnxProblem::Unsupported {
                found: format!("weights in several files, `{}` and `{location}`", first.unwrap_or_default()),
                hint: "only the file MODEL.onnx.data beside MODEL.onnx is read: export with \
                       `torch.onnx.export(..., external_data=False)`"
                    .to_string(),
            });
        }
        let number = |key: &str| value(key).map(|text| text.parse::<usize>().ok());
        let offset = number("offset").unwrap_or(Some(0));
        let rest = offset.and_then(|offset| content.get(offset..));
        let length = number("length").unwrap_or(rest.map(<[u8]>::len));
        let bytes = rest
            .zip(length)
            .and_then(|(rest, length)| rest.get(..length))
            .filter(|bytes| bytes.len() <= left);
        let Some(bytes) = bytes else {
            let name = tensor.name.as_deref().unwrap_or_default();
            let reason = format!("the weights of `{name}` are not inside `{location}`");
            return Err(OnnxProblem::Format { reason });
        };
        left -= bytes.len();
        tensor.raw_data = Some(RefCell::new(bytes.to_vec()));
        tensor.data_location = None;
        tensor.external_data.clear();
    }
    Ok(())
}
