//! Times as exact decimals: whole numbers of 10⁻²⁴ s.
//!
//! A time in a log and a bound in a formula are decimals, such as 0.7 and 0.1 s. As `f64`, 0.8 -
//! 0.1 differs from 0.7, and a window would miss a sample at its end. As whole numbers of ticks the
//! difference is exact.

use crate::clock::{Bound, TimeUnit};

/// A time or a duration: a number of ticks of 10⁻²⁴ s.
pub(crate) type Ticks = i128;

/// The number of decimals of a tick, in seconds.
const DECIMALS: i32 = 24;

/// The number of ticks in a nanosecond.
const PER_NANOSECOND: Ticks = 10_i128.pow(15);

/// The largest time of a signal, s.
pub(crate) const MAX_SECONDS: f64 = 1e13;

/// The bound `inf`. Finite bounds are less. Sums of a time and a bound do not overflow.
pub(crate) const UNBOUNDED: Ticks = 10_i128.pow(38);

/// Whole numbers below this are exact in `f64`.
const EXACT: f64 = (1_u64 << 53) as f64;

/// Returns the ticks of a time whose shortest decimal is that of `seconds`, which must be at most
/// [`MAX_SECONDS`].
pub(crate) fn ticks(seconds: f64) -> Ticks {
    let nanoseconds = (seconds * 1e9).round();
    if nanoseconds.abs() < EXACT && nanoseconds / 1e9 == seconds {
        return nanoseconds as Ticks * PER_NANOSECOND;
    }
    decimal(seconds, 0)
}

/// Returns the ticks of a bound, less than [`UNBOUNDED`] if it is finite.
pub(crate) fn bound_ticks(bound: Bound, unit: TimeUnit) -> Ticks {
    if bound.value.is_infinite() {
        return UNBOUNDED;
    }
    let exponent = match bound.unit.unwrap_or(unit) {
        TimeUnit::Seconds => 0,
        TimeUnit::Milliseconds => -3,
        TimeUnit::Microseconds => -6,
        TimeUnit::Nanoseconds => -9,
    };
    decimal(bound.value, exponent)
}

/// Returns `value` · 10^`exponent` seconds in ticks, rounded, by the shortest decimal of the value.
fn decimal(value: f64, exponent: i32) -> Ticks {
    let text = format!("{value:e}");
    // The format of `{:e}` is fixed: digits with at most one point, `e`, and a whole number.
    let (mantissa, power) = text.split_once('e').unwrap_or((&text, "0"));
    let decimals = mantissa.split_once('.').map_or(0, |(_, decimals)| decimals.len());
    let digits: Ticks = mantissa.replace('.', "").parse().unwrap_or(0);
    let power = power.parse().unwrap_or(0) - decimals as i32 + exponent + DECIMALS;
    if power >= 0 {
        let factor = 10_i128.checked_pow(power.unsigned_abs()).unwrap_or(UNBOUNDED);
        return digits.saturating_mul(factor).clamp(1 - UNBOUNDED, UNBOUNDED - 1);
    }
    match 10_i128.checked_pow(power.unsigned_abs()) {
        Some(divisor) => (digits + digits.signum() * (divisor / 2)) / divisor,
        None => 0,
    }
}

/// Returns the `f64` that is nearest to this time, s.
pub(crate) fn seconds(ticks: Ticks) -> f64 {
    let nanoseconds = ticks / PER_NANOSECOND;
    if ticks % PER_NANOSECOND == 0 && nanoseconds.unsigned_abs() < (1 << 53) {
        return nanoseconds as f64 / 1e9;
    }
    format!("{ticks}e-{DECIMALS}").parse().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_of_decimals_are_exact() {
        assert_eq!(ticks(0.1) + ticks(0.2), ticks(0.3));
        assert_eq!(ticks(0.8) - ticks(0.1), ticks(0.7));
        assert_eq!(ticks(1e-9) * 1_000_000_000, ticks(1.0));
        assert_eq!(ticks(1e-12) * 1_000_000, ticks(1e-6));
        assert_eq!(ticks(-2.5e-20), -25_000);
        assert_eq!(ticks(1e-300), 0);
    }

    #[test]
    fn every_time_comes_back() {
        for time in
            [0.0, 0.1, 1.0 / 3.0, -2.0 / 7.0, 1e-7, 1.7e9 + 0.1, 1e13, 123_456.789_012_345_6, 1e-7 / 3.0]
        {
            assert_eq!(seconds(ticks(time)), time);
        }
    }

    #[test]
    fn bounds_are_decimals_of_their_unit() {
        let of = |value, unit| bound_ticks(Bound { value, unit: Some(unit) }, TimeUnit::Seconds);
        assert_eq!(of(0.1, TimeUnit::Milliseconds), ticks(1e-4));
        assert_eq!(of(300.0, TimeUnit::Milliseconds), ticks(0.3));
        assert_eq!(of(0.3, TimeUnit::Nanoseconds), ticks(3e-10));
        assert_eq!(of(f64::INFINITY, TimeUnit::Seconds), UNBOUNDED);
        assert_eq!(of(1e300, TimeUnit::Seconds), UNBOUNDED - 1);
        assert_eq!(bound_ticks(Bound { value: 2.0, unit: None }, TimeUnit::Microseconds), ticks(2e-6));
    }
}
