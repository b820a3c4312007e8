//! Time bounds as written in a formula, and the clock that converts them to samples.

use crate::error::MonitorError;
use crate::number::Shown;
use std::fmt;

/// A unit of time that may follow an interval bound.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum TimeUnit {
    /// `s`
    #[cfg_attr(feature = "serde", serde(rename = "s"))]
    Seconds,
    /// `ms`
    #[cfg_attr(feature = "serde", serde(rename = "ms"))]
    Milliseconds,
    /// `us`
    #[cfg_attr(feature = "serde", serde(rename = "us"))]
    Microseconds,
    /// `ns`
    #[cfg_attr(feature = "serde", serde(rename = "ns"))]
    Nanoseconds,
}

impl TimeUnit {
    /// All units, longest first.
    pub const ALL: [TimeUnit; 4] =
        [TimeUnit::Seconds, TimeUnit::Milliseconds, TimeUnit::Microseconds, TimeUnit::Nanoseconds];

    /// Returns the symbol of the unit as written in a formula.
    pub fn symbol(self) -> &'static str {
        ["s", "ms", "us", "ns"][self as usize]
    }

    /// Returns the number of these units in one second.
    fn per_second(self) -> f64 {
        [1.0, 1e3, 1e6, 1e9][self as usize]
    }
}

impl fmt::Display for TimeUnit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.symbol())
    }
}

/// An interval bound as written: a nonnegative number with an optional unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bound {
    pub value: f64,
    pub unit: Option<TimeUnit>,
}

impl fmt::Display for Bound {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", Shown(self.value))?;
        // `infs` does not parse.
        let unit = self.unit.filter(|_| self.value.is_finite());
        unit.map_or(Ok(()), |unit| write!(f, "{unit}"))
    }
}

/// The interval of a temporal operator as written. Either both bounds have a unit or neither has;
/// `begin <= end`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Interval {
    pub begin: Bound,
    pub end: Bound,
}

impl Interval {
    /// Returns whether the begin is later than the end. Either both bounds must have a unit or
    /// neither.
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

/// An interval in samples: `begin <= end`; `end` is `usize::MAX` if the interval is unbounded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Window {
    pub begin: usize,
    pub end: usize,
}

impl Window {
    /// The window of an operator without an interval.
    pub(crate) const UNBOUNDED: Window = Window { begin: 0, end: usize::MAX };

    pub(crate) fn is_unbounded(self) -> bool {
        self.end == usize::MAX
    }

    /// Returns the number of samples in the window.
    pub(crate) fn length(self) -> usize {
        (self.end - self.begin).saturating_add(1)
    }
}

/// The largest bound, in samples. The bounds of the longest formula add up to less than 2^63. A
/// trace with 60 samples per second reaches this number after four thousand years.
const MAX_BOUND: f64 = (1_u64 << 43) as f64;

/// The sampling period, and the meaning of an interval bound without a unit.
///
/// A bound must be a whole number of sampling periods, up to a relative error of 1e-9. So 5 s are
/// 300 steps of 1/60 s although no `f64` equals 1/60.
///
/// # Example
/// `[0:2]` means two control steps for the first clock and two seconds, or twenty samples, for the
/// second:
/// ```
/// use mishandle_stl::{Clock, Formula, Monitor, TimeUnit};
///
/// let names = ["d".to_owned()];
/// let formula = Formula::parse("always[0:2](d <= 0.3)").unwrap();
/// let steps = Monitor::new(&formula, &names, Clock::steps(0.1)).unwrap();
/// assert_eq!(steps.horizon(), Some(2));
/// let seconds = Monitor::new(&formula, &names, Clock::rtamt(0.1, TimeUnit::Seconds)).unwrap();
/// assert_eq!(seconds.horizon(), Some(20));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clock {
    /// `None` if it is unknown.
    period_secs: Option<f64>,
    bare_bound: BareBound,
}

/// The meaning of a bound without a unit.
#[derive(Clone, Copy, Debug, PartialEq)]
enum BareBound {
    Steps,
    Time(TimeUnit),
}

impl Clock {
    /// Creates a clock with a sampling period of `dt` seconds. A bound without a unit counts
    /// control steps.
    pub fn steps(dt: f64) -> Clock {
        Clock { period_secs: Some(dt), bare_bound: BareBound::Steps }
    }

    /// Creates a clock for samples whose period is unknown. A bound without a unit counts samples;
    /// one with a unit is an error, unless it is 0.
    pub fn unknown() -> Clock {
        Clock { period_secs: None, bare_bound: BareBound::Steps }
    }

    /// Creates a clock for samples whose period is unknown, with RTAMT's convention: a bound
    /// without a unit is in `unit`, and an error unless it is 0.
    pub fn unknown_rtamt(unit: TimeUnit) -> Clock {
        Clock { period_secs: None, bare_bound: BareBound::Time(unit) }
    }

    /// Creates a clock with RTAMT's convention: a sampling period of `period_secs` seconds, and a
    /// bound without a unit is in `unit`. RTAMT's defaults are a period of 1 s and seconds.
    pub fn rtamt(period_secs: f64, unit: TimeUnit) -> Clock {
        Clock { period_secs: Some(period_secs), bare_bound: BareBound::Time(unit) }
    }

    /// Returns the sampling period in seconds, if it is known.
    pub fn period_secs(&self) -> Option<f64> {
        self.period_secs
    }

    /// Returns the unit of a bound without one; `None` if it counts samples.
    pub(crate) fn bare_unit(&self) -> Option<TimeUnit> {
        match self.bare_bound {
            BareBound::Steps => None,
            BareBound::Time(unit) => Some(unit),
        }
    }

    /// Returns the time of a sample in seconds; NaN if the period is unknown.
    pub(crate) fn time_secs(&self, step: usize) -> f64 {
        step as f64 * self.period_secs.unwrap_or(f64::NAN)
    }

    /// Checks that the period is positive and finite, if it is known.
    pub(crate) fn check(&self) -> Result<(), MonitorError> {
        match self.period_secs {
            Some(period_secs) if !(period_secs > 0.0 && period_secs.is_finite()) => {
                Err(MonitorError::InvalidPeriod { period_secs })
            }
            _ => Ok(()),
        }
    }

    /// Converts the interval of `operator` to samples.
    pub(crate) fn window(&self, operator: &str, interval: Option<Interval>) -> Result<Window, MonitorError> {
        let Some(interval) = interval else { return Ok(Window::UNBOUNDED) };
        let samples = |bound: Bound| {
            self.samples(bound).map_err(|samples| {
                let operator = operator.to_owned();
                let bound = self.describe(bound);
                let period_secs = self.time_secs(1);
                match samples {
                    _ if samples.is_nan() => MonitorError::UnknownPeriod { operator, bound },
                    _ if samples > MAX_BOUND => MonitorError::BoundTooLarge { operator, bound, samples },
                    _ => MonitorError::NotAMultiple { operator, bound, samples, period_secs },
                }
            })
        };
        Ok(Window { begin: samples(interval.begin)?, end: samples(interval.end)? })
    }

    /// Converts a bound to samples. The error is the bound divided by the period: not a whole
    /// number, too large, or NaN if the period is unknown.
    fn samples(&self, bound: Bound) -> Result<usize, f64> {
        if bound.value.is_infinite() {
            return Ok(usize::MAX);
        }
        if bound.value == 0.0 {
            return Ok(0);
        }
        let unit = bound.unit.or(match self.bare_bound {
            BareBound::Steps => None,
            BareBound::Time(unit) => Some(unit),
        });
        let samples = match unit {
            Some(unit) => bound.value / (self.period_secs.unwrap_or(f64::NAN) * unit.per_second()),
            None => bound.value,
        };
        let whole = samples.round();
        let is_whole = samples == whole || (samples - whole).abs() <= 1e-9 * whole;
        if is_whole && whole <= MAX_BOUND { Ok(whole as usize) } else { Err(samples) }
    }

    /// Returns the bound as text, with its unit.
    fn describe(&self, bound: Bound) -> String {
        match (bound.unit, self.bare_bound) {
            (None, BareBound::Steps) => format!("{bound} (steps)"),
            (None, BareBound::Time(unit)) => format!("{bound} {unit}"),
            (Some(unit), _) => format!("{} {unit}", Shown(bound.value)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(clock: Clock, value: f64, unit: Option<TimeUnit>, expected: Result<usize, f64>) {
        assert_eq!(clock.samples(Bound { value, unit }), expected);
    }

    #[test]
    fn a_bound_must_be_a_whole_number_of_samples() {
        let control = Clock::steps(1.0 / 60.0);
        check(control, 5.0, Some(TimeUnit::Seconds), Ok(300));
        check(control, 50.0, Some(TimeUnit::Milliseconds), Ok(3));
        check(control, 86_400.0, Some(TimeUnit::Seconds), Ok(5_184_000));
        check(control, 0.01, Some(TimeUnit::Seconds), Err(0.6));
        check(control, 7.0, None, Ok(7));
        check(control, 0.5, None, Err(0.5));
        check(control, f64::INFINITY, None, Ok(usize::MAX));
        check(Clock::rtamt(0.1, TimeUnit::Seconds), 0.3, None, Ok(3));
        check(Clock::rtamt(0.1, TimeUnit::Milliseconds), 300.0, None, Ok(3));
        check(control, MAX_BOUND, None, Ok(1 << 43));
        check(control, MAX_BOUND + 1.0, None, Err(MAX_BOUND + 1.0));
        check(Clock::rtamt(1.0, TimeUnit::Seconds), 1e300, None, Err(1e300));
        check(Clock::steps(1e-9), 1e300, Some(TimeUnit::Seconds), Err(f64::INFINITY));
        check(Clock::unknown(), 0.0, Some(TimeUnit::Seconds), Ok(0));
        check(Clock::unknown(), 7.0, None, Ok(7));
        assert!(Clock::unknown().samples(Bound { value: 1.0, unit: Some(TimeUnit::Seconds) }).is_err());
    }

    #[test]
    fn bounds_with_different_units_are_compared_as_durations() {
        let bound = |value, unit| Bound { value, unit: Some(unit) };
        let reversed = |begin, end| Interval { begin, end }.is_reversed();
        assert!(!reversed(bound(500.0, TimeUnit::Milliseconds), bound(1.0, TimeUnit::Seconds)));
        assert!(!reversed(bound(1000.0, TimeUnit::Milliseconds), bound(1.0, TimeUnit::Seconds)));
        assert!(reversed(bound(2.0, TimeUnit::Seconds), bound(5.0, TimeUnit::Milliseconds)));
    }
}
