//! Time: intervals as they are written, and the clock that turns their bounds into counts of samples.

use crate::error::MonitorError;
use std::fmt;

/// A unit of time, as it may follow an interval bound.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// `s`
    Seconds,
    /// `ms`
    Milliseconds,
    /// `us`
    Microseconds,
    /// `ns`
    Nanoseconds,
}

impl Unit {
    /// Every unit, the longest first.
    pub const ALL: [Unit; 4] = [Unit::Seconds, Unit::Milliseconds, Unit::Microseconds, Unit::Nanoseconds];

    /// How the unit is written.
    pub fn symbol(self) -> &'static str {
        ["s", "ms", "us", "ns"][self as usize]
    }

    /// How many of the unit make a second.
    fn per_second(self) -> f64 {
        [1.0, 1e3, 1e6, 1e9][self as usize]
    }
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.symbol())
    }
}

/// One end of an interval as written: a number that is not negative, with or without a unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bound {
    pub value: f64,
    pub unit: Option<Unit>,
}

impl fmt::Display for Bound {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.value)?;
        self.unit.map_or(Ok(()), |unit| write!(f, "{unit}"))
    }
}

/// The interval of a temporal operator as written; both ends have a unit or neither has, and begin is at most end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Interval {
    pub begin: Bound,
    pub end: Bound,
}

impl Interval {
    /// Whether the begin lies after the end. Both have units or neither has.
    pub(crate) fn is_reversed(&self) -> bool {
        let in_nanoseconds = |bound: Bound| match bound.unit {
            Some(unit) => bound.value * (1e9 / unit.per_second()),
            None => bound.value,
        };
        in_nanoseconds(self.begin) > in_nanoseconds(self.end)
    }
}

impl fmt::Display for Interval {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "[{}:{}]", self.begin, self.end)
    }
}

/// An interval counted in samples: `begin <= end`, and `usize::MAX` for an end that never comes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Window {
    pub begin: usize,
    pub end: usize,
}

impl Window {
    /// The window of an operator without an interval: all the time there is.
    pub(crate) const UNBOUNDED: Window = Window { begin: 0, end: usize::MAX };
}

/// The latest sample that a bound may name: so few that those of the longest formula add up to less than 2^63, and more
/// than a trace of 60 samples a second has after four thousand years.
const LATEST: f64 = (1_u64 << 43) as f64;

/// The sampling period, and what an interval bound without a unit means.
///
/// A bound has to fall on a sample. It does if it lies within a billionth of a whole number of periods, relative to
/// that number, so that 5 s are 300 steps of 1/60 s although no `f64` holds 1/60 exactly.
///
/// # Example
/// `[0:2]` is two control steps for the one clock and two seconds, twenty samples, for the other:
/// ```
/// use mishandle_stl::{Clock, Formula, Monitor, Unit};
///
/// let names = ["d".to_owned()];
/// let formula = Formula::parse("always[0:2](d <= 0.3)").unwrap();
/// let steps = Monitor::new(&formula, &names, Clock::steps(0.1)).unwrap();
/// assert_eq!(steps.horizon(), Some(2));
/// let seconds = Monitor::new(&formula, &names, Clock::rtamt(0.1, Unit::Seconds)).unwrap();
/// assert_eq!(seconds.horizon(), Some(20));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clock {
    period_secs: f64,
    bare: Bare,
}

/// What a bound without a unit counts.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Bare {
    Steps,
    Time(Unit),
}

impl Clock {
    /// Samples `dt` seconds apart; a bound without a unit counts control steps.
    pub fn steps(dt: f64) -> Clock {
        Clock { period_secs: dt, bare: Bare::Steps }
    }

    /// RTAMT's reading: samples `period_secs` apart; a bound without a unit is in `unit` (RTAMT's own default is the
    /// second, with a period of 1 s).
    pub fn rtamt(period_secs: f64, unit: Unit) -> Clock {
        Clock { period_secs, bare: Bare::Time(unit) }
    }

    /// The sampling period, s.
    pub fn period_secs(&self) -> f64 {
        self.period_secs
    }

    /// The time of a sample, s.
    pub(crate) fn time_secs(&self, step: usize) -> f64 {
        step as f64 * self.period_secs
    }

    /// Accepts a positive, finite period only.
    pub(crate) fn check(&self) -> Result<(), MonitorError> {
        if self.period_secs > 0.0 && self.period_secs.is_finite() {
            Ok(())
        } else {
            Err(MonitorError::BadPeriod { period_secs: self.period_secs })
        }
    }

    /// The interval of `operator` in samples.
    pub(crate) fn window(&self, operator: &str, interval: Option<Interval>) -> Result<Window, MonitorError> {
        let Some(interval) = interval else { return Ok(Window::UNBOUNDED) };
        let samples = |bound: Bound| {
            self.samples(bound).map_err(|samples| {
                let (operator, bound) = (operator.to_owned(), self.describe(bound));
                if samples > LATEST {
                    return MonitorError::TooLate { operator, bound, samples };
                }
                MonitorError::NotAMultiple { operator, bound, samples, period_secs: self.period_secs }
            })
        };
        Ok(Window { begin: samples(interval.begin)?, end: samples(interval.end)? })
    }

    /// The bound in samples, or, where it falls between two or past the latest, its quotient by the period.
    fn samples(&self, bound: Bound) -> Result<usize, f64> {
        if bound.value.is_infinite() {
            return Ok(usize::MAX);
        }
        let unit = bound.unit.or(match self.bare {
            Bare::Steps => None,
            Bare::Time(unit) => Some(unit),
        });
        let samples = match unit {
            Some(unit) => bound.value / (self.period_secs * unit.per_second()),
            None => bound.value,
        };
        let whole = samples.round();
        let on_a_sample = samples == whole || (samples - whole).abs() <= 1e-9 * whole;
        if on_a_sample && whole <= LATEST { Ok(whole as usize) } else { Err(samples) }
    }

    /// The bound as written, with the unit that the clock gives it.
    fn describe(&self, bound: Bound) -> String {
        match (bound.unit, self.bare) {
            (None, Bare::Steps) => format!("{bound} (steps)"),
            (None, Bare::Time(unit)) => format!("{bound} {unit}"),
            (Some(unit), _) => format!("{} {unit}", bound.value),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(clock: Clock, value: f64, unit: Option<Unit>, expected: Result<usize, f64>) {
        assert_eq!(clock.samples(Bound { value, unit }), expected);
    }

    #[test]
    fn a_bound_is_a_whole_number_of_samples() {
        let control = Clock::steps(1.0 / 60.0);
        check(control, 5.0, Some(Unit::Seconds), Ok(300));
        check(control, 50.0, Some(Unit::Milliseconds), Ok(3));
        check(control, 86_400.0, Some(Unit::Seconds), Ok(5_184_000));
        check(control, 0.01, Some(Unit::Seconds), Err(0.6));
        check(control, 7.0, None, Ok(7));
        check(control, 0.5, None, Err(0.5));
        check(control, f64::INFINITY, None, Ok(usize::MAX));
        check(Clock::rtamt(0.1, Unit::Seconds), 0.3, None, Ok(3));
        check(Clock::rtamt(0.1, Unit::Milliseconds), 300.0, None, Ok(3));
        check(control, LATEST, None, Ok(1 << 43));
        check(control, LATEST + 1.0, None, Err(LATEST + 1.0));
        check(Clock::rtamt(1.0, Unit::Seconds), 1e300, None, Err(1e300));
        check(Clock::steps(1e-9), 1e300, Some(Unit::Seconds), Err(f64::INFINITY));
    }

    #[test]
    fn intervals_of_mixed_units_are_compared_in_time() {
        let bound = |value, unit| Bound { value, unit: Some(unit) };
        let reversed = |begin, end| Interval { begin, end }.is_reversed();
        assert!(!reversed(bound(500.0, Unit::Milliseconds), bound(1.0, Unit::Seconds)));
        assert!(!reversed(bound(1000.0, Unit::Milliseconds), bound(1.0, Unit::Seconds)));
        assert!(reversed(bound(2.0, Unit::Seconds), bound(5.0, Unit::Milliseconds)));
    }
}
