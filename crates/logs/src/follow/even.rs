//! Whether times that arrive fit a period.

/// Largest deviation of a step from the period, as a fraction of it, that rounding need not
/// explain: twice that of whole logs, whose mean step may be off the period by as much.
const JITTER: f64 = 2.1e-3;

/// Ratio of the period and the rounding from which on a missing sample is seen.
const FINE: f64 = 10.0;

/// The times so far.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Steps {
    count: u64,
    first: f64,
    last: f64,
    /// Bounds of the start of a grid of the period that passes through all rounded times, less the
    /// first time.
    low: f64,
    high: f64,
    /// Whether a step was too long or too short for a clock that is nearly even.
    is_uneven: bool,
}

impl Steps {
    /// Adds a time, and returns whether the times fit the period.
    pub(super) fn add(&mut self, secs: f64, rounding: f64, period: f64) -> bool {
        if self.count == 0 {
            *self = Steps {
                count: 1,
                first: secs,
                last: secs,
                low: f64::NEG_INFINITY,
                high: f64::INFINITY,
                is_uneven: false,
            };
            return true;
        }
        let difference = secs - self.first - self.count as f64 * period;
        let error = rounding + 4.0 * f64::EPSILON * secs.abs().max(self.first.abs());
        // The first time is rounded, too.
        (self.low, self.high) =
            (self.low.max(difference - error).max(-error), self.high.min(difference + error).min(error));
        let rounded = if FINE * rounding < period { 2.0 * error } else { 0.0 };
        let step = (secs - self.last - period).abs() > JITTER * period + rounded;
        let drift = difference.abs() > JITTER * period * self.count as f64 + rounded;
        self.is_uneven |= step || drift;
        (self.count, self.last) = (self.count + 1, secs);
        !self.is_uneven || (4.0 * rounding < period && self.low <= self.high)
    }

    /// Returns the time before the last one.
    pub(super) fn last(&self) -> f64 {
        self.last
    }
}
