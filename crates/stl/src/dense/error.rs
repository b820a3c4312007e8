//! Errors of monitors in dense time.

use crate::error::MonitorError;
use crate::name::shown;
use crate::number::{Shown, with_short_numbers};

/// The error of making a signal or a monitor in dense time, or of evaluating one.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DenseError {
    /// The formula does not fit the signals.
    #[error(transparent)]
    Formula(#[from] MonitorError),
    /// A bound without a unit, which counts samples elsewhere.
    #[error(
        "bound {bound} of `{operator}` has no unit, and dense time has no samples to count; write a unit, such as \
         `{bound} s`"
    )]
    NoUnit {
        /// The operator that has the interval.
        operator: &'static str,
        /// The bound.
        bound: String,
    },
    /// An operator that reads the sample before or after.
    #[error(
        "`{operator}` has no meaning in dense time, which has no next or previous sample; resample the log to a period \
         to use it"
    )]
    NoNeighbor {
        /// The operator.
        operator: &'static str,
    },
    /// Arithmetic of linear signals that is not linear.
    #[error("`{term}` is not piecewise linear if its signals are")]
    NotLinear {
        /// The term as text.
        term: String,
    },
    /// The formula reads no signal, and no other signal has times for the result.
    #[error("there are no signals; dense time needs at least one to know when the log starts and ends")]
    NoSignals,
    /// The signals have no time in common.
    #[error(
        "the signals have no time in common: {} starts at {} s, after {} ends at {} s",
        shown(late),
        Shown(*start),
        shown(early),
        Shown(*end)
    )]
    NoCommonTime {
        /// The signal that starts last.
        late: String,
        /// Its first time, s.
        start: f64,
        /// The signal that ends first.
        early: String,
        /// Its last time, s.
        end: f64,
    },
    /// A signal without samples.
    #[error("signal {} has no samples; it must have at least one", shown(signal))]
    Empty {
        /// The signal.
        signal: String,
    },
    /// A signal with different numbers of times and values.
    #[error(
        "signal {} has {times} times and {values} values; it must have one value per time",
        shown(signal)
    )]
    Lengths {
        /// The signal.
        signal: String,
        /// The number of times.
        times: usize,
        /// The number of values.
        values: usize,
    },
    /// A time that is NaN, infinite or too large.
    #[error(
        "time {index} of signal {} is {time} s; times must be finite and at most 1e13 s from 0",
        shown(signal)
    )]
    BadTime {
        /// The signal.
        signal: String,
        /// The index of the sample, from 0.
        index: usize,
        /// The time, s.
        time: f64,
    },
    /// A time that is not later than the one before.
    #[error(
        "time {index} of signal {} is {} s, after {} s; times must increase, by at least 1e-24 s",
        shown(signal),
        Shown(*time),
        Shown(*previous)
    )]
    NotIncreasing {
        /// The signal.
        signal: String,
        /// The index of the sample, from 0.
        index: usize,
        /// The time, s.
        time: f64,
        /// The time of the sample before, s.
        previous: f64,
    },
    /// A value that is NaN or infinite.
    #[error("signal {} is {value} at {} s; every sample must be finite", shown(signal), Shown(*time))]
    NotFinite {
        /// The signal.
        signal: String,
        /// The value.
        value: f64,
        /// Its time, s.
        time: f64,
    },
    /// Arithmetic without a finite value: a division by zero, the square root of a negative number,
    /// an overflow.
    #[error("`{}` has no finite value at {} s", with_short_numbers(operation), Shown(*time))]
    Undefined {
        /// The operation with the values of its operands.
        operation: String,
        /// The time, s.
        time: f64,
    },
}

impl DenseError {
    /// Returns a suggestion for the user, if there is one.
    pub fn hint(&self) -> Option<String> {
        match self {
            DenseError::Formula(error) => error.hint(),
            _ => None,
        }
    }
}
