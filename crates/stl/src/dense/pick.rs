//! Minimum, maximum and absolute value, with breakpoints where lines cross.

use super::piecewise::{Builder, Knot, Piecewise, Sample, interpolate, merge, time_at, zero_crossing};
use super::time::Ticks;
use crate::extremum::Extremum;
use std::convert::Infallible;

/// The function that the result equals in a part of a cell, which is the time between two neighboring knots.
#[derive(Clone, Copy, PartialEq)]
enum Source {
    First,
    Last,
    /// One at an end and the other at the other; they differ by the sign of a zero.
    Both,
}

/// The intersection of two lines.
struct Crossing {
    time: Ticks,
    value: f64,
}

/// Returns where two lines between two times cross: from `x[0]` to `x[1]`, and from `y[0]` to `y[1]`.
fn crossing(times: [Ticks; 2], x: [f64; 2], y: [f64; 2]) -> Option<Crossing> {
    if !((x[0] < y[0] && x[1] > y[1]) || (x[0] > y[0] && x[1] < y[1])) {
        return None;
    }
    let share = zero_crossing(0.5 * x[0] - 0.5 * y[0], 0.5 * x[1] - 0.5 * y[1]);
    let time = time_at(times[0], times[1], share);
    // The rounding of `share` moves the value of the flatter line less.
    let is_flatter = (0.5 * x[1] - 0.5 * x[0]).abs() <= (0.5 * y[1] - 0.5 * y[0]).abs();
    let [a, b] = if is_flatter { x } else { y };
    (times[0] < time && time < times[1]).then(|| Crossing { time, value: interpolate(a, b, share) })
}

/// Returns the pointwise minimum or maximum.
pub(crate) fn pick<E: Extremum>(x: &Piecewise, y: &Piecewise) -> Piecewise {
    let mut out = Builder::default();
    let mut last: Option<(Sample, Sample, Option<Source>)> = None;
    let result = merge(x, y, |in_x, in_y| {
        let mut left = None;
        if let Some((x0, y0, before)) = last {
            let (a, b) = ([x0.knot.after, in_x.knot.before], [y0.knot.after, in_y.knot.before]);
            let ends = [E::pick(a[0], b[0]), E::pick(a[1], b[1])];
            let crossing = crossing([x0.knot.time, in_x.knot.time], a, b);
            let (first, then) = match &crossing {
                Some(_) if ends[0] == a[0] => (Source::First, Source::Last),
                Some(_) => (Source::Last, Source::First),
                None if ends.map(f64::to_bits) == a.map(f64::to_bits) => (Source::First, Source::First),
                None if ends.map(f64::to_bits) == b.map(f64::to_bits) => (Source::Last, Source::Last),
                None => (Source::Both, Source::Both),
            };
            push::<E>(&mut out, x0, y0, before == Some(first), first);
            if let Some(Crossing { time, value }) = crossing {
                out.push(Knot::continuous(time, value));
            }
            left = Some(then);
        }
        last = Some((in_x, in_y, left));
        Ok::<(), Infallible>(())
    });
    let Ok(()) = result;
    if let Some((x, y, _)) = last {
        push::<E>(&mut out, x, y, false, Source::Both);
    }
    out.finish()
}

/// Pushes the extremum at the time of two samples, unless it is in the middle of a line of the source on both sides.
fn push<E: Extremum>(out: &mut Builder, x: Sample, y: Sample, is_same_source: bool, source: Source) {
    let knot = x.knot.zip(y.knot, E::pick);
    let passes = |sample: Sample| !sample.is_knot && sample.knot.at.to_bits() == knot.at.to_bits();
    let is_inside = match source {
        Source::First => passes(x),
        Source::Last => passes(y),
        Source::Both => false,
    };
    if !(is_same_source && is_inside) {
        out.push(knot);
    }
}

/// Returns the absolute value.
pub(crate) fn abs(x: &Piecewise) -> Piecewise {
    let mut out = Builder::default();
    let mut last: Option<&Knot> = None;
    for knot in &x.knots {
        if let Some(last) = last
            && (last.after < 0.0) != (knot.before < 0.0)
        {
            let time = time_at(last.time, knot.time, zero_crossing(last.after, knot.before));
            if last.time < time && time < knot.time {
                out.push(Knot::continuous(time, 0.0));
            }
        }
        out.push(knot.map(f64::abs));
        last = Some(knot);
    }
    out.finish()
}

/// Returns the knots of two functions at equal times: all knots of both, and their crossings. In each cell one
/// function is nowhere below the other.
pub(crate) fn aligned(x: &Piecewise, y: &Piecewise) -> Vec<(Knot, Knot)> {
    let mut knots: Vec<(Knot, Knot)> = Vec::new();
    let result = merge(x, y, |in_x, in_y| {
        let (in_x, in_y) = (in_x.knot, in_y.knot);
        if let Some((x0, y0)) = knots.last()
            && let Some(Crossing { time, value }) =
                crossing([x0.time, in_x.time], [x0.after, in_x.before], [y0.after, in_y.before])
        {
            knots.push((Knot::continuous(time, value), Knot::continuous(time, value)));
        }
        knots.push((in_x, in_y));
        Ok::<(), Infallible>(())
    });
    let Ok(()) = result;
    knots
}
