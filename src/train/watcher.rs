use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use mishandle_controllers::Policy;
use mishandle_rollout::{Environment, Episode, Noise, Request, Rollout, Seed, Specification, System};
use mishandle_tasks::TaskEnvironment;
use mishandle_training::{Checkpoint, Flow, Observer, Progress, Validation};

use super::unwritten::Unwritten;
use super::{TrainObserver, TrainPlan};
use crate::MishandleError;
use crate::curve::CurveWriter;
use crate::tensorboard::EventFile;

/// Key of the starts that a training validates on: no evaluation has it unless it is asked for.
const VALIDATION_SEED: Seed = Seed(0x7661_6c69_6461_7465);

/// A checkpoint is written at least this often, whatever the settings say of iterations: so much work may be lost.
const SAVE_EVERY: Duration = Duration::from_secs(60);

/// Validates on the task's formulas, writes down how it goes, keeps the checkpoint, passes progress on.
pub(super) struct Watcher<'a> {
    environment: Arc<TaskEnvironment>,
    specification: Specification,
    checkpoint: PathBuf,
    records: Records,
    watch: &'a mut dyn TrainObserver,
    /// Why the training ends: its last validation, or its first checkpoint, was not possible.
    failure: Option<MishandleError>,
    unwritten: Unwritten,
    /// When a checkpoint was last tried, if this run wrote any: one that cannot write its first ends, those behind it
    /// may fail for a while.
    saved: Option<Instant>,
}

/// What is written down after each iteration. What cannot be written is tried again after the next.
struct Records {
    curve: Option<CurveWriter>,
    events: Option<EventFile>,
}

impl Records {
    fn open(
        plan: &TrainPlan,
        reward_terms: &[String],
        resumed: Option<&Checkpoint>,
    ) -> Result<Records, MishandleError> {
        let events = plan.tensorboard.as_ref();
        let events = events.map(|folder| EventFile::create(folder, reward_terms, resumed.is_some()));
        let events = events.transpose()?;
        let curve = match (&plan.csv, resumed) {
            (Some(path), Some(checkpoint)) => Some(CurveWriter::resume(path, reward_terms, checkpoint)),
            (Some(path), None) => Some(CurveWriter::create(path, reward_terms)),
            (None, _) => None,
        };
        match curve.transpose() {
            Ok(curve) => Ok(Records { curve, events }),
            Err(error) => {
                // A training that does not begin leaves nothing in the way of the next.
                events.into_iter().for_each(EventFile::discard);
                Err(error)
            }
        }
    }

    /// Takes away what was begun here.
    fn discard(self) {
        self.curve.into_iter().for_each(CurveWriter::discard);
        self.events.into_iter().for_each(EventFile::discard);
    }
}

impl<'a> Watcher<'a> {
    /// Opens all that the plan wants written.
    ///
    /// # Errors
    /// If something of it cannot be.
    pub(super) fn new(
        plan: &TrainPlan,
        environment: Arc<TaskEnvironment>,
        specification: Specification,
        resumed: Option<&Checkpoint>,
        watch: &'a mut dyn TrainObserver,
    ) -> Result<Watcher<'a>, MishandleError> {
        Ok(Watcher {
            records: Records::open(plan, environment.reward_terms(), resumed)?,
            environment,
            specification,
            checkpoint: plan.checkpoint(),
            watch,
            failure: None,
            unwritten: Unwritten::default(),
            saved: None,
        })
    }

    /// Why the training could not go on, if it could not.
    pub(super) fn failure(&mut self) -> Option<MishandleError> {
        self.failure.take()
    }

    /// Ends a training that failed. Its records are taken away if it wrote no checkpoint that they belong to: they would
    /// be in the way of the next.
    pub(super) fn abandon(self) {
        if self.saved.is_none() {
            self.records.discard();
        }
    }

    /// Ends the records. Gives why what is not written of them and of the checkpoint is not.
    pub(super) fn finish(mut self) -> Vec<MishandleError> {
        if let Some(events) = self.records.events.take_if(|events| events.is_idle()) {
            events.discard();
        }
        self.finish_records();
        self.unwritten.into_failures()
    }

    fn finish_records(&mut self) {
        let curve = self.records.curve.as_mut().map_or(Ok(()), CurveWriter::finish);
        self.note("curve", curve);
        let events = self.records.events.as_mut().map_or(Ok(()), EventFile::finish);
        self.note("events", events);
    }

    fn note(&mut self, file: &'static str, written: Result<(), MishandleError>) {
        if let Some(failure) = self.unwritten.note(file, written) {
            self.watch.unwritten(failure);
        }
    }

    fn measure(&self, policy: &Policy, episodes: usize) -> Result<Validation, MishandleError> {
        let mut rollout = Rollout::new(
            self.environment.clone(),
            Arc::new(policy.clone()),
            self.specification.clone(),
            Noise::default(),
        )?;
        let starts = self.environment.space();
        let requests: Vec<Request> = (0..episodes as u64)
            .map(|i| Request::new(starts.sample(VALIDATION_SEED, i), VALIDATION_SEED.child(i)))
            .collect();
        let found = rollout.rollout(&requests)?;
        let share = |holds: &dyn Fn(&Episode) -> bool| {
            found.iter().filter(|episode| holds(episode)).count() as f64 / episodes as f64
        };
        Ok(Validation {
            success_rate: share(&|episode| episode.verdict.success > Some(0.0)),
            strict_success_rate: share(&|episode| episode.verdict.strict > Some(0.0)),
            mean_return: found.iter().map(|episode| episode.total_reward).sum::<f64>() / episodes as f64,
        })
    }
}

impl Observer for Watcher<'_> {
    fn begins(&mut self, done: u64, total: u64) {
        self.watch.begins(done, total);
    }

    fn validate(&mut self, policy: &Policy, episodes: usize) -> Option<Validation> {
        match self.measure(policy, episodes) {
            Ok(found) => Some(found),
            Err(error) => {
                self.failure = Some(error);
                None
            }
        }
    }

    fn progress(&mut self, progress: &Progress) -> Flow {
        let curve = self.records.curve.as_mut().map_or(Ok(()), |curve| curve.write(progress));
        self.note("curve", curve);
        let events = self.records.events.as_mut().map_or(Ok(()), |events| events.write(progress));
        self.note("events", events);
        match self.watch.progress(progress) {
            _ if self.failure.is_some() => Flow::Stop,
            Flow::Continue if self.saved.is_none_or(|saved| saved.elapsed() > SAVE_EVERY) => Flow::Save,
            flow => flow,
        }
    }

    fn checkpoint(&mut self, checkpoint: &Checkpoint) {
        if self.failure.is_some() {
            return;
        }
        // First what a resumed training expects to find beside it.
        self.finish_records();
        let written = checkpoint.save(&self.checkpoint).map_err(MishandleError::from);
        match written {
            Err(error) if self.saved.is_none() => self.failure = Some(error),
            written => {
                self.note("checkpoint", written);
                self.saved = Some(Instant::now());
            }
        }
    }
}
