//! Runs of a clock: where the times of a log start again, another log begins.
//!
//! Sorting such a log would mix two runs, and keeping one row of each time would delete one. A row
//! that is only late is not a start: the rows after it go on where those before it ended.

use mishandle_text::plural;

use crate::error::{Result, content};
use crate::log::{Log, Topic};

/// The part of a log in which its clock runs without a restart.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Run {
    /// The number, from 1.
    pub number: usize,
    /// Number of runs of the log.
    pub of: usize,
    /// Its first and last row, such as `line 2` and `line 40`.
    pub rows: [String; 2],
}

impl Run {
    /// Returns the name of the run of a log.
    pub fn named(&self, log: &str) -> String {
        let [first, last] = &self.rows;
        let name = format!("run {} of {}, {first} to {last}", self.number, self.of);
        if log.is_empty() { name } else { format!("{log}: {name}") }
    }
}

/// Returns the row with which each run of a clock starts but the first one. NaN is a missing time.
///
/// A run starts where the time goes back to the start of the last run, or to less than half a step
/// after it, and the next times pass the times of the last run again.
pub fn restarts(secs: &[f64]) -> Vec<usize> {
    let rows: Vec<usize> = (0..secs.len()).filter(|row| !secs[*row].is_nan()).collect();
    let times: Vec<f64> = rows.iter().map(|row| secs[*row]).collect();
    let mut starts = vec![0];
    let mut limit = None;
    let mut latest = f64::NEG_INFINITY;
    for at in 1..times.len() {
        let start = starts[starts.len() - 1];
        latest = latest.max(times[at - 1]);
        let (before, after) = (&times[start..at], &times[at..]);
        // Below half a step after the first time of the run.
        limit = limit.or_else(|| (times[at] > times[start]).then(|| 0.5 * (times[start] + times[at])));
        let goes_back = times[at] < times[at - 1] && limit.is_some_and(|limit| times[at] < limit);
        if goes_back && is_passed_again(before, latest, after) {
            starts.push(at);
            (limit, latest) = (None, f64::NEG_INFINITY);
        }
    }
    starts.iter().skip(1).map(|at| rows[*at]).collect()
}

/// Number of times of a run that the next one passes, from which on they are more than late rows.
pub(crate) const SURE: usize = 3;

/// Returns whether times that start at an earlier time pass the times of a run again, before they
/// go back once more.
fn is_passed_again(run: &[f64], latest: f64, times: &[f64]) -> bool {
    let (first, start) = (run[0], times[0]);
    let rising = 1 + times.windows(2).take_while(|pair| pair[0] <= pair[1]).count();
    let mut next = times[..rising].to_vec();
    next.dedup();
    let passed = next.iter().take_while(|time| **time <= latest).count();
    if start == first {
        // A last row that has the time of another one would replace it.
        return passed > 1 || rising == times.len() && next.len() == 1;
    }
    let is_left_behind =
        |second: &f64| run.iter().filter(|time| *time > second).take(SURE - 1).count() == SURE - 1;
    passed >= SURE && next[passed - 1] >= first && next.get(1).is_some_and(is_left_behind)
}

impl Log {
    /// Splits the log where its clock starts again.
    pub(super) fn runs(self) -> Result<Vec<(Log, Option<Run>)>> {
        let starts: Vec<Vec<usize>> = self.topics.iter().map(Topic::restarts).collect();
        let count = starts.first().map_or(0, Vec::len);
        if let Some(other) = starts.iter().position(|found| found.len() != count) {
            let shown = |topic: usize| {
                let text = starts[topic].first().map(|row| self.topics[topic].places.text(*row));
                let runs = plural(starts[topic].len() as u64 + 1, "run");
                let place = text.map(|text| format!(", which start again in {text}")).unwrap_or_default();
                format!("the times of the topic {} are {runs}{place}", self.topics[topic].shown())
            };
            return Err(content(format!(
                "{}; {}: cut the files into one log for each run",
                shown(0),
                shown(other)
            )));
        }
        if count == 0 {
            return Ok(vec![(self, None)]);
        }
        let of_run = |number: usize| {
            let topics = self.topics.iter().zip(&starts).map(|(topic, starts)| {
                let rows = topic.places.len();
                let first = number.checked_sub(1).map_or(0, |before| starts[before]);
                let last = starts.get(number).copied().unwrap_or(rows);
                topic.with_rows(&(first..last).collect::<Vec<_>>())
            });
            let log = Log { topics: topics.collect(), likely_time: self.likely_time.clone() };
            let rows = log
                .topics
                .first()
                .map(|topic| [0, topic.places.len().saturating_sub(1)].map(|row| topic.places.text(row)));
            let run = rows.map(|rows| Run { number: number + 1, of: count + 1, rows });
            (log, run)
        };
        Ok((0..=count).map(of_run).collect())
    }
}

impl Topic {
    fn restarts(&self) -> Vec<usize> {
        self.times.as_ref().map(|times| restarts(times.secs())).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::restarts;

    #[test]
    fn a_clock_that_starts_again_is_told_from_late_rows() {
        let cases: [(&[f64], &[usize]); 22] = [
            (&[0.0, 1.0, 2.0, 0.0, 1.0, 2.0], &[3]),
            (&[0.0, 1.0, 0.0, 1.0, 0.0, 1.0], &[2, 4]),
            // The second run starts a little later, or earlier, or is short.
            (&[0.0, 1.0, 2.0, 3.0, 0.3, 1.3, 2.3], &[4]),
            (&[5.0, 6.0, 7.0, 0.0, 1.0, 5.5], &[3]),
            (&[462.0, 502.0, 509.0, 609.0, 362.0, 571.0, 578.0, 778.0], &[]),
            (&[0.0, 1.0, 2.0, 0.0], &[3]),
            (&[0.0, 1.0, 2.0, 0.0, 0.0, 0.5], &[3]),
            (&[0.0, f64::NAN, 1.0, 2.0, f64::NAN, 0.0, 1.0], &[5]),
            // A late row in the second run, and in the first one.
            (&[0.0, 1.0, 2.0, 0.0, 1.0, 3.0, 2.0, 4.0], &[3]),
            (&[0.0, 2.0, 1.0, 3.0, 0.0, 1.0, 2.0], &[4]),
            (&[1.0, 2.0, 4.0, 0.0, 3.0, 5.0], &[]),
            // Late rows, rows that two writers mixed, descending rows, a part that was moved.
            (&[0.0, 1.0, 3.0, 2.0, 4.0], &[]),
            (&[1.0, 0.0, 2.0, 3.0], &[]),
            (&[0.0, 1.0, 2.0, 0.0, 3.0], &[]),
            (&[0.0, 2.0, 1.0, 3.0], &[]),
            (&[3.0, 2.0, 1.0, 0.0], &[]),
            (&[10.0, 11.0, 12.0, 0.0, 1.0, 2.0], &[]),
            (&[0.0, 1.0, 0.1, 1.0, 2.0], &[]),
            (&[0.0, 1.0, 2.0, 0.1], &[]),
            (&[0.0, 1.0, 1.0, 2.0], &[]),
            (&[0.0], &[]),
            (&[], &[]),
        ];
        for (times, expected) in cases {
            assert_eq!(restarts(times), expected, "{times:?}");
        }
    }
}
