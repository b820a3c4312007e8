//! Signals in dense time: samples at any times, and what the signal does between them.

use super::error::DenseError;
use super::piecewise::{Builder, Knot, Piecewise};
use super::time::{MAX_SECONDS, Ticks, ticks};

/// The values of a signal between two samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum Interpolation {
    /// Each value holds until the next sample, and the last one until the end of the log: piecewise
    /// constant, as in RTAMT.
    Hold,
    /// A line leads from each sample to the next: piecewise linear.
    Linear,
}

/// A named signal with samples at increasing times, in seconds.
///
/// # Example
/// ```
/// use mishandle_stl::{DenseSignal, Interpolation};
///
/// let signal = DenseSignal::new("d", vec![0.0, 0.7, 1.3], vec![1.5, 3.0, 0.1], Interpolation::Hold).unwrap();
/// assert_eq!((signal.start(), signal.end()), (0.0, 1.3));
/// let error = DenseSignal::new("d", vec![0.0, 0.0], vec![1.5, 3.0], Interpolation::Hold).unwrap_err();
/// assert_eq!(error.to_string(), "time 1 of signal `d` is 0 s, after 0 s; times must increase, by at least 1e-24 s");
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct DenseSignal {
    name: String,
    times: Vec<f64>,
    values: Vec<f64>,
    interpolation: Interpolation,
}

impl DenseSignal {
    /// Creates a signal.
    ///
    /// # Errors
    /// If there are no samples, or not as many times as values; if a time is not finite, further
    /// than 1e13 s from 0, or not later than the time before; if a value is not finite.
    pub fn new(
        name: impl Into<String>,
        times: Vec<f64>,
        values: Vec<f64>,
        interpolation: Interpolation,
    ) -> Result<DenseSignal, DenseError> {
        let signal = name.into();
        if times.len() != values.len() {
            return Err(DenseError::Lengths { signal, times: times.len(), values: values.len() });
        }
        if times.is_empty() {
            return Err(DenseError::Empty { signal });
        }
        let mut previous = Ticks::MIN;
        for (index, time) in times.iter().copied().enumerate() {
            if time.is_nan() || time.abs() > MAX_SECONDS {
                return Err(DenseError::BadTime { signal, index, time });
            }
            let next = ticks(time);
            if next <= previous {
                return Err(DenseError::NotIncreasing { signal, index, time, previous: times[index - 1] });
            }
            previous = next;
            if !values[index].is_finite() {
                return Err(DenseError::NotFinite { signal, value: values[index], time });
            }
        }
        Ok(DenseSignal { name: signal, times, values, interpolation })
    }

    /// Returns the name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the times of the samples, s.
    pub fn times(&self) -> &[f64] {
        &self.times
    }

    /// Returns the values of the samples.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Returns the values between samples.
    pub fn interpolation(&self) -> Interpolation {
        self.interpolation
    }

    /// Returns the time of the first sample, s.
    pub fn start(&self) -> f64 {
        self.times[0]
    }

    /// Returns the time of the last sample, s.
    pub fn end(&self) -> f64 {
        self.times[self.times.len() - 1]
    }

    /// Returns the signal as a function, at least between the samples next to a time.
    pub(crate) fn around(&self, end: Ticks, time: Ticks) -> Piecewise {
        let next = self.times.partition_point(|sample| ticks(*sample) < time);
        let first = next.saturating_sub(2);
        let last = (next + 3).min(self.times.len());
        let near = DenseSignal {
            name: String::new(),
            times: self.times[first..last].to_vec(),
            values: self.values[first..last].to_vec(),
            interpolation: self.interpolation,
        };
        let end = if last == self.times.len() { end } else { ticks(near.end()) };
        near.piecewise(end, Ticks::MAX)
    }

    /// Returns the signal as a function up to `until`, at most. Held values extend to `end`, the
    /// end of the log.
    pub(crate) fn piecewise(&self, end: Ticks, until: Ticks) -> Piecewise {
        let mut out = Builder::default();
        let mut previous = self.values[0];
        for (time, value) in self.times.iter().zip(&self.values) {
            let time = ticks(*time);
            let before = match self.interpolation {
                Interpolation::Hold => previous,
                Interpolation::Linear => *value,
            };
            out.push(Knot { time, before, at: *value, after: *value });
            previous = *value;
            if time >= until {
                break;
            }
        }
        if self.interpolation == Interpolation::Hold && out.last_time().is_some_and(|last| last < end) {
            out.push(Knot::continuous(end, previous));
        }
        let function = out.finish();
        match function.domain() {
            Some((start, last)) if last > until => function.clip(start, until, previous),
            _ => function,
        }
    }
}
