//! Pointwise operators: their value at a sample depends on that sample only.

use crate::extremum::{Extremum, Maximum, Minimum};
use crate::operator::Operator;

/// An operand: one value per sample, or a constant.
#[derive(Clone, Copy)]
pub(crate) enum Values<'a> {
    Signal(&'a [f64]),
    Constant(f64),
}

impl Values<'_> {
    pub(crate) fn at(&self, step: usize) -> f64 {
        match self {
            Values::Signal(values) => values[step],
            Values::Constant(value) => *value,
        }
    }
}

/// Applies a unary operator.
pub(crate) fn map(operator: Operator, x: Values<'_>, out: &mut [f64]) {
    match operator {
        Operator::Negate | Operator::Not => map_with(x, out, |x| -x),
        Operator::Abs => map_with(x, out, f64::abs),
        Operator::Sqrt => map_with(x, out, f64::sqrt),
        Operator::Exp => map_with(x, out, f64::exp),
        Operator::Ln => map_with(x, out, f64::ln),
        _ => unreachable!("{operator:?} is compiled to another kind of instruction"),
    }
}

/// Applies a binary operator.
pub(crate) fn zip(operator: Operator, x: Values<'_>, y: Values<'_>, out: &mut [f64]) {
    match operator {
        Operator::Pow => zip_with(x, y, out, f64::powf),
        Operator::Multiply => zip_with(x, y, out, |x, y| x * y),
        Operator::Divide => zip_with(x, y, out, |x, y| x / y),
        Operator::Add => zip_with(x, y, out, |x, y| x + y),
        Operator::Subtract | Operator::GreaterOrEqual | Operator::Greater => zip_with(x, y, out, difference),
        Operator::LessOrEqual | Operator::Less => zip_with(x, y, out, |x, y| difference(y, x)),
        Operator::Equal | Operator::Iff => zip_with(x, y, out, |x, y| -difference(x, y).abs()),
        Operator::NotEqual | Operator::Xor => zip_with(x, y, out, |x, y| difference(x, y).abs()),
        Operator::And => zip_with(x, y, out, Minimum::pick),
        Operator::Or => zip_with(x, y, out, Maximum::pick),
        Operator::Implies => zip_with(x, y, out, |x, y| Maximum::pick(-x, y)),
        _ => unreachable!("{operator:?} is compiled to another kind of instruction"),
    }
}

/// Returns `x - y`, and 0 for two infinities of the same sign, since equal values have distance 0.
#[inline(always)]
fn difference(x: f64, y: f64) -> f64 {
    if x == y { 0.0 } else { x - y }
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
