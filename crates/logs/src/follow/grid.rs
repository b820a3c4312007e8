//! Samples of several topics on an even grid, while they arrive: the values are those that
//! [`Log::samples`](crate::Log::samples) resamples from whole logs, to the bit.

use std::collections::VecDeque;

use mishandle_stl::Interpolation;
use mishandle_text::{number_text, visible};

use super::topic::Topic;
use crate::error::{Result, content, undecided};
use crate::samples::align::{is_longer, snap};

/// The samples of a signal from the last one before the grid time on.
#[derive(Debug, Default)]
pub(super) struct Track {
    samples: VecDeque<(f64, f64)>,
    /// The time of the latest sample.
    latest: Option<f64>,
}

/// The grid.
#[derive(Debug)]
pub(super) struct Grid {
    pub(super) period: f64,
    pub(super) interpolation: Interpolation,
    /// The longest step between two samples of a signal in seconds; `None`: any.
    pub(super) tolerance: Option<f64>,
    /// Whether rows that arrived can wait before they count.
    pub(super) has_waiting: bool,
    pub(super) tracks: Vec<Track>,
    /// The first grid time, when it is known.
    pub(super) start: Option<f64>,
    /// The number of samples that were taken.
    pub(super) taken: u64,
}

impl Grid {
    /// Moves the rows of a topic that are ready to its signals.
    pub(super) fn take_rows(&mut self, topic: &mut Topic) -> Result<()> {
        while let Some(row) = topic.ready.pop_front() {
            let secs = row.secs + topic.shift;
            let taken =
                self.taken.checked_sub(1).and_then(|last| Some(self.start? + last as f64 * self.period));
            if taken.is_some_and(|taken| secs <= taken + snap(topic.rounding, self.period)) {
                return Err(topic.late(&row, taken.unwrap_or(secs)));
            }
            for (column, value) in row.values.iter().enumerate().filter(|(_, value)| !value.is_nan()) {
                let track = &mut self.tracks[topic.signals[column]];
                if let (Some(tolerance), Some(latest)) = (self.tolerance, track.latest)
                    && is_longer(secs - latest, tolerance)
                {
                    let place = format!("before {}", topic.counted.text(row.number));
                    return Err(too_long(&topic.names[column], secs - latest, &place, tolerance));
                }
                track.latest = Some(secs);
                track.samples.push_back((secs, *value));
            }
        }
        Ok(())
    }

    /// Returns the largest number of samples that wait.
    pub(super) fn waiting(&self) -> usize {
        self.tracks.iter().map(|track| track.samples.len()).max().unwrap_or(0)
    }

    /// Writes the next sample, one value per signal, and returns its time; `None` if it is not
    /// known yet, and after the end. `clock` is the time up to which no row can come.
    pub(super) fn next(&mut self, topics: &[Topic], clock: f64, sample: &mut [f64]) -> Result<Option<f64>> {
        let Some(start) = self.start.or_else(|| {
            let firsts = self.tracks.iter().map(|track| Some(track.samples.front()?.0));
            firsts.reduce(|a, b| Some(a?.max(b?))).flatten()
        }) else {
            return Ok(None);
        };
        self.start = Some(start);
        let time = start + self.taken as f64 * self.period;
        let slack = topics.iter().map(|topic| snap(topic.rounding, self.period)).fold(0.0, f64::max);
        let lasts = |is_counted: &dyn Fn(&Topic) -> bool| {
            let counted = topics.iter().filter(|topic| is_counted(topic)).flat_map(|topic| &topic.signals);
            counted.filter_map(|signal| self.tracks[*signal].latest).collect::<Vec<f64>>()
        };
        let has_ended = topics.iter().all(|topic| topic.has_ended);
        // A value that is held lasts until the end of the log; a line ends at its last sample.
        let end = match (self.interpolation, has_ended) {
            (Interpolation::Hold, true) => lasts(&|_| true).into_iter().fold(f64::NEG_INFINITY, f64::max),
            (Interpolation::Hold, false) => f64::INFINITY,
            (Interpolation::Linear, _) => {
                lasts(&|topic| topic.has_ended).into_iter().fold(f64::INFINITY, f64::min)
            }
        };
        if has_ended && !(start <= end && (end - start).is_finite()) {
            return Err(content("the signals of the formula have no time in common"));
        }
        if self.taken as f64 > ((end - start + slack) / self.period).floor() {
            return Ok(None);
        }
        if !has_ended {
            let latest = lasts(&|_| true).into_iter().fold(f64::NEG_INFINITY, f64::max);
            let known = match self.interpolation {
                Interpolation::Hold => clock.min(latest),
                Interpolation::Linear => clock,
            };
            // A row at the grid time or after it is there, and no other one is so near to it: they
            // differ by the last digit at least, which is more than the slack.
            if known < if self.has_waiting { time + slack } else { time } {
                return Ok(None);
            }
        }
        for topic in topics {
            let snap = snap(topic.rounding, self.period);
            for (name, signal) in topic.names.iter().zip(&topic.signals) {
                let track = &mut self.tracks[*signal];
                let Some(value) = track.at(time, snap, self.interpolation, has_ended) else {
                    return Ok(None);
                };
                if let (Some(tolerance), Some((before, _)), None) =
                    (self.tolerance, track.samples.front(), track.samples.get(1))
                    && is_longer(time - before, tolerance)
                {
                    return Err(too_long(
                        name,
                        time - before,
                        &format!("after {} s", number_text(*before)),
                        tolerance,
                    ));
                }
                sample[*signal] = value;
            }
        }
        self.taken += 1;
        Ok(Some(time))
    }

    /// Checks that no value is held too long at the end of the log.
    pub(super) fn check_end(&self, topics: &[Topic]) -> Result<()> {
        let end = self.tracks.iter().filter_map(|track| track.latest);
        let end = match self.interpolation {
            Interpolation::Hold => end.fold(f64::NEG_INFINITY, f64::max),
            Interpolation::Linear => end.fold(f64::INFINITY, f64::min),
        };
        for topic in topics {
            for (name, signal) in topic.names.iter().zip(&topic.signals) {
                if let (Some(tolerance), Some(latest)) = (self.tolerance, self.tracks[*signal].latest)
                    && is_longer(end - latest, tolerance)
                {
                    return Err(too_long(name, end - latest, "at the end of the log", tolerance));
                }
            }
        }
        Ok(())
    }
}

impl Track {
    /// Returns the value at a grid time, and forgets the samples before it; `None` if it needs a
    /// later sample.
    fn at(&mut self, time: f64, snap: f64, interpolation: Interpolation, has_ended: bool) -> Option<f64> {
        while self.samples.get(1).is_some_and(|(next, _)| *next <= time + snap) {
            self.samples.pop_front();
        }
        let (before, value) = *self.samples.front()?;
        if (time - before).abs() <= snap {
            return Some(value);
        }
        match (interpolation, self.samples.get(1)) {
            (Interpolation::Linear, Some((next, last))) => {
                let share = (time - before) / (next - before);
                Some(value + share.clamp(0.0, 1.0) * (last - value))
            }
            (Interpolation::Linear, None) => has_ended.then_some(value),
            (Interpolation::Hold, _) => Some(value),
        }
    }
}

fn too_long(name: &str, step: f64, place: &str, tolerance: f64) -> crate::LogError {
    undecided(
        [],
        format!(
            "`{}` has no value for {} s {place}, longer than the tolerance of {} s",
            visible(name),
            number_text(step),
            number_text(tolerance)
        ),
    )
}
