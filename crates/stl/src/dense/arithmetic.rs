//! Operators whose value at a time depends on that time only.

use super::error::DenseError;
use super::pick::{abs, pick};
use super::piecewise::{Builder, Knot, Piecewise, merge};
use super::time::seconds;
use crate::extremum::{Maximum, Minimum};
use crate::operator::Operator;
use crate::pointwise::{self, Values};

/// Applies an operator to `x`.
pub(crate) fn unary(operator: Operator, x: Piecewise) -> Result<Piecewise, DenseError> {
    match operator {
        Operator::Negate | Operator::Not => Ok(x.map(|x| -x)),
        Operator::Abs => Ok(abs(&x)),
        _ => {
            let same = x.clone();
            zip(operator, &x, &same)
        }
    }
}

/// Applies an operator to `x` and `y`.
pub(crate) fn binary(operator: Operator, x: Piecewise, y: Piecewise) -> Result<Piecewise, DenseError> {
    Ok(match operator {
        Operator::And => pick::<Minimum>(&x, &y),
        Operator::Or => pick::<Maximum>(&x, &y),
        Operator::Implies => pick::<Maximum>(&x.map(|x| -x), &y),
        Operator::Iff => equivalence(x, y),
        Operator::Xor => equivalence(x, y).map(|x| -x),
        Operator::Equal => equality(&x, &y)?,
        Operator::NotEqual => equality(&x, &y)?.map(|x| -x),
        _ => zip(operator, &x, &y)?,
    })
}

/// Returns the robustness of `(x and y) or (not x and not y)`.
fn equivalence(x: Piecewise, y: Piecewise) -> Piecewise {
    let both = pick::<Minimum>(&x, &y);
    let neither = pick::<Minimum>(&x.map(|x| -x), &y.map(|y| -y));
    pick::<Maximum>(&both, &neither)
}

/// Returns `0 - |x - y|`.
fn equality(x: &Piecewise, y: &Piecewise) -> Result<Piecewise, DenseError> {
    // A comparison yields a difference without the checks of arithmetic.
    Ok(abs(&zip(Operator::GreaterOrEqual, x, y)?).map(|distance| 0.0 - distance))
}

/// Applies an operator to the values at each knot. Between two knots the result must be a line.
fn zip(operator: Operator, x: &Piecewise, y: &Piecewise) -> Result<Piecewise, DenseError> {
    let mut out = Builder::default();
    let mut last: Option<Knot> = None;
    merge(x, y, |in_x, in_y| {
        let mut knot = in_x.knot.zip(in_y.knot, |x, y| value(operator, x, y));
        let undefined = || undefined(operator, in_x.knot, in_y.knot);
        if operator.is_arithmetic() && ![knot.before, knot.at, knot.after].iter().all(|x| x.is_finite()) {
            undefined()?;
        }
        if let Some(mut last) = last.take() {
            let ends = [last.after, knot.before];
            if ends[0] != ends[1] && ends.iter().any(|x| x.is_infinite()) {
                // The difference of two finite numbers overflows at one end; or, in arithmetic, a
                // line goes through zero where the other operand is infinite.
                let is_comparison =
                    operator.is_comparison() && [in_x, in_y].iter().all(|x| x.knot.before.is_finite());
                if !is_comparison {
                    return Err(mixed(operator, in_x.knot, in_y.knot));
                }
                last.after = last.after.clamp(-f64::MAX, f64::MAX);
                knot.before = knot.before.clamp(-f64::MAX, f64::MAX);
            }
            out.push(last);
        }
        last = Some(knot);
        Ok(())
    })?;
    last.into_iter().for_each(|knot| out.push(knot));
    Ok(out.finish())
}

/// Returns the value of an operator without a check.
fn value(operator: Operator, x: f64, y: f64) -> f64 {
    match operator {
        Operator::Add => x + y,
        Operator::Multiply => x * y,
        Operator::Divide => x / y,
        _ => {
            let mut out = [0.0];
            pointwise::compute(operator, Values::Constant(x), Values::Constant(y), &mut out);
            out[0]
        }
    }
}

/// Returns an error if arithmetic has no value at a knot, or as a limit there.
fn undefined(operator: Operator, x: Knot, y: Knot) -> Result<(), DenseError> {
    for (a, b) in [(x.at, y.at), (x.before, y.before), (x.after, y.after)] {
        let found = pointwise::apply(operator, Values::Constant(a), Values::Constant(b), &mut [0.0]);
        found.map_err(|found| DenseError::Undefined { operation: found.operation, time: seconds(x.time) })?;
    }
    Ok(())
}

/// Returns the error about a line that would lead from an infinite value to another value.
fn mixed(operator: Operator, x: Knot, y: Knot) -> DenseError {
    let operation = format!("{} {} {}", x.before, operator.name(), y.before);
    DenseError::Undefined { operation, time: seconds(x.time) }
}
