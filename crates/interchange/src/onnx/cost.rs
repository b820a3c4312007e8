//! The supported operators, with bounds on the memory and the time that each needs.
//!
//! The runtime limits neither. The size of an operator's output follows from the shapes of its
//! inputs, and for some operators from the numbers in an input. A bound counts each empty dimension
//! as 1, since a reduction over it makes 1.

use rten::{OpRegistry, Value, op_registry};
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
    /// The first input, broadcast to the shape in the second.
    Expand,
    /// The first input, repeated as often as the second says.
    Tile,
    /// The shape in the first input.
    Shape,
    /// A recurrent layer.
    Recurrent,
}

/// Declares the table of operators and the registry of the runtime from one list.
macro_rules! operators {
    ($($operator:ident: $cost:ident,)*) => {
        /// The supported operators of the standard domain, in alphabetical order, besides
        /// `Constant`.
        pub(super) const OPERATORS: &[(&str, Cost)] = &[$((stringify!($operator), Cost::$cost)),*];

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
    BatchNormalization: First,
    Cast: First,
    CastLike: First,
    Ceil: First,
    Clip: First,
    Concat: Sum,
    ConstantOfShape: Shape,
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
    Gelu: First,
    Gemm: Gemm,
    Greater: Broadcast,
    GreaterOrEqual: Broadcast,
    HardSigmoid: First,
    HardSwish: First,
    Identity: First,
    LSTM: Recurrent,
    LayerNormalization: First,
    LeakyRelu: First,
    Less: Broadcast,
    LessOrEqual: Broadcast,
    Log: First,
    LogSoftmax: First,
    MatMul: MatMul,
    Max: Broadcast,
    Mean: Broadcast,
    Min: Broadcast,
    Mod: Broadcast,
    Mul: Broadcast,
    Neg: First,
    Not: First,
    Or: Broadcast,
    PRelu: Broadcast,
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
        _ => input > 0 && operator.starts_with("Reduce"),
    }
}

/// Largest number of inputs and outputs of one operator, and of multiplications for one action.
pub(super) const MAX_NUMBERS: usize = 1 << 24;
pub(super) const MAX_PRODUCTS: usize = 1 << 28;

/// Largest number of numbers that wait for operators which read them.
pub(super) const MAX_HELD: usize = 1 << 26;

/// Returns bounds of the numbers in an operator's outputs and of its multiplications, given its
/// inputs; `None` if they overflow or the inputs have no such shape. `transposed` says which
/// factors of `Gemm` are.
pub(super) fn bound(cost: Cost, inputs: &[Option<&Value>], transposed: [bool; 2]) -> Option<(usize, usize)> {
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
        Cost::Shape => product(&numbers_of(*inputs.first()?)?)?,
        Cost::Expand => product(&broadcast(&[first?.clone(), numbers_of(*inputs.get(1)?)?]))?,
        Cost::Tile => product(first?)?.checked_mul(product(&numbers_of(*inputs.get(1)?)?)?)?,
        Cost::MatMul => return matmul(first?, shapes.get(1)?),
        Cost::Gemm => {
            let [&[a, b], &[c, d]] = [&first?[..], &shapes.get(1)?[..]] else { return None };
            let (rows, inner) = if transposed[0] { (b, a) } else { (a, b) };
            let outputs = rows.checked_mul(if transposed[1] { c } else { d })?;
            return Some((outputs, outputs.checked_mul(inner)?));
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
    let tensor: rten_tensor::TensorView<'_, i32> = value?.as_tensor_view()?;
    Some(tensor.iter().map(|number| usize::try_from(*number).unwrap_or(1)).collect())
}
