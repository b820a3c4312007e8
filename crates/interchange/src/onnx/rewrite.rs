//! Replaces operators that the runtime computes in another way than the ONNX standard says, or does
//! not have, by operators that give the numbers of the standard.
//!
//! - `Relu` and `Clip` make a bound of NaN, so that a policy which gets or computes NaN would act
//!   as if nothing were wrong. The runtime's `Max` and `Min` keep NaN.
//! - `Sign` of 0 is 1.
//! - `Softplus` is infinite where the exponential of its input is.
//! - `AveragePool` and `MaxPool` need strides.
//! - `Mish` and `GroupNormalization` are missing.

use std::collections::{HashMap, HashSet};

use rten_onnx::onnx::{AttributeProto, DataType, GraphProto, NodeProto, TensorProto};

use super::cost::attribute;
use crate::OnnxProblem;

/// The operators that are replaced and that the runtime does not have, in alphabetical order.
pub(super) const MISSING: [&str; 2] = ["GroupNormalization", "Mish"];

/// From here on, `Softplus` of a number is the number: exp(-30) is less than half a unit in its
/// last place.
const SOFTPLUS_IS_IDENTITY: f32 = 30.0;

/// The first opset in which `GroupNormalization` has a weight for each channel. ONNX withdrew the
/// definition before.
const GROUP_NORMALIZATION_OPSET: i64 = 21;

/// Replaces the operators of a graph.
///
/// # Errors
/// If an operator has another meaning in this opset, or lacks an attribute.
pub(super) fn rewrite(graph: &mut GraphProto, opset: i64) -> Result<(), OnnxProblem> {
    let names = graph.node.iter().flat_map(|node| node.input.iter().chain(&node.output));
    let weights = graph.initializer.iter().filter_map(|tensor| tensor.name.as_ref());
    let used: HashSet<String> = names.chain(weights).cloned().collect();
    let mut prefix = "own".to_string();
    while used.iter().any(|name| name.starts_with(&prefix)) {
        prefix.push('_');
    }
    let nodes = std::mem::take(&mut graph.node);
    let mut writer = Writer { graph, prefix, names: 0, constants: HashMap::new() };
    nodes.into_iter().try_for_each(|node| writer.replace(node, opset))
}

fn unsupported(operator: &str, found: &str, hint: &str) -> OnnxProblem {
    OnnxProblem::Unsupported { found: format!("the operator `{operator}` {found}"), hint: hint.to_string() }
}

/// Adds operators and constants to a graph.
struct Writer<'g> {
    graph: &'g mut GraphProto,
    /// Starts the names of added values; no other name starts with it.
    prefix: String,
    /// The number of added names.
    names: usize,
    /// Names of the added numbers, by their bits.
    constants: HashMap<u32, String>,
}

impl Writer<'_> {
    fn replace(&mut self, mut node: NodeProto, opset: i64) -> Result<(), OnnxProblem> {
        let (Some(x), Some(_)) = (node.input.first().cloned(), node.output.first()) else {
            self.graph.node.push(node);
            return Ok(());
        };
        match node.op_type.as_deref().unwrap_or_default() {
            "Relu" => {
                let zero = self.constant(0.0);
                self.add("Max", &[&x, &zero]);
            }
            "Clip" => self.clip(&node, &x),
            "Sign" => self.sign(&x),
            "Softplus" => {
                self.softplus(&x);
            }
            "Mish" => {
                let softplus = self.softplus(&x);
                let tanh = self.add("Tanh", &[&softplus]);
                self.add("Mul", &[&x, &tanh]);
            }
            "AveragePool" | "MaxPool" if attribute(&node, "strides").is_none() => {
                let kernel = attribute(&node, "kernel_shape").map_or(0, |own| own.ints.len());
                let ints = vec![1; kernel];
                let strides =
                    AttributeProto { name: Some("strides".to_string()), ints, ..Default::default() };
                node.attribute.push(strides);
                self.graph.node.push(node);
                return Ok(());
            }
            "LSTM" if node.input.get(7).is_some_and(|name| !name.is_empty()) => {
                return Err(unsupported("LSTM", "with peepholes", "export a policy without them"));
            }
            "GroupNormalization" => self.group_normalization(&node, &x, opset)?,
            _ => {
                self.graph.node.push(node);
                return Ok(());
            }
        }
        // The last operator that was added writes the result.
        if let Some(last) = self.graph.node.last_mut() {
            last.output = node.output;
        }
        Ok(())
    }

    fn clip(&mut self, node: &NodeProto, x: &str) {
        let mut value = x.to_string();
        for (operator, name, place) in [("Max", "min", 1), ("Min", "max", 2)] {
            let given = node.input.get(place).filter(|name| !name.is_empty()).cloned();
            // Up to opset 10, bounds are attributes.
            let stated = attribute(node, name).and_then(|own| own.f);
            if let Some(bound) = given.or_else(|| Some(self.constant(stated?))) {
                value = self.add(operator, &[&value, &bound]);
            }
        }
        if value == x {
            self.add("Identity", &[x]);
        }
    }

    /// 0 where the number is 0, in its type: real or integer.
    fn sign(&mut self, x: &str) {
        let zero = self.constant(0.0);
        let zero = self.add("CastLike", &[&zero, x]);
        let is_zero = self.add("Equal", &[x, &zero]);
        let sign = self.add("Sign", &[x]);
        self.add("Where", &[&is_zero, &zero, &sign]);
    }

    fn softplus(&mut self, x: &str) -> String {
        let limit = self.constant(SOFTPLUS_IS_IDENTITY);
        let small = self.add("Min", &[x, &limit]);
        let softplus = self.add("Softplus", &[&small]);
        // It is larger than its input.
        self.add("Max", &[x, &softplus])
    }

    /// Normalizes each group of channels as a channel of its own, then scales each channel.
    fn group_normalization(&mut self, node: &NodeProto, x: &str, opset: i64) -> Result<(), OnnxProblem> {
        if opset < GROUP_NORMALIZATION_OPSET {
            return Err(unsupported(
                "GroupNormalization",
                "of an opset before 21",
                "export with opset 21 or newer",
            ));
        }
        let groups = attribute(node, "num_groups").and_then(|own| own.i).filter(|groups| *groups > 0);
        let (Some(groups), [_, scale, bias]) = (groups, &node.input[..]) else {
            return Err(unsupported(
                "GroupNormalization",
                "without `num_groups`, scale or bias",
                "export the policy again",
            ));
        };
        let size = self.add("Shape", &[x]);
        let grouped = self.integers(&[0, groups, -1]);
        let grouped = self.add("Reshape", &[x, &grouped]);
        let groups_shape = self.integers(&[groups]);
        let ones = self.constant(1.0);
        let ones = self.add("Expand", &[&ones, &groups_shape]);
        let zeros = self.constant(0.0);
        let zeros = self.add("Expand", &[&zeros, &groups_shape]);
        let normalized = self.add("InstanceNormalization", &[&grouped, &ones, &zeros]);
        let epsilon = node.attribute.iter().filter(|own| own.name.as_deref() == Some("epsilon"));
        self.set_attributes(epsilon.cloned().collect());
        // Each channel becomes a row, so the weights of a channel multiply one row.
        let [start, end, rest, axis] = [0, 2, -1, 1].map(|number| self.integers(&[number]));
        let rows = self.add("Slice", &[&size, &start, &end]);
        let rows = self.add("Concat", &[&rows, &rest]);
        self.set_attributes(vec![AttributeProto {
            name: Some("axis".to_string()),
            i: Some(0),
            ..Default::default()
        }]);
        let normalized = self.add("Reshape", &[&normalized, &rows]);
        let scale = self.add("Unsqueeze", &[scale, &axis]);
        let scaled = self.add("Mul", &[&normalized, &scale]);
        let bias = self.add("Unsqueeze", &[bias, &axis]);
        let moved = self.add("Add", &[&scaled, &bias]);
        self.add("Reshape", &[&moved, &size]);
        Ok(())
    }

    fn name(&mut self) -> String {
        self.names += 1;
        format!("{} {}", self.prefix, self.names)
    }

    /// Adds an operator with one output, and returns the name of the output.
    fn add(&mut self, operator: &str, inputs: &[&str]) -> String {
        let name = self.name();
        self.graph.node.push(NodeProto {
            op_type: Some(operator.to_string()),
            input: inputs.iter().map(ToString::to_string).collect(),
            output: vec![name.clone()],
            ..NodeProto::default()
        });
        name
    }

    /// Sets the attributes of the operator that was added last.
    fn set_attributes(&mut self, attributes: Vec<AttributeProto>) {
        if let Some(last) = self.graph.node.last_mut() {
            last.attribute = attributes;
        }
    }

    /// Adds a number to the weights, once, and returns its name.
    fn constant(&mut self, value: f32) -> String {
        if let Some(name) = self.constants.get(&value.to_bits()) {
            return name.clone();
        }
        let values = TensorProto { float_data: vec![value], ..TensorProto::default() };
        let name = self.weights(values, DataType::FLOAT);
        self.constants.insert(value.to_bits(), name.clone());
        name
    }

    /// Adds a vector of integers to the weights, and returns its name.
    fn integers(&mut self, values: &[i64]) -> String {
        let dims = vec![values.len() as i64];
        let values = TensorProto { int64_data: values.to_vec(), dims, ..TensorProto::default() };
        self.weights(values, DataType::INT64)
    }

    fn weights(&mut self, values: TensorProto, kind: DataType) -> String {
        let name = self.name();
        let tensor = TensorProto { data_type: Some(kind), name: Some(name.clone()), ..values };
        self.graph.initializer.push(tensor);
        name
    }
}
