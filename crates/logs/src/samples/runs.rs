//! Runs of a clock: where the times of a log start again, another log begins.
//!
//! Sorting such a log would mix two runs, and keeping one row of each time would delete one. A row
//! that is only late is not a start: the rows after it go on where those before it ended.

use mishandle_text::plural;

use super::clock::{Clock, Restart};
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

/// Fraction of the rows that are out of order, as 1 in this many, from which on no clock but a
/// mixture explains them.
const MIXED: usize = 10;

/// Returns the row with which each run of a clock starts but the first one. NaN is a missing time.
///
/// A run starts where the time goes back and later times pass the end of the last run: see
/// `Clock`. Where the rows are mixed anyway, only a run that starts as the last one did counts.
pub fn restarts(secs: &[f64]) -> Vec<usize> {
    let rows: Vec<usize> = (0..secs.len()).filter(|row| !secs[*row].is_nan()).collect();
    let times: Vec<f64> = rows.iter().map(|row| secs[*row]).collect();
    let back = times.windows(2).filter(|pair| pair[1] < pair[0]).count();
    let mut found = starts(&times, |_| true);
    if MIXED * back.saturating_sub(found.len()) > times.len() {
        found = starts(&times, |restart| restart.is_at_start);
    }
    found.into_iter().map(|at| rows[at]).collect()
}

fn starts(times: &[f64], counts: impl Fn(&Restart) -> bool) -> Vec<usize> {
    let mut starts = vec![0];
    let mut clock = Clock::default();
    let mut at = 0;
    while at <= times.len() {
        let found = match times.get(at) {
            Some(time) => clock.add(*time),
            None => clock.end(),
        };
        at += 1;
        if let Some(restart) = found.filter(&counts) {
            // The new run reads its rows again, from its start on.
            at = starts[starts.len() - 1] + restart.row;
            starts.push(at);
            clock = Clock::default();
        }
    }
    starts.split_off(1)
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
        let cases: [(&[f64], &[usize]); 29] = [
            (&[0.0, 1.0, 2.0, 0.0, 1.0, 2.0], &[3]),
            (&[0.0, 1.0, 0.0, 1.0, 0.0, 1.0], &[2, 4]),
            // The second run starts a little later, or earlier, or is short.
            (&[0.0, 1.0, 2.0, 3.0, 0.3, 1.3, 2.3], &[4]),
            (&[5.0, 6.0, 7.0, 0.0, 1.0, 5.5], &[3]),
            (&[462.0, 502.0, 509.0, 609.0, 362.0, 571.0, 578.0, 778.0], &[]),
            (&[0.0, 1.0, 2.0, 0.0], &[3]),
            (&[0.0, 1.0, 2.0, 0.0, 0.0, 0.5], &[3]),
            (&[0.0, f64::NAN, 1.0, 2.0, f64::NAN, 0.0, 1.0], &[5]),
            // The second run starts in the middle of the first one, passes its end or not, has the
            // same times or others, steps as long or longer, or is all before it.
            (&[0.0, 1.0, 2.0, 3.0, 4.0, 2.0, 3.0, 4.0, 5.0, 6.0], &[5]),
            (&[0.0, 1.0, 2.0, 3.0, 4.0, 1.5, 2.5, 3.5, 4.5], &[5]),
            (&[0.0, 1.0, 2.0, 3.0, 4.0, 1.0, 2.0, 3.0], &[5]),
            (&[0.0, 1.0, 2.0, 3.0, 2.0, 3.0, 4.0], &[4]),
            (&[0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 1.0, 1.7, 2.4, 3.1], &[6]),
            (&[0.0, 1.0, 2.0, 3.0, 4.0, 1.0, 2.0, 3.0, 1.0, 2.0, 3.0], &[5, 8]),
            (&[10.0, 11.0, 12.0, 0.0, 1.0, 2.0], &[3]),
            // Late rows that fill a gap.
            (&[0.0, 1.0, 2.0, 6.0, 7.0, 3.0, 4.0, 5.0, 8.0], &[]),
            // A late row in the second run, and in the first one.
            (&[0.0, 1.0, 2.0, 0.0, 1.0, 3.0, 2.0, 4.0], &[3]),
            (&[0.0, 2.0, 1.0, 3.0, 0.0, 1.0, 2.0], &[4]),
            (&[1.0, 2.0, 4.0, 0.0, 3.0, 5.0], &[]),
            // Late rows, rows that two writers mixed, descending rows.
            (&[0.0, 1.0, 3.0, 2.0, 4.0], &[]),
            (&[1.0, 0.0, 2.0, 3.0], &[]),
            (&[0.0, 1.0, 2.0, 0.0, 3.0], &[]),
            (&[0.0, 2.0, 1.0, 3.0], &[]),
            (&[3.0, 2.0, 1.0, 0.0], &[]),
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
