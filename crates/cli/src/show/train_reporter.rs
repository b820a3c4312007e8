//! Reports the progress of a training run on the terminal or in a log, and stops the run on
//! signals.

use std::time::{Duration, Instant};

use anyhow::{Chain, Result};
use mishandle::MishandleError;
use mishandle::plan::TrainPlan;
use mishandle::train::TrainObserver;
use mishandle::training::{TrainingControl, TrainingProgress};

use super::live_curve::LiveCurve;
use super::output::{self, shows_progress};
use crate::{interrupt, words};

/// Time between log lines without a terminal.
const LOG_INTERVAL: Duration = Duration::from_secs(30);

/// Reports the progress of a training run; a signal stops the run after the current iteration.
pub struct TrainReporter {
    live: LiveCurve,
    log: LogTimer,
    /// Task, algorithm, seed and output file.
    title: String,
    /// Number of iterations of this process.
    pub iterations: u64,
}

impl TrainReporter {
    /// Creates the reporter and starts to listen to signals.
    pub fn start(plan: &TrainPlan) -> Result<TrainReporter> {
        let live = LiveCurve::new();
        let shown = live.clone();
        let cleared = live.clone();
        let announce = move || {
            shown.suspend(|| {
                output::message("finishing the current iteration; press Ctrl-C again to quit immediately");
            });
        };
        interrupt::listen(announce, move || cleared.finish())?;
        let TrainPlan { task, algorithm, seed, out, .. } = plan;
        let title = format!("{task} by {algorithm}, seed {seed}, to {}", out.display());
        Ok(TrainReporter { live, log: LogTimer { last: None }, title, iterations: 0 })
    }

    /// Clears the live line.
    pub fn finish(&self) {
        self.live.finish();
    }
}

impl TrainObserver for TrainReporter {
    fn training_started(&mut self, done: u64, total: u64) {
        // The first iteration can take minutes.
        if !shows_progress() {
            output::message(&format!("training {}: {done} of {total} environment steps done", self.title));
        }
    }

    fn iteration_finished(&mut self, progress: &TrainingProgress) -> TrainingControl {
        self.iterations += 1;
        if shows_progress() {
            self.live.show(progress);
        } else if self.log.is_due(Instant::now()) {
            output::message(&progress.to_string());
        }
        if interrupt::requested() { TrainingControl::Stop } else { TrainingControl::Continue }
    }

    fn write_failed(&mut self, error: &MishandleError) {
        self.live.suspend(|| {
            output::message(&format!(
                "warning: {}; training continues and will try again",
                with_causes(error)
            ));
        });
    }
}

/// Formats an error with its causes.
pub fn with_causes(error: &MishandleError) -> String {
    words::with_causes(Chain::new(error))
}

/// Decides when the next log line is due; the first one is due immediately.
struct LogTimer {
    last: Option<Instant>,
}

impl LogTimer {
    fn is_due(&mut self, now: Instant) -> bool {
        let is_due = self.last.is_none_or(|last| now - last >= LOG_INTERVAL);
        if is_due {
            self.last = Some(now);
        }
        is_due
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_due_immediately_and_then_twice_a_minute() {
        let start = Instant::now();
        let mut log = LogTimer { last: None };
        let due = (0..100_u64).filter(|secs| log.is_due(start + Duration::from_secs(*secs)));
        assert_eq!(due.collect::<Vec<_>>(), [0, 30, 60, 90]);
    }
}
