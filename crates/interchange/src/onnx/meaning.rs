//! Operators that the runtime computes in another way than the ONNX standard says.
//!
//! It has no types of 8 or 16 bits, and truth values are integers. The differences were found by a
//! comparison with ONNX Runtime: each operator with each value of its attributes, for the opsets
//! that are supported.

use std::collections::HashSet;

use rten::Value;
use rten_onnx::onnx::{DataType, GraphProto, NodeProto, TensorProto};
use rten_tensor::Layout;

use super::cost::{attribute as attribute_of, determines_shape, pads};

/// The first opset in which `Softmax` reduces its axis alone, and not all from its axis on.
const SOFTMAX_OPSET: i64 = 13;

/// Operators whose results are truth values.
const LOGICAL: [&str; 10] =
    ["And", "Equal", "Greater", "GreaterOrEqual", "IsNaN", "Less", "LessOrEqual", "Not", "Or", "Xor"];

/// A difference between an operator and its computation, and advice to the user.
type Difference = (&'static str, &'static str);

/// The parts of a model on which the meaning of an operator depends.
pub(super) struct Context<'g> {
    opset: i64,
    /// Values that are 0 or 1.
    logical: HashSet<&'g str>,
    /// Constants with integers of more than 32 bits, which the runtime makes smaller.
    large: HashSet<&'g str>,
}

impl<'g> Context<'g> {
    pub(super) fn new(graph: &'g GraphProto, opset: i64) -> Context<'g> {
        let is_logical = |node: &&NodeProto| LOGICAL.contains(&operator(node));
        let results = graph.node.iter().filter(is_logical).flat_map(|node| &node.output);
        let tensors = graph.initializer.iter().map(|tensor| (tensor.name.as_deref(), tensor));
        let constants = graph.node.iter().filter(|node| operator(node) == "Constant").flat_map(|node| {
            let name = node.output.first().map(String::as_str);
            node.attribute.iter().filter_map(move |attribute| Some((name, attribute.t.as_ref()?)))
        });
        let large = tensors.chain(constants).filter(|(_, tensor)| has_large_integers(tensor));
        Context {
            opset,
            logical: results.map(String::as_str).collect(),
            large: large.filter_map(|(name, _)| name).collect(),
        }
    }

    /// Returns the difference for an operator with these inputs.
    pub(super) fn difference(&self, node: &NodeProto, values: &[Option<&Value>]) -> Option<Difference> {
        let shape = values.first().copied().flatten().map(Layout::shape).unwrap_or_default();
        let attribute = |name: &str| attribute_of(node, name)?.i;
        let has_input = |index: usize| node.input.get(index).is_some_and(|name| !name.is_empty());
        // Sizes and the ends of slices have limits of their own.
        let is_size = |index: usize| determines_shape(operator(node), index);
        let mut inputs = node.input.iter().enumerate();
        if inputs.any(|(index, name)| self.large.contains(name.as_str()) && !is_size(index)) {
            return Some(("reads integers of more than 32 bits", "export the policy with smaller ones"));
        }
        match operator(node) {
            "Softmax" | "LogSoftmax" if self.opset < SOFTMAX_OPSET => {
                let axis = attribute("axis").unwrap_or(1);
                let last = shape.len() as i64 - 1;
                (axis != last && axis != -1)
                    .then_some(("reduces several dimensions", "export with opset 13 or newer"))
            }
            "Cast" => {
                let to = attribute("to").unwrap_or_default();
                let is = |kind: DataType| i64::from(kind.0) == to;
                if is(DataType::BOOL) {
                    let is_logical =
                        node.input.first().is_some_and(|name| self.logical.contains(name.as_str()));
                    return (!is_logical).then_some((
                        "converts numbers to truth values",
                        "compare them with 0 in the policy",
                    ));
                }
                let narrow = [DataType::INT8, DataType::UINT8, DataType::FLOAT16, DataType::BFLOAT16];
                narrow
                    .into_iter()
                    .any(is)
                    .then_some(("rounds to 8 or 16 bits", "export the policy with 32-bit numbers"))
            }
            "Conv" | "AveragePool" | "MaxPool" => {
                let text = |name: &str| attribute_of(node, name).and_then(|own| own.s.as_deref());
                if !matches!(text("auto_pad"), None | Some("NOTSET")) {
                    return Some(("pads an image by `auto_pad`", "export the policy with explicit pads"));
                }
                (attribute("ceil_mode").unwrap_or(0) != 0)
                    .then_some(("rounds the number of windows up (ceil_mode)", "export it without ceil_mode"))
            }
            "Pad" if has_input(3) => Some((
                "pads some dimensions only (input `axes`)",
                "export it with a border for each dimension",
            )),
            "Pad" => {
                let mode = attribute_of(node, "mode").and_then(|own| own.s.as_deref());
                let pads = pads(values, node).filter(|_| mode == Some("reflect"))?;
                let (before, after) = pads.split_at_checked(shape.len())?;
                let mirrors_too_much = |(size, (before, after)): (&usize, (&i64, &i64))| {
                    // A negative border removes numbers.
                    let rest = (*size as i64).saturating_add(*before.min(&0)).saturating_add(*after.min(&0));
                    *before.max(after) >= rest
                };
                shape.iter().zip(before.iter().zip(after)).any(mirrors_too_much).then_some((
                    "mirrors more numbers than there are (mode `reflect`)",
                    "export it with a smaller border",
                ))
            }
            // The runtime then returns negative numbers as they are.
            "ReduceL2"
                if attribute("noop_with_empty_axes").unwrap_or(0) != 0
                    && values.get(1).copied().flatten().is_none_or(Layout::is_empty) =>
            {
                Some(("reduces no dimension (noop_with_empty_axes)", "replace it by `Abs`"))
            }
            "LSTM" | "GRU" if has_input(4) => {
                Some(("reads a part of the sequence (sequence_lens)", "export one control step per call"))
            }
            _ => None,
        }
    }
}

fn has_large_integers(tensor: &TensorProto) -> bool {
    let raw = tensor.raw_data.as_ref().map(|raw| raw.borrow());
    let raw = raw.iter().flat_map(|raw| raw.as_chunks().0).map(|bytes| i64::from_le_bytes(*bytes));
    let is_large = |number: i64| i32::try_from(number).is_err();
    tensor.data_type == Some(DataType::INT64)
        && (raw.into_iter().any(is_large) || tensor.int64_data.iter().copied().any(is_large))
}

fn operator(node: &NodeProto) -> &str {
    node.op_type.as_deref().unwrap_or_default()
}
