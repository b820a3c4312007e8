//! Operators of the runtime that lose NaN.
//!
//! Its `Relu` and `Clip` make a bound of NaN, so that a policy which gets or computes NaN would act
//! as if nothing were wrong. The standard keeps NaN, and so do the runtime's `Max` and `Min`.

use std::collections::HashSet;

use rten_onnx::onnx::{DataType, GraphProto, NodeProto, TensorProto};

use super::cost::attribute;

/// Replaces `Relu` and `Clip` by `Max` and `Min`, which are equal for all numbers.
pub(super) fn keep_nan(graph: &mut GraphProto) {
    let names = graph.node.iter().flat_map(|node| node.input.iter().chain(&node.output));
    let weights = graph.initializer.iter().filter_map(|tensor| tensor.name.as_ref());
    let used: HashSet<String> = names.chain(weights).cloned().collect();
    let mut prefix = "bound".to_string();
    while used.iter().any(|name| name.starts_with(&prefix)) {
        prefix.push('_');
    }
    for node in std::mem::take(&mut graph.node) {
        let operator = node.op_type.as_deref().unwrap_or_default();
        let (Some(first), Some(output), "Relu" | "Clip") =
            (node.input.first(), node.output.first(), operator)
        else {
            graph.node.push(node);
            continue;
        };
        let mut value = first.clone();
        let bounds: Vec<(&str, String)> = match operator {
            "Relu" => vec![("Max", constant(&mut graph.initializer, &prefix, 0.0))],
            _ => [("Max", "min", 1), ("Min", "max", 2)]
                .into_iter()
                .filter_map(|(operator, name, place)| {
                    let given = node.input.get(place).filter(|name| !name.is_empty()).cloned();
                    // Up to opset 10, bounds are attributes.
                    let stated = attribute(&node, name).and_then(|own| own.f);
                    let bound = given.or_else(|| Some(constant(&mut graph.initializer, &prefix, stated?)))?;
                    Some((operator, bound))
                })
                .collect(),
        };
        let mut steps: Vec<(&str, Option<String>)> =
            bounds.into_iter().map(|(operator, bound)| (operator, Some(bound))).collect();
        if steps.is_empty() {
            steps.push(("Identity", None));
        }
        let count = steps.len();
        for (index, (operator, bound)) in steps.into_iter().enumerate() {
            let next = if index + 1 == count { output.clone() } else { format!("{prefix} of {output}") };
            graph.node.push(NodeProto {
                op_type: Some(operator.to_string()),
                input: std::iter::once(value).chain(bound).collect(),
                output: vec![next.clone()],
                ..NodeProto::default()
            });
            value = next;
        }
    }
}

/// Adds a constant to the weights, and returns its name.
fn constant(weights: &mut Vec<TensorProto>, prefix: &str, value: f32) -> String {
    let name = format!("{prefix} {}", weights.len());
    weights.push(TensorProto {
        data_type: Some(DataType::FLOAT),
        float_data: vec![value],
        name: Some(name.clone()),
        ..TensorProto::default()
    });
    name
}
