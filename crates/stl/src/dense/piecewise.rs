//! Piecewise-linear functions of time with jumps: the values of a sub-formula.

use super::time::Ticks;

/// A breakpoint. A function may jump there, and may have a value that is neither limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Knot {
    pub time: Ticks,
    /// The limit from the left; `at` for the first knot.
    pub before: f64,
    pub at: f64,
    /// The limit from the right; `at` for the last knot.
    pub after: f64,
}

impl Knot {
    /// Returns a knot at which the function is continuous.
    pub(crate) fn continuous(time: Ticks, value: f64) -> Knot {
        Knot { time, before: value, at: value, after: value }
    }

    /// Applies a function to all three values.
    pub(crate) fn map(self, f: impl Fn(f64) -> f64) -> Knot {
        Knot { time: self.time, before: f(self.before), at: f(self.at), after: f(self.after) }
    }

    /// Applies a function to the values of two knots at the time of the first.
    pub(crate) fn zip(self, other: Knot, f: impl Fn(f64, f64) -> f64) -> Knot {
        Knot {
            time: self.time,
            before: f(self.before, other.before),
            at: f(self.at, other.at),
            after: f(self.after, other.after),
        }
    }
}

/// A limit from the left, a value, or a limit from the right.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Side {
    Before,
    At,
    After,
}

const SIDES: [Side; 3] = [Side::Before, Side::At, Side::After];

/// A place at which a function has a value or a limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Point {
    pub time: Ticks,
    pub side: Side,
}

/// A function on the closed interval from its first to its last knot. Between two knots it is the
/// line from the `after` of the first to the `before` of the second. Where one of them is infinite,
/// both are equal.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Piecewise {
    pub knots: Vec<Knot>,
}

impl Piecewise {
    /// Returns a constant function; it is empty if `start > end`.
    pub(crate) fn constant(value: f64, start: Ticks, end: Ticks) -> Piecewise {
        let mut out = Builder::default();
        if start <= end {
            out.push(Knot::continuous(start, value));
        }
        if start < end {
            out.push(Knot::continuous(end, value));
        }
        out.finish()
    }

    /// Returns the first and last time.
    pub(crate) fn domain(&self) -> Option<(Ticks, Ticks)> {
        Some((self.knots.first()?.time, self.knots.last()?.time))
    }

    pub(crate) fn map(mut self, f: impl Fn(f64) -> f64) -> Piecewise {
        self.knots.iter_mut().for_each(|knot| *knot = knot.map(&f));
        self
    }

    /// Returns the function with time reversed: its value at `-t`.
    pub(crate) fn reversed(mut self) -> Piecewise {
        self.knots.reverse();
        for knot in &mut self.knots {
            *knot = Knot { time: -knot.time, before: knot.after, at: knot.at, after: knot.before };
        }
        self
    }

    /// Returns the function on `[start, end]`, with the value `outside` where it is not defined.
    pub(crate) fn clip(&self, start: Ticks, end: Ticks, outside: f64) -> Piecewise {
        let Some((first, last)) = self.domain() else {
            return Piecewise::constant(outside, start, end);
        };
        if start > end || first > end || last < start {
            return Piecewise::constant(outside, start, end);
        }
        let mut out = Builder::default();
        let inside = self.knots.partition_point(|knot| knot.time < start)
            ..self.knots.partition_point(|knot| knot.time <= end);
        if start < first {
            out.push(Knot::continuous(start, outside));
        } else if self.knots[inside.start].time > start {
            out.push(self.between(inside.start, start));
        }
        for knot in &self.knots[inside.clone()] {
            let before = if knot.time == first { outside } else { knot.before };
            let after = if knot.time == last { outside } else { knot.after };
            out.push(Knot { before, after, ..*knot });
        }
        if last < end {
            out.push(Knot::continuous(end, outside));
        } else if inside.is_empty() || self.knots[inside.end - 1].time < end {
            let next = inside.end;
            if out.last_time() != Some(end) {
                out.push(self.between(next, end));
            }
        }
        out.finish()
    }

    /// Returns the value at a time in the domain.
    pub(crate) fn at(&self, time: Ticks) -> Option<f64> {
        let (first, last) = self.domain()?;
        if time < first || time > last {
            return None;
        }
        let next = self.knots.partition_point(|knot| knot.time < time);
        Some(if self.knots[next].time == time { self.knots[next].at } else { self.between(next, time).at })
    }

    /// Returns the points from one to another at which a line can have its extrema, in the order of
    /// time, each with the first knot that is not before it. There are none outside of the domain.
    pub(crate) fn points(
        &self,
        from: Point,
        to: Point,
    ) -> impl DoubleEndedIterator<Item = (Point, usize)> + use<'_> {
        let mut head = Vec::new();
        let mut tail = Vec::new();
        let mut inside = 0..0;
        if let Some((from, to)) = self.cut(from, to) {
            head = self
                .points_at(from.time, |side| side >= from.side && (from.time < to.time || side <= to.side));
            if from.time < to.time {
                tail = self.points_at(to.time, |side| side <= to.side);
                inside = self.knots.partition_point(|knot| knot.time <= from.time)
                    ..self.knots.partition_point(|knot| knot.time < to.time);
            }
        }
        let inside = inside.flat_map(|next| {
            let time = self.knots[next].time;
            SIDES.map(|side| (Point { time, side }, next))
        });
        head.into_iter().chain(inside).chain(tail)
    }

    /// Returns the part of a range of points that is in the domain.
    fn cut(&self, from: Point, to: Point) -> Option<(Point, Point)> {
        // Just before the start and just after the end, there is no value.
        let (start, end) = self.domain()?;
        let from = from.max(Point { time: start, side: Side::At });
        let to = to.min(Point { time: end, side: Side::At });
        (from <= to).then_some((from, to))
    }

    /// Returns the points at a time in the domain, of these sides if there is a knot.
    fn points_at(&self, time: Ticks, has: impl Fn(Side) -> bool) -> Vec<(Point, usize)> {
        let next = self.knots.partition_point(|knot| knot.time < time);
        let point = |side| (Point { time, side }, next);
        if self.knots[next].time == time {
            SIDES.into_iter().filter(|side| has(*side)).map(point).collect()
        } else {
            vec![point(Side::At)]
        }
    }

    /// Returns the value at a point; `next` is the first knot that is not before it.
    pub(crate) fn value(&self, point: Point, next: usize) -> f64 {
        let knot = &self.knots[next];
        match point.side {
            _ if knot.time != point.time => self.between(next, point.time).at,
            Side::Before => knot.before,
            Side::At => knot.at,
            Side::After => knot.after,
        }
    }

    /// Returns the value at a time between knot `next` and the one before it.
    fn between(&self, next: usize, time: Ticks) -> Knot {
        let a = &self.knots[next - 1];
        let b = &self.knots[next];
        if a.after == b.before {
            return Knot::continuous(time, a.after);
        }
        let share = (time - a.time) as f64 / (b.time - a.time) as f64;
        Knot::continuous(time, interpolate(a.after, b.before, share))
    }
}

/// Returns the value at this share of the way from `a` to `b`.
pub(crate) fn interpolate(a: f64, b: f64, share: f64) -> f64 {
    match b - a {
        0.0 => a,
        change if change.is_finite() => a + change * share,
        // Two infinities, or numbers whose difference overflows.
        _ if a == b => a,
        _ => a * (1.0 - share) + b * share,
    }
}

/// A share of the way from one knot to the next, from 0 to 1.
#[derive(Clone, Copy)]
pub(crate) struct Share {
    pub value: f64,
    /// The rounding error of `value`, so that a crossing at a third of 3 s is at 1 s.
    rest: f64,
}

/// Returns where a line from `a` to `b` crosses zero; the signs must differ.
pub(crate) fn zero_crossing(a: f64, b: f64) -> Share {
    // A quarter, so that the difference of two large numbers does not overflow.
    let a = 0.25 * a;
    let b = 0.25 * b;
    if a == b {
        return Share { value: 0.5, rest: 0.0 };
    }
    let change = a - b;
    let added = change - a;
    let lost = (a - (change - added)) - (b + added);
    let value = (a / change).clamp(0.0, 1.0);
    let rest = ((-value).mul_add(change, a) - value * lost) / change;
    Share { value, rest: if rest.abs() < f64::EPSILON { rest } else { 0.0 } }
}

/// Returns the time at this share of the way.
pub(crate) fn time_at(from: Ticks, to: Ticks, share: Share) -> Ticks {
    // In whole numbers of 2⁻⁵³, since few numbers of ticks are exact as `f64`.
    const BITS: u32 = f64::MANTISSA_DIGITS;
    const ONE: f64 = (1_u64 << BITS) as f64;
    let parts = (share.value * ONE).floor();
    let rest = share.value - parts / ONE + share.rest;
    let high = (to - from) >> BITS;
    let low = (to - from) & ((1 << BITS) - 1);
    let whole = high * parts as Ticks + ((low * parts as Ticks) >> BITS);
    from + whole + ((to - from) as f64 * rest).round() as Ticks
}

/// Collects knots in the order of time, and leaves out those in the middle of a constant piece. A
/// piece of zeros gets one sign, which is its verdict.
#[derive(Default)]
pub(crate) struct Builder {
    knots: Vec<Knot>,
}

impl Builder {
    pub(crate) fn push(&mut self, mut knot: Knot) {
        if let Some(last) = self.knots.last()
            && last.after == knot.before
        {
            knot.before = last.after;
        }
        if let [.., a, b] = &self.knots[..] {
            let value = knot.before.to_bits();
            if [a.after, b.before, b.at, b.after].iter().all(|x| x.to_bits() == value) {
                self.knots.pop();
            }
        }
        self.knots.push(knot);
    }

    pub(crate) fn last_time(&self) -> Option<Ticks> {
        self.knots.last().map(|knot| knot.time)
    }

    pub(crate) fn finish(mut self) -> Piecewise {
        if let Some(first) = self.knots.first_mut() {
            first.before = first.at;
        }
        if let Some(last) = self.knots.last_mut() {
            last.after = last.at;
        }
        Piecewise { knots: self.knots }
    }
}

/// The values of a function at a time, and whether it has a knot there.
#[derive(Clone, Copy)]
pub(crate) struct Sample {
    pub knot: Knot,
    pub is_knot: bool,
}

/// Calls `visit` at each time at which one of two functions has a knot, and at the ends of the
/// common domain.
pub(crate) fn merge<F, Error>(x: &Piecewise, y: &Piecewise, mut visit: F) -> Result<(), Error>
where
    F: FnMut(Sample, Sample) -> Result<(), Error>,
{
    let (Some((x_start, x_end)), Some((y_start, y_end))) = (x.domain(), y.domain()) else {
        return Ok(());
    };
    let start = x_start.max(y_start);
    let end = x_end.min(y_end);
    if start > end {
        return Ok(());
    }
    let next = |function: &Piecewise| function.knots.partition_point(|knot| knot.time < start);
    let mut next = [next(x), next(y)];
    let mut time = start;
    loop {
        let sample = |function: &Piecewise, next: usize| {
            let is_knot = function.knots[next].time == time;
            let knot = if is_knot { function.knots[next] } else { function.between(next, time) };
            Sample { knot, is_knot }
        };
        let in_x = sample(x, next[0]);
        let in_y = sample(y, next[1]);
        visit(in_x, in_y)?;
        if time == end {
            return Ok(());
        }
        next[0] += usize::from(in_x.is_knot);
        next[1] += usize::from(in_y.is_knot);
        time = x.knots[next[0]].time.min(y.knots[next[1]].time);
    }
}
