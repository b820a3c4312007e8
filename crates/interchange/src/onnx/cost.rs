//! The supported operators, with bounds on the memory and the time that each needs.
//!
//! The runtime limits neither. The size of an operator's output follows from the shapes of its
//! inputs, and for some operators from the numbers in an input. A bound counts each empty dimension
//! as 1, since a reduction over it makes 1.

use rten::{OpRegistry, Value, op_registry};
use rten_onnx::onnx::{AttributeProto, NodeProto};
use rten_tensor::Layout;

/// How an operator's number of outputs follows from its inputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Cost {
    /// At most the numbers of the first input.
    First,
    /// The shapes of all inputs, broadcast.
    Broadcast,
    /// The sum of all inputs.
    Sum,
    /// A matrix product.
    MatMul,
    /// A matrix product whose factors may be transposed.
    Gemm,
    /// The numbers of the first input times those of the second.
    Product,
    /// The numbers of the second input.
    Second,
    /// A slice of the first input for each row of the second.
    Slices,
    /// The first input with a border.
    Pad,
    /// The first input, broadcast to the shape in the second.
    Expand,
    /// The first input, repeated as often as the second says.
    Tile,
    /// The shape in the first input.
    Shape,
    /// A recurrent layer.
    Recurrent,
    /// A convolution.
    Conv,
    /// A pool of the windows of an image.
    Pool,
}

/// Declares the table of operators and the registry of the runtime from one list.
macro_rules! operators {
    ($($operator:ident: $cost:ident,)*) => {
        /// The operators of the standard domain that the runtime computes, in alphabetical order,
        /// besides `Constant`.
        const OPERATORS: &[(&str, Cost)] = &[$((stringify!($operator), Cost::$cost)),*];

        /// Returns the registry with the supported operators.
        pub(super) fn registry() -> OpRegistry {
            op_registry!($($operator),*)
        }
    };
}

// `ArgMax` and `ArgMin` are left out: of equal numbers, the runtime takes the last, the standard
// the first.
operators! {
    Abs: First,
    Acos: First,
    Add: Broadcast,
    And: Broadcast,
    Asin: First,
    Atan: First,
    AveragePool: Pool,
    BatchNormalization: First,
    Cast: First,
    CastLike: First,
    Ceil: First,
    Clip: First,
    Concat: Sum,
    ConstantOfShape: Shape,
    Conv: Conv,
    Cos: First,
    CumSum: First,
    Div: Broadcast,
    Elu: First,
    Equal: Broadcast,
    Erf: First,
    Exp: First,
    Expand: Expand,
    Flatten: First,
    Floor: First,
    GRU: Recurrent,
    Gather: Product,
    GatherElements: Second,
    GatherND: Slices,
    Gelu: First,
    Gemm: Gemm,
    GlobalAveragePool: First,
    Greater: Broadcast,
    GreaterOrEqual: Broadcast,
    HardSigmoid: First,
    HardSwish: First,
    Identity: First,
    InstanceNormalization: First,
    IsNaN: First,
    LSTM: Recurrent,
    LayerNormalization: First,
    LeakyRelu: First,
    Less: Broadcast,
    LessOrEqual: Broadcast,
    Log: First,
    LogSoftmax: First,
    MatMul: MatMul,
    Max: Broadcast,
    MaxPool: Pool,
    Mean: Broadcast,
    Min: Broadcast,
    Mod: Broadcast,
    Mul: Broadcast,
    Neg: First,
    Not: First,
    Or: Broadcast,
    PRelu: Broadcast,
    Pad: Pad,
    Pow: Broadcast,
    Reciprocal: First,
    ReduceL2: First,
    ReduceLogSumExp: First,
    ReduceMax: First,
    ReduceMean: First,
    ReduceMin: First,
    ReduceProd: First,
    ReduceSum: First,
    ReduceSumSquare: First,
    Relu: First,
    Reshape: First,
    Round: First,
    Shape: First,
    Sigmoid: First,
    Sign: First,
    Sin: First,
    Size: First,
    Slice: First,
    Softmax: First,
    Softplus: First,
    Softsign: First,
    Split: First,
    Sqrt: First,
    Squeeze: First,
    Sub: Broadcast,
    Sum: Broadcast,
    Tan: First,
    Tanh: First,
    Tile: Tile,
    Transpose: First,
    Unsqueeze: First,
    Where: Broadcast,
    Xor: Broadcast,
}

/// Returns the cost of an operator; `None` if it is not supported.
pub(super) fn cost_of(operator: &str) -> Option<Cost> {
    OPERATORS.iter().find(|(known, _)| *known == operator).map(|(_, cost)| *cost)
}

/// Returns the inputs of an operator whose numbers, not only their shapes, determine the shape of
/// its output. They must not depend on the observation: otherwise the check of one observation says
/// nothing about the next.
pub(super) fn determines_shape(operator: &str, input: usize) -> bool {
    match operator {
        "ConstantOfShape" => true,
        "Expand" | "Reshape" | "Slice" | "Split" | "Squeeze" | "Tile" | "Unsqueeze" => input > 0,
        // The second is the number of the border.
        "Pad" => matches!(input, 1 | 3),
        _ => input > 0 && operator.starts_with("Reduce"),
    }
}

/// Largest number of inputs and outputs of one operator, and of multiplications for one action.
pub(super) const MAX_NUMBERS: usize = 1 << 24;
pub(super) const MAX_PRODUCTS: usize = 1 << 28;

/// Largest number of numbers that wait for operators which read them.
pub(super) const MAX_HELD: usize = 1 << 26;

/// Returns bounds of the numbers in an operator's outputs and of its multiplications, given its
/// inputs; `None` if they overflow or the inputs have no such shape.
pub(super) fn bound(cost: Cost, inputs: &[Option<&Value>], node: &NodeProto) -> Option<(usize, usize)> {
    let shapes: Vec<Vec<usize>> = inputs
        .iter()
        .flatten()
        .map(|value| value.shape().iter().map(|size| (*size).max(1)).collect())
        .collect();
    let first = shapes.first();
    let sum = || shapes.iter().try_fold(0_usize, |sum, shape| sum.checked_add(product(shape)?));
    let numbers = match cost {
        Cost::First => product(first?)?.max(first?.len()),
        Cost::Broadcast => product(&broadcast(&shapes))?,
        Cost::Sum => sum()?,
        Cost::Product => product(first?)?.checked_mul(product(shapes.get(1)?)?)?,
        Cost::Second => product(shapes.get(1)?)?,
        Cost::Slices => {
            let (indices, rows) = shapes.get(1)?.split_last()?;
            let batch = attribute(node, "batch_dims").map_or(Some(0), |own| usize::try_from(own.i?).ok())?;
            product(rows)?.checked_mul(product(first?.get(batch.checked_add(*indices)?..)?)?)?
        }
        Cost::Pad => {
            let pads =
                pads(inputs, node).filter(|pads| Some(pads.len()) == first.map(|shape| 2 * shape.len()))?;
            let (before, after) = pads.split_at(pads.len() / 2);
            let border = |pad: &i64| usize::try_from(*pad).unwrap_or(0);
            let size = |((size, before), after): ((&usize, &i64), &i64)| {
                size.checked_add(border(before))?.checked_add(border(after))
            };
            let sizes: Option<Vec<usize>> = first?.iter().zip(before).zip(after).map(size).collect();
            product(&sizes?)?
        }
        Cost::Shape => product(&numbers_of(*inputs.first()?)?)?,
        Cost::Expand => product(&broadcast(&[first?.clone(), numbers_of(*inputs.get(1)?)?]))?,
        Cost::Tile => product(first?)?.checked_mul(product(&numbers_of(*inputs.get(1)?)?)?)?,
        Cost::MatMul => return matmul(first?, shapes.get(1)?),
        Cost::Gemm => {
            let [&[a, b], &[c, d]] = [&first?[..], &shapes.get(1)?[..]] else { return None };
            let is_transposed = |name| attribute(node, name).and_then(|own| own.i).unwrap_or(0) != 0;
            let (rows, inner) = if is_transposed("transA") { (b, a) } else { (a, b) };
            let outputs = rows.checked_mul(if is_transposed("transB") { c } else { d })?;
            return Some((outputs, outputs.checked_mul(inner)?));
        }
        Cost::Conv => {
            let ([batch, channels, image @ ..], [outputs, group_channels, kernel @ ..]) =
                (&first?[..], &shapes.get(1)?[..])
            else {
                return None;
            };
            let windows = windows(node, image, kernel)?;
            let groups = attribute(node, "group").map_or(Some(1), |own| usize::try_from(own.i?).ok())?;
            let fits = group_channels.checked_mul(groups)? == *channels && outputs.checked_rem(groups)? == 0;
            let outputs = product(&[*batch, *outputs, windows]).filter(|_| fits)?;
            return Some((outputs, product(&[outputs, *group_channels, product(kernel)?])?));
        }
        Cost::Pool => {
            let [batch, channels, image @ ..] = &first?[..] else { return None };
            let kernel = &attribute(node, "kernel_shape")?.ints;
            let kernel: Vec<usize> = kernel.iter().filter_map(|size| usize::try_from(*size).ok()).collect();
            let outputs = product(&[*batch, *channels, windows(node, image, &kernel)?])?;
            return Some((outputs, outputs.checked_mul(product(&kernel)?)?));
        }
        Cost::Recurrent => {
            // X is [steps, batch, inputs], W [directions, gates, inputs], R [directions, gates,
            // size].
            let ([&[steps, batch, _], &[directions, _, _]], &[_, _, size]) =
                ([&first?[..], &shapes.get(1)?[..]], &shapes.get(2)?[..])
            else {
                return None;
            };
            let outputs = product(&[steps, batch, directions, size, 3])?;
            let weights = product(shapes.get(1)?)?.checked_add(product(shapes.get(2)?)?)?;
            return Some((outputs, product(&[steps, batch, weights])?));
        }
    };
    Some((numbers, numbers.checked_add(sum()?)?))
}

/// Returns an attribute of an operator.
pub(super) fn attribute<'n>(node: &'n NodeProto, name: &str) -> Option<&'n AttributeProto> {
    node.attribute.iter().find(|attribute| attribute.name.as_deref() == Some(name))
}

/// Largest side of an image, and largest stride, dilation, pad and kernel: the runtime computes
/// places in an image in 32 bits.
const MAX_SIDE: usize = 4096;
const MAX_STEP: usize = 256;

/// Returns the number of the windows of an image with one or two sides; `None` if an attribute
/// does not fit the image.
fn windows(node: &NodeProto, image: &[usize], kernel: &[usize]) -> Option<usize> {
    let dims = image.len();
    let of = |name: &str, count: usize, default: usize| -> Option<Vec<usize>> {
        let Some(found) = attribute(node, name) else { return Some(vec![default; count]) };
        let numbers: Vec<usize> = found
            .ints
            .iter()
            .filter_map(|number| usize::try_from(*number).ok().filter(|number| *number <= MAX_STEP))
            .collect();
        (found.ints.len() == count && numbers.len() == count).then_some(numbers)
    };
    let strides = of("strides", dims, 1)?;
    let dilations = of("dilations", dims, 1)?;
    let pads = of("pads", 2 * dims, 0)?;
    let is_small = image.iter().all(|side| *side <= MAX_SIDE) && kernel.iter().all(|side| *side <= MAX_STEP);
    let has_kernel = attribute(node, "kernel_shape").is_some_and(|own| {
        own.ints.iter().eq(kernel.iter().map(|side| *side as i64).collect::<Vec<_>>().iter())
    });
    if !matches!(dims, 1 | 2) || kernel.len() != dims || !is_small || !has_kernel {
        return None;
    }
    let count = |i: usize| {
        let whole = image[i] + pads[i] + pads[dims + i];
        let window = dilations[i] * kernel[i].checked_sub(1)? + 1;
        (dilations[i] > 0).then_some(())?;
        Some(whole.checked_sub(window)?.checked_div(strides[i])? + 1)
    };
    (0..dims).try_fold(1_usize, |product, i| product.checked_mul(count(i)?))
}

fn product(shape: &[usize]) -> Option<usize> {
    shape.iter().try_fold(1_usize, |product, size| product.checked_mul((*size).max(1)))
}

/// Returns the shape to which all shapes are broadcast: aligned at the last dimension, the largest
/// size of each.
fn broadcast(shapes: &[Vec<usize>]) -> Vec<usize> {
    let rank = shapes.iter().map(Vec::len).max().unwrap_or(0);
    let size = |axis: usize| {
        let sizes = shapes.iter().filter_map(|shape| shape.get((axis + shape.len()).checked_sub(rank)?));
        sizes.copied().max().unwrap_or(1)
    };
    (0..rank).map(size).collect()
}

fn matmul(a: &[usize], b: &[usize]) -> Option<(usize, usize)> {
    let (&inner, a) = a.split_last()?;
    let (rows, a) = a.split_last().map_or((1, a), |(rows, a)| (*rows, a));
    let (columns, b) = match b {
        [.., _, columns] => (*columns, &b[..b.len() - 2]),
        _ => (1, &[][..]),
    };
    let batches = product(&broadcast(&[a.to_vec(), b.to_vec()]))?;
    let outputs = product(&[batches, rows, columns])?;
    Some((outputs, outputs.checked_mul(inner)?))
}

/// Returns the numbers of a tensor of integers, negative ones as 1: `-1` stands for a size that
/// another input has.
fn numbers_of(value: Option<&Value>) -> Option<Vec<usize>> {
    Some(integers_of(value)?.into_iter().map(|number| usize::try_from(number).unwrap_or(1)).collect())
}

fn integers_of(value: Option<&Value>) -> Option<Vec<i64>> {
    let tensor: rten_tensor::TensorView<'_, i32> = value?.as_tensor_view()?;
    Some(tensor.iter().map(|number| i64::from(*number)).collect())
}

/// Returns the borders of `Pad`: at the start of each dimension, then at the end of each. Up to
/// opset 10, they are an attribute.
pub(super) fn pads(inputs: &[Option<&Value>], node: &NodeProto) -> Option<Vec<i64>> {
    match attribute(node, "pads") {
        Some(stated) => Some(stated.ints.clone()),
        None => integers_of(*inputs.get(1)?),
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use serde_json::Value;

    use super::OPERATORS;
    use crate::onnx::rewrite::MISSING;

    #[test]
    fn every_supported_operator_is_in_the_guide_and_in_the_comparison_with_the_standard() {
        let known = OPERATORS.iter().map(|(name, _)| *name).chain(MISSING).chain(["Constant"]);
        let known: BTreeSet<&str> = known.collect();
        let guide = include_str!("../../../../docs/guide/onnx.md");
        let list = guide.split("These operators are supported:\n\n").nth(1);
        let list = list.and_then(|text| text.split("\n\n").next()).unwrap_or_default();
        assert_eq!(list.split('`').skip(1).step_by(2).collect::<BTreeSet<_>>(), known);
        let cases: Vec<Value> =
            serde_json::from_str(include_str!("../../tests/golden/onnx/operators.json")).expect("it is JSON");
        let computed = cases.iter().filter(|case| case["expected"].is_string());
        let computed: BTreeSet<&str> = computed.filter_map(|case| case["operator"].as_str()).collect();
        assert_eq!(computed, known);
    }
}
