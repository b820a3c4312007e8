//! The robustness as a function of time, and when it violates the formula.

use super::piecewise::{Piecewise, time_at, zero_crossing};
use super::time::{MAX_SECONDS, Ticks, seconds, ticks};
use crate::extremum::{Extremum, Minimum};
use crate::verdict::is_violated;

/// A time at which the robustness or its slope jumps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Breakpoint {
    /// The time, s.
    pub time: f64,
    /// The limit from the left; equal to `at` for the first one.
    pub before: f64,
    /// The value.
    pub at: f64,
    /// The limit from the right; equal to `at` for the last one.
    pub after: f64,
}

/// A time during which a formula is violated, s. Both are equal for a single instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Violation {
    /// The first time.
    pub start: f64,
    /// The last time.
    pub end: f64,
    /// The least value or limit in between.
    pub worst: f64,
}

/// The robustness of a formula as a piecewise-linear function of time.
///
/// Between two breakpoints it is the line from the `after` of the first to the `before` of the
/// second.
#[derive(Clone, Debug, PartialEq)]
pub struct DenseRobustness {
    function: Piecewise,
}

impl DenseRobustness {
    /// Merges knots whose times are equal as `f64`.
    pub(crate) fn new(mut function: Piecewise) -> DenseRobustness {
        let start = function.knots.first().map(|knot| knot.time);
        function.knots.dedup_by(|knot, last| {
            let is_same = is_same(knot.time, last.time);
            if is_same {
                (last.at, last.after) = (knot.at, knot.after);
            }
            if is_same && Some(last.time) != start {
                last.time = knot.time;
            }
            is_same
        });
        DenseRobustness { function }
    }

    /// Returns the breakpoints in the order of time, the first and last time among them; none if no
    /// time is decided.
    pub fn breakpoints(&self) -> impl ExactSizeIterator<Item = Breakpoint> {
        self.function.knots.iter().map(|knot| Breakpoint {
            time: seconds(knot.time),
            before: knot.before,
            at: knot.at,
            after: knot.after,
        })
    }

    /// Returns the robustness from one time to another.
    pub(crate) fn within(self, start: Ticks, end: Ticks) -> DenseRobustness {
        match self.function.domain() {
            Some((first, last)) if first < start || end < last => {
                let start = start.max(first);
                let end = end.min(last);
                DenseRobustness { function: self.function.clip(start, end, 0.0) }
            }
            _ => self,
        }
    }

    /// Returns whether there is no time at which the robustness is known.
    pub fn is_empty(&self) -> bool {
        self.function.knots.is_empty()
    }

    /// Returns the first and last time, s; `None` if it is empty.
    pub fn domain(&self) -> Option<(f64, f64)> {
        self.function.domain().map(|(start, end)| (seconds(start), seconds(end)))
    }

    /// Returns the robustness at the first time; `None` if it is empty.
    pub fn first(&self) -> Option<f64> {
        self.function.knots.first().map(|knot| knot.at)
    }

    /// Returns the robustness at a time, s; `None` outside of the domain.
    pub fn at(&self, time: f64) -> Option<f64> {
        if time.is_nan() || time.abs() > MAX_SECONDS {
            return None;
        }
        let time = ticks(time);
        let knots = &self.function.knots;
        let next = knots.partition_point(|knot| knot.time < time);
        // The nearest `f64` finds a breakpoint between two of them.
        let near = &knots[next.saturating_sub(1)..(next + 1).min(knots.len())];
        let found = near.iter().find(|knot| is_same(knot.time, time));
        found.map(|knot| knot.at).or_else(|| self.function.at(time))
    }

    /// Returns when the formula is violated: the intervals in which the robustness is negative or
    /// −0.0, in the order of time. An interval ends where the robustness crosses zero or jumps.
    /// Whether its ends belong to it is not stated.
    ///
    /// # Example
    /// ```
    /// use mishandle_stl::{DenseMonitor, DenseSignal, Formula, Interpolation};
    ///
    /// let d = DenseSignal::new("d", vec![0.0, 1.0, 3.0], vec![0.0, 2.0, 0.0], Interpolation::Linear).unwrap();
    /// let formula = Formula::parse("d <= 1").unwrap();
    /// let monitor = DenseMonitor::new(&formula, &["d".to_owned()], None).unwrap();
    /// let robustness = monitor.robustness_signal(&[d]).unwrap();
    /// let violations: Vec<_> = robustness.violations().iter().map(|found| (found.start, found.end)).collect();
    /// assert_eq!(violations, [(0.5, 2.0)]);
    /// ```
    pub fn violations(&self) -> Vec<Violation> {
        let mut found: Vec<(Ticks, Ticks, f64)> = Vec::new();
        // Whether the formula is violated right before the next piece.
        let mut is_open = false;
        let mut add = |start, end, worst: f64, continues: bool| match found.last_mut() {
            Some(last) if continues => *last = (last.0, end, Minimum::pick(last.2, worst)),
            _ => found.push((start, end, worst)),
        };
        let knots = &self.function.knots;
        for (index, knot) in knots.iter().enumerate() {
            if is_violated(knot.at) {
                add(knot.time, knot.time, knot.at, is_open);
            }
            is_open = is_violated(knot.at);
            let Some(next) = knots.get(index + 1) else { break };
            let a = knot.after;
            let b = next.before;
            let crossing = || time_at(knot.time, next.time, zero_crossing(a, b));
            is_open = match (is_violated(a), is_violated(b)) {
                (true, true) => {
                    add(knot.time, next.time, Minimum::pick(a, b), is_open);
                    true
                }
                (true, false) => {
                    let crossing = crossing();
                    if is_open || crossing > knot.time {
                        add(knot.time, crossing, a, is_open);
                    }
                    false
                }
                (false, true) => {
                    let crossing = crossing();
                    if crossing < next.time {
                        add(crossing, next.time, b, false);
                    }
                    crossing < next.time
                }
                (false, false) => false,
            };
        }
        let violation = |(start, end, worst)| Violation { start: seconds(start), end: seconds(end), worst };
        found.into_iter().map(violation).collect()
    }

    /// Returns the least value or limit with the first time at which it is reached, s; `None` if it
    /// is empty.
    pub fn minimum(&self) -> Option<(f64, f64)> {
        let values =
            |knot: &super::piecewise::Knot| [knot.before, knot.at, knot.after].map(|x| (knot.time, x));
        let least = self
            .function
            .knots
            .iter()
            .flat_map(values)
            .reduce(|least, next| if next.1.total_cmp(&least.1).is_lt() { next } else { least });
        least.map(|(time, value)| (seconds(time), value))
    }
}

/// Returns whether two times are equal as `f64`.
fn is_same(a: Ticks, b: Ticks) -> bool {
    a == b || ((a - b).abs() <= (a.abs() >> 50) && seconds(a) == seconds(b))
}
