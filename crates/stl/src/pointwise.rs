//! Pointwise operators: their value at a sample depends on that sample only.

use crate::extremum::{Extremum, Maximum, Minimum};
use crate::operator::{Operator, Shape};

/// An operand: one value per sample, or a constant.
#[derive(Clone, Copy)]
pub(crate) enum Values<'a> {
    Signal(&'a [f64]),
    Constant(f64),
}

impl Values<'_> {
    fn at(&self, step: usize) -> f64 {
        match self {
            Values::Signal(values) => values[step],
            Values::Constant(value) => *value,
        }
    }
}

/// Arithmetic without a finite value at a sample.
#[derive(Clone, Debug)]
pub(crate) struct Undefined {
    /// The operation with the values of its operands.
    pub operation: String,
    pub step: usize,
}

impl Undefined {
    /// Moves the sample by `first` samples.
    pub(crate) fn after(self, first: usize) -> Undefined {
        Undefined { step: first + self.step, ..self }
    }
}

/// Applies an operator to `x` and `y`, or to `x` alone.
///
/// # Errors
/// If arithmetic has no value at a sample: it is NaN, or infinite although its operands are finite.
pub(crate) fn apply(
    operator: Operator,
    x: Values<'_>,
    y: Values<'_>,
    out: &mut [f64],
) -> Result<(), Undefined> {
    compute(operator, x, y, out);
    if !operator.is_arithmetic() || all_finite(out) {
        return Ok(());
    }
    let operands = &[x, y][..operator.arity()];
    let is_undefined = |step: &usize| {
        let is_finite = |values: &Values<'_>| values.at(*step).is_finite();
        out[*step].is_nan() || (out[*step].is_infinite() && operands.iter().all(is_finite))
    };
    let Some(step) = (0..out.len()).find(is_undefined) else { return Ok(()) };
    let operands: Vec<String> = operands.iter().map(|values| values.at(step).to_string()).collect();
    let operation = match operator.shape() {
        Shape::Infix => operands.join(&format!(" {} ", operator.name())),
        _ => format!("{}({})", operator.name(), operands.join(", ")),
    };
    Err(Undefined { operation, step })
}

/// Applies an operator to the values of one sample, or to `x` alone.
///
/// # Errors
/// As for [`apply`]; the step is 0.
#[inline]
pub(crate) fn apply_once(operator: Operator, x: f64, y: f64) -> Result<f64, Undefined> {
    let mut out = [0.0];
    compute(operator, Values::Constant(x), Values::Constant(y), &mut out);
    if operator.is_arithmetic() && !out[0].is_finite() {
        apply(operator, Values::Constant(x), Values::Constant(y), &mut out)?;
    }
    Ok(out[0])
}

fn compute(operator: Operator, x: Values<'_>, y: Values<'_>, out: &mut [f64]) {
    match operator {
        Operator::Negate | Operator::Not => map_with(x, out, |x| -x),
        Operator::Abs => map_with(x, out, f64::abs),
        Operator::Sqrt => map_with(x, out, f64::sqrt),
        Operator::Exp => map_with(x, out, f64::exp),
        Operator::Ln => map_with(x, out, f64::ln),
        Operator::Pow => zip_with(x, y, out, f64::powf),
        Operator::Multiply => zip_with(x, y, out, |x, y| x * y),
        Operator::Divide => zip_with(x, y, out, |x, y| x / y),
        Operator::Add => zip_with(x, y, out, |x, y| x + y),
        Operator::Subtract | Operator::GreaterOrEqual => zip_with(x, y, out, difference),
        Operator::LessOrEqual => zip_with(x, y, out, |x, y| difference(y, x)),
        // The negation of a comparison that holds for equal values is −0.0 for them: it fails.
        Operator::Greater => zip_with(x, y, out, |x, y| -difference(y, x)),
        Operator::Less => zip_with(x, y, out, |x, y| -difference(x, y)),
        Operator::Equal => zip_with(x, y, out, equality),
        Operator::NotEqual => zip_with(x, y, out, |x, y| -equality(x, y)),
        Operator::And => zip_with(x, y, out, Minimum::pick),
        Operator::Or => zip_with(x, y, out, Maximum::pick),
        Operator::Implies => zip_with(x, y, out, |x, y| Maximum::pick(-x, y)),
        Operator::Iff => zip_with(x, y, out, equivalence),
        Operator::Xor => zip_with(x, y, out, |x, y| -equivalence(x, y)),
        _ => unreachable!("{operator:?} is compiled to another kind of instruction"),
    }
}

/// Returns `x - y`, and +0.0 for equal values, also for two infinities and for zeros of both signs.
#[inline(always)]
fn difference(x: f64, y: f64) -> f64 {
    if x == y { 0.0 } else { x - y }
}

/// Returns `-|x - y|`, and +0.0 for equal values, which satisfy `==`.
#[inline(always)]
fn equality(x: f64, y: f64) -> f64 {
    0.0 - difference(x, y).abs()
}

/// Returns the robustness of `(x and y) or (not x and not y)`.
#[inline(always)]
fn equivalence(x: f64, y: f64) -> f64 {
    Maximum::pick(Minimum::pick(x, y), Minimum::pick(-x, -y))
}

#[inline(always)]
fn map_with(x: Values<'_>, out: &mut [f64], f: impl Fn(f64) -> f64) {
    match x {
        Values::Signal(x) => out.iter_mut().zip(x).for_each(|(out, x)| *out = f(*x)),
        Values::Constant(x) => out.fill(f(x)),
    }
}

#[inline(always)]
fn zip_with(x: Values<'_>, y: Values<'_>, out: &mut [f64], f: impl Fn(f64, f64) -> f64) {
    match (x, y) {
        (Values::Signal(x), Values::Signal(y)) => {
            out.iter_mut().zip(x).zip(y).for_each(|((out, x), y)| *out = f(*x, *y));
        }
        (Values::Signal(x), Values::Constant(y)) => {
            out.iter_mut().zip(x).for_each(|(out, x)| *out = f(*x, y));
        }
        (Values::Constant(x), Values::Signal(y)) => {
            out.iter_mut().zip(y).for_each(|(out, y)| *out = f(x, *y));
        }
        (Values::Constant(x), Values::Constant(y)) => out.fill(f(x, y)),
    }
}

/// Returns whether every value is finite.
pub(crate) fn all_finite(values: &[f64]) -> bool {
    values.iter().fold(true, |finite, value| finite & (value.abs() < f64::INFINITY))
}
