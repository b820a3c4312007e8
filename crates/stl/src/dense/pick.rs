//! Minimum, maximum and absolute value, with breakpoints where lines cross.

use super::piecewise::{Builder, Knot, Piecewise, Sample, interpolate, merge, time_at, zero_crossing};
use super::time::Ticks;
use crate::extremum::Extremum;
use std::convert::Infallible;

/// The function that the result equals in a part of a cell, which is the time between two
/// neighboring knots.
#[derive(Clone, Copy, PartialEq)]
enum Source {
    First,
    Last,
    /// They are equal up to the signs of zeros, or their crossing is at one of its ends.
    Both,
}

/// The extremum in a cell.
struct Cell {
    /// The values at the start and the end.
    ends: [f64; 2],
    crossing: Option<Crossing>,
    /// The sources before and after the crossing.
    sources: [Source; 2],
}

impl Cell {
    fn new<E: Extremum>(times: [Ticks; 2], x: [f64; 2], y: [f64; 2]) -> Cell {
        let ends = [E::pick(x[0], y[0]), E::pick(x[1], y[1])];
        if let Some(crossing) = crossing(times, x, y) {
            let is_first = ends[0] == x[0];
            let sources =
                if is_first { [Source::First, Source::Last] } else { [Source::Last, Source::First] };
            return Cell { ends, crossing: Some(crossing), sources };
        }
        // At an end where both are zero, the sign is that of the function which is the extremum
        // inside.
        let (ends, source) = match (ends == x, ends == y) {
            (true, false) => (x, Source::First),
            (false, true) => (y, Source::Last),
            _ => (ends, Source::Both),
        };
        Cell { ends, crossing: None, sources: [source; 2] }
    }
}

/// The intersection of two lines.
struct Crossing {
    time: Ticks,
    value: f64,
}

/// Returns where two lines between two times cross: from `x[0]` to `x[1]`, and from `y[0]` to
/// `y[1]`.
fn crossing(times: [Ticks; 2], x: [f64; 2], y: [f64; 2]) -> Option<Crossing> {
    if !((x[0] < y[0] && x[1] > y[1]) || (x[0] > y[0] && x[1] < y[1])) {
        return None;
    }
    let share = zero_crossing(0.5 * x[0] - 0.5 * y[0], 0.5 * x[1] - 0.5 * y[1]);
    let time = time_at(times[0], times[1], share);
    // The rounding of `share` moves the value of the flatter line less.
    let is_flatter = (0.5 * x[1] - 0.5 * x[0]).abs() <= (0.5 * y[1] - 0.5 * y[0]).abs();
    let [a, b] = if is_flatter { x } else { y };
    (times[0] < time && time < times[1]).then(|| Crossing { time, value: interpolate(a, b, share.value) })
}

/// Returns the pointwise minimum or maximum.
pub(crate) fn pick<E: Extremum>(x: &Piecewise, y: &Piecewise) -> Piecewise {
    let mut out = Builder::default();
    // The samples at the last knot, and the cell before it.
    let mut last: Option<([Sample; 2], Option<Cell>)> = None;
    let result = merge(x, y, |in_x, in_y| {
        let samples = [in_x, in_y];
        let cell = last.take().map(|(from, before)| {
            let times = [from[0].knot.time, in_x.knot.time];
            let ends = |index: usize| [from[index].knot.after, samples[index].knot.before];
            let cell = Cell::new::<E>(times, ends(0), ends(1));
            push::<E>(&mut out, from, before.as_ref(), Some(&cell));
            if let Some(Crossing { time, value }) = cell.crossing {
                out.push(Knot::continuous(time, value));
            }
            cell
        });
        last = Some((samples, cell));
        Ok::<(), Infallible>(())
    });
    let Ok(()) = result;
    if let Some((samples, before)) = last {
        push::<E>(&mut out, samples, before.as_ref(), None);
    }
    out.finish()
}

/// Pushes the extremum between two cells, unless it is in the middle of a line of the same source
/// on both sides.
fn push<E: Extremum>(out: &mut Builder, [x, y]: [Sample; 2], before: Option<&Cell>, after: Option<&Cell>) {
    let at = E::pick(x.knot.at, y.knot.at);
    if let (Some(before), Some(after)) = (before, after)
        && before.sources[1] == after.sources[0]
    {
        let passes = |sample: Sample| !sample.is_knot && sample.knot.at.to_bits() == at.to_bits();
        let is_inside = match after.sources[0] {
            Source::First => passes(x),
            Source::Last => passes(y),
            Source::Both => passes(x) && passes(y),
        };
        if is_inside {
            return;
        }
    }
    let before = before.map_or(at, |cell| cell.ends[1]);
    let after = after.map_or(at, |cell| cell.ends[0]);
    out.push(Knot { time: x.knot.time, before, at, after });
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

/// Returns the knots of two functions at equal times: all knots of both, and their crossings. In
/// each cell one function is nowhere below the other.
pub(crate) fn aligned(x: &Piecewise, y: &Piecewise) -> Vec<(Knot, Knot)> {
    let mut knots: Vec<(Knot, Knot)> = Vec::new();
    let result = merge(x, y, |in_x, in_y| {
        let in_x = in_x.knot;
        let in_y = in_y.knot;
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
