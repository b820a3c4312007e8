//! Signals of several topics on one axis of time.

use std::rc::Rc;

use mishandle_stl::{DenseSignal, Interpolation};
use mishandle_text::{plural, visible};

use super::{Signals, secs_text, trace};
use crate::cell::MAX_ROWS;
use crate::error::{Result, content, name_time, state_period, undecided};
use crate::log::{Column, Log, Topic};
use crate::options::Options;

/// Largest share of a period by which a rounded time may be off the grid.
const SNAP: f64 = 0.1;

/// Returns the difference up to which a time is that of a sample. The time and the start of the
/// grid are both rounded.
pub(crate) fn snap(rounding: f64, period: f64) -> f64 {
    (2.0 * rounding * (1.0 - 1e-6)).clamp(1e-9 * period, SNAP * period)
}

/// The values of a column that are there, with their times.
struct Track {
    name: String,
    /// Shared by the columns of a topic without missing values.
    times: Rc<Vec<f64>>,
    values: Vec<f64>,
    /// Largest error of a time by rounding.
    rounding: f64,
}

/// The common time of all signals.
#[derive(Clone, Copy)]
struct Span {
    start: f64,
    end: f64,
}

/// Returns the signals at multiples of the period after the start.
pub(super) fn resampled(log: Log, interpolation: Interpolation, options: &Options) -> Result<Signals> {
    let period =
        options.period.ok_or_else(|| undecided([state_period()], "resampling needs the new period"))?;
    if let [topic] = &log.topics[..]
        && let Some(times) = &topic.times
        && topic.columns.iter().all(|column| column.values.iter().all(|value| !value.is_nan()))
        && is_near(times.secs(), period)
        && times.period(Some(period)).is_ok()
    {
        // Even samples stay as they are, also where their times are rounded.
        return log.even(options);
    }
    let (tracks, span) = tracks(log, interpolation, options)?;
    let last_rounding = tracks.iter().map(|track| track.rounding).fold(0.0, f64::max);
    let slack = snap(last_rounding, period);
    let steps = ((span.end - span.start + slack) / period).floor();
    if steps.is_nan() || steps >= MAX_ROWS as f64 {
        return Err(undecided(
            [state_period()],
            format!(
                "{} in steps of {} are more than {}, so the period must be longer",
                secs_text(span.end - span.start),
                secs_text(period),
                plural(MAX_ROWS as u64, "sample")
            ),
        ));
    }
    let rows = steps as usize + 1;
    let columns = tracks.into_iter().map(|track| track.at(span.start, period, rows, interpolation)).collect();
    Ok(Signals::Even {
        trace: trace(columns, rows)?,
        period: Some(period),
        start: span.start,
        has_times: true,
    })
}

/// Returns whether the mean step is near the period. Other times do not fit it, which takes long to
/// find out.
fn is_near(secs: &[f64], period: f64) -> bool {
    let [first, .., last] = secs else { return true };
    let mean = (last - first) / (secs.len() - 1) as f64;
    (mean / period - 1.0).abs() < 0.1
}

/// Returns the signals as functions of time, cut to their common time.
pub(super) fn dense(log: Log, interpolation: Interpolation, options: &Options) -> Result<Vec<DenseSignal>> {
    let (tracks, span) = tracks(log, interpolation, options)?;
    tracks.into_iter().map(|track| track.cut(span, interpolation)).collect()
}

/// Returns the columns with their times, and the time that all of them have.
fn tracks(log: Log, interpolation: Interpolation, options: &Options) -> Result<(Vec<Track>, Span)> {
    let mut tracks = Vec::new();
    for topic in log.topics {
        tracks.extend(topic.tracks(options)?);
    }
    let firsts = tracks.iter().filter_map(|track| track.times.first().copied());
    let lasts = tracks.iter().filter_map(|track| track.times.last().copied());
    let start = firsts.fold(f64::NEG_INFINITY, f64::max);
    // A value that is held lasts until the end of the log; a line ends at its last sample.
    let end = match interpolation {
        Interpolation::Hold => lasts.fold(f64::NEG_INFINITY, f64::max),
        Interpolation::Linear => lasts.fold(f64::INFINITY, f64::min),
    };
    if !(start <= end && (end - start).is_finite()) {
        return Err(content("the signals of the formula have no time in common"));
    }
    let held = |track: &&Track| {
        let last = track.times.last().copied().unwrap_or(end);
        options.tolerance.is_some_and(|tolerance| is_longer(end - last, tolerance))
    };
    if let Some(track) = tracks.iter().find(held) {
        let last = track.times.last().copied().unwrap_or(end);
        return Err(too_long(&track.name, end - last, "at the end of the log", options));
    }
    Ok((tracks, Span { start, end }))
}

impl Topic {
    fn tracks(self, options: &Options) -> Result<Vec<Track>> {
        let Some(times) = self.times else {
            return Err(undecided([name_time()], "resampling and dense time need the times of the samples"));
        };
        let rounding = times.rounding().fold(0.0, f64::max);
        let mut tracks = Vec::new();
        for Column { name, mut values } in self.columns {
            let is_complete = values.iter().all(|value| !value.is_nan());
            if let Some(tolerance) = options.tolerance {
                let mut rows = (0..values.len()).filter(|row| !values[*row].is_nan());
                let mut last = rows.next().unwrap_or(0);
                for row in rows {
                    let step = times.secs()[row] - times.secs()[last];
                    if is_longer(step, tolerance) {
                        let place = format!("before {}", times.places.text(row));
                        return Err(too_long(&name, step, &place, options));
                    }
                    last = row;
                }
            }
            let mut of_values = Vec::new();
            if !is_complete {
                let rows = times.secs().iter().zip(&values);
                of_values = rows.filter(|(_, value)| !value.is_nan()).map(|(secs, _)| *secs).collect();
                values.retain(|value| !value.is_nan());
            }
            tracks.push((is_complete, Track { name, times: Rc::new(of_values), values, rounding }));
        }
        let all = Rc::new(times.into_secs());
        let shared = |(is_complete, track): (bool, Track)| {
            if is_complete { Track { times: Rc::clone(&all), ..track } } else { track }
        };
        Ok(tracks.into_iter().map(shared).collect())
    }
}

/// Returns whether a step is longer than a tolerance, beyond errors of binary fractions.
pub(crate) fn is_longer(step: f64, tolerance: f64) -> bool {
    step > tolerance * (1.0 + 1e-9)
}

fn too_long(name: &str, step: f64, place: &str, options: &Options) -> crate::LogError {
    let tolerance = options.tolerance.map(secs_text).unwrap_or_default();
    undecided(
        [],
        format!(
            "`{}` has no value for {} {place}, longer than the tolerance of {tolerance}",
            visible(name),
            secs_text(step)
        ),
    )
}

impl Track {
    /// Returns the values at `start + i * period`.
    fn at(self, start: f64, period: f64, rows: usize, interpolation: Interpolation) -> Column {
        let snap = snap(self.rounding, period);
        let mut values = Vec::with_capacity(rows);
        let mut last = 0;
        for row in 0..rows {
            let time = start + row as f64 * period;
            while last + 1 < self.times.len() && self.times[last + 1] <= time + snap {
                last += 1;
            }
            let is_sample = (time - self.times[last]).abs() <= snap;
            values.push(if is_sample { self.values[last] } else { self.value(last, time, interpolation) });
        }
        Column { name: self.name, values }
    }

    /// Returns the value at a time after sample `last` and before the next one.
    fn value(&self, last: usize, time: f64, interpolation: Interpolation) -> f64 {
        let value = self.values[last];
        match (interpolation, self.times.get(last + 1)) {
            (Interpolation::Linear, Some(next)) => {
                let share = (time - self.times[last]) / (next - self.times[last]);
                value + share.clamp(0.0, 1.0) * (self.values[last + 1] - value)
            }
            _ => value,
        }
    }

    /// Returns the signal on the common time.
    fn cut(self, span: Span, interpolation: Interpolation) -> Result<DenseSignal> {
        let inside = self.times.partition_point(|time| *time <= span.start);
        let first = inside.checked_sub(1).map(|last| (last, self.value(last, span.start, interpolation)));
        let after = self.times.partition_point(|time| *time <= span.end);
        let is_before = |last: usize| self.times[last] < span.end && span.start < span.end;
        let is_short = after.checked_sub(1).is_some_and(is_before);
        let end = is_short.then(|| self.value(after - 1, span.end, interpolation));
        let Track { name, times, mut values, .. } = self;
        let mut times = Rc::unwrap_or_clone(times);
        times.truncate(after);
        values.truncate(after);
        if let Some(value) = end {
            times.push(span.end);
            values.push(value);
        }
        if let Some((last, value)) = first {
            (times[last], values[last]) = (span.start, value);
            times.drain(..last);
            values.drain(..last);
        }
        DenseSignal::new(&name, times, values, interpolation).map_err(|error| content(error.to_string()))
    }
}
