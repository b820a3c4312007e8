//! Reports jobs on stderr, a line each with the seconds since the start.

use std::collections::BTreeMap;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use anyhow::Chain;
use mishandle::MishandleError;
use mishandle::training::TrainingProgress;
use mishandle_studies::zoo::{ZooError, ZooObserver};

use crate::command::message;

/// A training run reports its progress this often.
const PROGRESS_PERIOD: Duration = Duration::from_secs(60);

pub struct Reporter {
    started: Instant,
    /// When each training run last reported its progress.
    reported: Mutex<BTreeMap<String, Instant>>,
}

impl Reporter {
    pub fn new() -> Reporter {
        Reporter { started: Instant::now(), reported: Mutex::default() }
    }

    fn say(&self, name: &str, words: &str) {
        message(&format!("{:>6.0} s  {name}: {words}", self.started.elapsed().as_secs_f64()));
    }

    fn is_due(&self, name: &str) -> bool {
        let now = Instant::now();
        let mut reported = self.reported.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let is_due = reported.get(name).is_none_or(|last| now - *last >= PROGRESS_PERIOD);
        if is_due {
            reported.insert(name.to_string(), now);
        }
        is_due
    }
}

impl ZooObserver for Reporter {
    fn begins(&self, jobs: usize, workers: usize) {
        message(&format!("jobs: {jobs}, in parallel: {workers}"));
    }

    fn started(&self, name: &str, reason: &str) {
        self.say(name, reason);
    }

    fn progress(&self, name: &str, progress: &TrainingProgress) {
        if self.is_due(name) {
            self.say(name, &progress.to_string());
        }
    }

    fn warning(&self, name: &str, failure: &MishandleError) {
        self.say(name, &format!("warning: {}; training continues and tries again", with_causes(failure)));
    }

    fn note(&self, name: &str, words: &str) {
        message(&format!("{name}: {words}"));
    }

    fn ended(&self, name: &str, result: &Result<(), ZooError>) {
        match result {
            Ok(()) => self.say(name, "done"),
            Err(error) => self.say(name, &format!("failed: {}", with_causes(error))),
        }
    }
}

/// Returns an error and its causes.
fn with_causes(error: &(dyn std::error::Error + 'static)) -> String {
    Chain::new(error).map(ToString::to_string).collect::<Vec<_>>().join(": ")
}
