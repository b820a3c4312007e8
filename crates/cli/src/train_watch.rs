//! A training as it goes: told on the terminal or in a log, and ended by signals.

use std::time::{Duration, Instant};

use anyhow::{Chain, Result};
use mishandle::training::{Flow, Progress};
use mishandle::{MishandleError, TrainObserver, TrainPlan};

use crate::interrupt;
use crate::live_curve::LiveCurve;
use crate::output::{self, shows_progress};

/// Without a terminal, a line is written this often.
const QUIET: Duration = Duration::from_secs(30);

/// Tells how a training goes, and has signals end it after an iteration.
pub struct Watch {
    live: LiveCurve,
    log: Log,
    /// What is trained, and where it goes.
    title: String,
    /// Iterations of this run.
    pub iterations: u64,
}

impl Watch {
    /// Listens to signals from here on.
    pub fn begin(plan: &TrainPlan) -> Result<Watch> {
        let live = LiveCurve::new();
        let (shown, cleared) = (live.clone(), live.clone());
        let announce = move || {
            shown.suspend(|| {
                output::message("finishing the iteration that has begun; Ctrl-C again ends at once");
            });
        };
        interrupt::listen(announce, move || cleared.finish())?;
        let TrainPlan { task, algorithm, seed, out, .. } = plan;
        let title = format!("{task} by {algorithm}, seed {seed}, to {}", out.display());
        Ok(Watch { live, log: Log { last: None }, title, iterations: 0 })
    }

    /// Takes what is written over away.
    pub fn finish(&self) {
        self.live.finish();
    }
}

impl TrainObserver for Watch {
    fn begins(&mut self, done: u64, total: u64) {
        // The first iteration may take minutes.
        if !shows_progress() {
            output::message(&format!("training {}: {done} of {total} environment steps done", self.title));
        }
    }

    fn progress(&mut self, progress: &Progress) -> Flow {
        self.iterations += 1;
        if shows_progress() {
            self.live.show(progress);
        } else if self.log.is_due(Instant::now()) {
            output::message(&progress.to_string());
        }
        if interrupt::requested() { Flow::Stop } else { Flow::Continue }
    }

    fn unwritten(&mut self, failure: &MishandleError) {
        self.live.suspend(|| {
            output::message(&format!("warning: {}; training goes on, and will try again", whole(failure)));
        });
    }
}

/// What went wrong, from the outside in.
pub fn whole(failure: &MishandleError) -> String {
    let causes: Vec<String> = Chain::new(failure).map(ToString::to_string).collect();
    causes.join(": ")
}

/// When the lines of a log are due: the first at once, so that it is seen to run.
struct Log {
    last: Option<Instant>,
}

impl Log {
    fn is_due(&mut self, now: Instant) -> bool {
        let is_due = self.last.is_none_or(|last| now - last >= QUIET);
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
    fn a_line_is_due_at_once_and_then_twice_a_minute() {
        let start = Instant::now();
        let mut log = Log { last: None };
        let due = (0..100_u64).filter(|secs| log.is_due(start + Duration::from_secs(*secs)));
        assert_eq!(due.collect::<Vec<_>>(), [0, 30, 60, 90]);
    }
}
