//! A clock that starts again, by its times in the order in which they come.
//!
//! Late rows go back in time, too. Where the clock starts again, a new run passes times of the last
//! one and continues past them at its own pace; late rows continue where those before them ended.

/// Number of times of a run that the next one passes, from which on they are more than late rows.
const SURE: usize = 3;

/// Ratio of the step past the last run and the longest step before it, from which on the rows
/// before it were late: they belong into a gap.
const GAP: f64 = 2.0;

/// The times of a run so far.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Clock {
    rows: usize,
    first: Option<f64>,
    /// The end of the first half step.
    limit: Option<f64>,
    /// The time that came last.
    last: f64,
    /// The two latest times.
    latest: [f64; 2],
    /// The times since one that went back.
    again: Option<Again>,
}

/// The row with which a clock starts again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Restart {
    /// Its number among the rows of the clock, from 0.
    pub(crate) row: usize,
    /// Whether its time is before the end of the first half step of the run.
    pub(crate) is_at_start: bool,
}

/// Times since one that went back, as long as they increase and do not pass the latest one.
#[derive(Clone, Copy, Debug)]
struct Again {
    row: usize,
    start: f64,
    second: Option<f64>,
    /// Number of them.
    passed: usize,
    longest_step: f64,
    /// The two latest times before.
    latest: [f64; 2],
}

impl Again {
    /// Returns whether the times are more than late rows.
    fn is_sure(&self) -> bool {
        let [latest, before] = self.latest;
        let is_copy = (self.start, self.second) == (before, Some(latest));
        is_copy || self.passed >= SURE && self.second.is_some_and(|second| second <= before)
    }

    fn restart(&self, is_at_start: bool) -> Restart {
        Restart { row: self.row, is_at_start }
    }
}

impl Clock {
    /// Adds a time. Returns where the clock started again, when that is certain: with a row before
    /// the end of the first half step as soon as three times pass, or one if it is the first time;
    /// elsewhere at the end of the times that pass. The clock continues as if it had not.
    pub(crate) fn add(&mut self, time: f64) -> Option<Restart> {
        let row = self.rows;
        self.rows += 1;
        let Some(first) = self.first else {
            (self.first, self.last, self.latest) = (Some(time), time, [time, f64::NEG_INFINITY]);
            return None;
        };
        let mut found = None;
        if time < self.last {
            let again =
                Again { row, start: time, second: None, passed: 1, longest_step: 0.0, latest: self.latest };
            found = self.again.replace(again).filter(Again::is_sure).map(|again| again.restart(false));
        } else if time > self.last
            && let Some(again) = &mut self.again
        {
            let step = time - self.last;
            if time <= again.latest[0] {
                again.second.get_or_insert(time);
                again.passed += 1;
                again.longest_step = again.longest_step.max(step);
                let is_at_start = self.limit.is_some_and(|limit| again.start < limit)
                    && (again.start == first || again.is_sure() && time >= first);
                found = is_at_start.then(|| again.restart(true));
            } else {
                let goes_on = again.is_sure() && step <= GAP * again.longest_step;
                found = goes_on.then(|| again.restart(false));
                self.again = None;
            }
        }
        if self.limit.is_none() && time > first {
            self.limit = Some(0.5 * (first + time));
        }
        let [latest, before] = self.latest;
        if time > latest {
            self.latest = [time, latest];
        } else if time < latest {
            self.latest[1] = before.max(time);
        }
        self.last = time;
        found
    }

    /// Returns where the clock started again, if only the end of the times makes it certain.
    pub(crate) fn end(&self) -> Option<Restart> {
        let again = self.again?;
        // A last row that has the time of the first one would replace it.
        let is_first = Some(again.start) == self.first && again.start == self.last;
        (is_first || again.is_sure()).then(|| again.restart(is_first))
    }
}
