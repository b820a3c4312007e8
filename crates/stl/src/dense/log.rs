//! The signals that a formula reads, and their common time.

use super::error::DenseError;
use super::signal::{DenseSignal, Interpolation};
use super::time::{Ticks, ticks};
use crate::formula::Formula;
use crate::program::columns;

/// The signals that a formula reads.
pub(crate) struct Log<'a> {
    /// In the order of the formula's signals.
    pub signals: Vec<&'a DenseSignal>,
    /// The first and last time of all signals.
    pub start: Ticks,
    pub end: Ticks,
    /// The first time at which all signals have a value.
    pub first: Ticks,
}

impl<'a> Log<'a> {
    pub(crate) fn new(formula: &Formula, all: &'a [DenseSignal]) -> Result<Log<'a>, DenseError> {
        let names: Vec<String> = all.iter().map(|signal| signal.name().to_owned()).collect();
        let read: Vec<&DenseSignal> =
            columns(formula, &names)?.iter().map(|(index, _)| &all[*index]).collect();
        // A formula without signals has its value at the times of all of them.
        let timed: Vec<&DenseSignal> = if read.is_empty() { all.iter().collect() } else { read.clone() };
        let by_start = |a: &&&DenseSignal, b: &&&DenseSignal| a.start().total_cmp(&b.start());
        let by_end = |a: &&&DenseSignal, b: &&&DenseSignal| a.end().total_cmp(&b.end());
        let (Some(earliest), Some(latest)) = (timed.iter().min_by(by_start), timed.iter().max_by(by_end))
        else {
            return Err(DenseError::NoSignals);
        };
        let late = read.iter().max_by(by_start);
        let early =
            read.iter().filter(|signal| signal.interpolation() == Interpolation::Linear).min_by(by_end);
        if let (Some(late), Some(early)) = (late, early)
            && late.start() > early.end()
        {
            return Err(DenseError::NoCommonTime {
                late: late.name().to_owned(),
                start: late.start(),
                early: early.name().to_owned(),
                end: early.end(),
            });
        }
        let first = late.map_or(earliest.start(), |late| late.start());
        let start = ticks(earliest.start());
        let end = ticks(latest.end());
        Ok(Log { signals: read, start, end, first: ticks(first) })
    }
}
