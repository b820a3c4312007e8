use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use mishandle_controllers::Policy;
use mishandle_rollout::{Environment, Episode, Noise, Request, Rollout, Seed, Specification, System};
use mishandle_tasks::TaskEnvironment;
use mishandle_training::{Checkpoint, Flow, Observer, Progress, TrainingError, Validation};

use super::TrainPlan;
use crate::MishandleError;
use crate::curve::CurveWriter;
use crate::tensorboard::EventFile;

/// Key of the starts that a training validates on: no evaluation has it unless it is asked for.
const VALIDATION_SEED: Seed = Seed(0x7661_6c69_6461_7465);

/// A checkpoint is written at least this often, whatever the settings say of iterations: so much work may be lost.
const SAVE_EVERY: Duration = Duration::from_secs(60);

/// Validates on the task's formulas, writes down how it goes, keeps the checkpoint, passes progress on.
pub(super) struct Watcher<W> {
    environment: Arc<TaskEnvironment>,
    specification: Specification,
    checkpoint: PathBuf,
    records: Records,
    watch: W,
    /// Why the last validation was not possible: that ends the training.
    failure: Option<MishandleError>,
    /// Why the last checkpoint could not be written: the training goes on, and the next may be.
    unsaved: Option<TrainingError>,
    /// When the last checkpoint was written.
    saved: Instant,
}

/// What is written down after each iteration. What cannot be written is tried again after the next.
#[derive(Default)]
struct Records {
    curve: Option<CurveWriter>,
    events: Option<EventFile>,
    /// Why something of it is not written yet.
    unwritten: Option<MishandleError>,
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
            Ok(curve) => Ok(Records { curve, events, unwritten: None }),
            Err(error) => {
                // A training that does not begin leaves nothing in the way of the next.
                events.into_iter().for_each(EventFile::discard);
                Err(error)
            }
        }
    }

    fn write(&mut self, progress: &Progress) {
        self.each(|curve| curve.write(progress), |events| events.write(progress));
    }

    fn finish(&mut self) {
        self.each(CurveWriter::finish, EventFile::finish);
    }

    fn each(
        &mut self,
        with_curve: impl FnOnce(&mut CurveWriter) -> std::io::Result<()>,
        with_events: impl FnOnce(&mut EventFile) -> std::io::Result<()>,
    ) {
        let curve = self.curve.as_mut().and_then(|curve| Some((with_curve(curve).err()?, curve.path())));
        let events =
            self.events.as_mut().and_then(|events| Some((with_events(events).err()?, events.path())));
        self.unwritten = curve.or(events).map(|(source, path)| MishandleError::File { path, source });
    }
}

impl<W> Watcher<W> {
    /// Opens all that the plan wants written.
    ///
    /// # Errors
    /// If something of it cannot be.
    pub(super) fn new(
        plan: &TrainPlan,
        environment: Arc<TaskEnvironment>,
        specification: Specification,
        resumed: Option<&Checkpoint>,
        watch: W,
    ) -> Result<Watcher<W>, MishandleError> {
        Ok(Watcher {
            records: Records::open(plan, environment.reward_terms(), resumed)?,
            environment,
            specification,
            checkpoint: plan.checkpoint(),
            watch,
            failure: None,
            unsaved: None,
            saved: Instant::now(),
        })
    }

    /// Why the training could not go on, if it could not.
    pub(super) fn failure(&mut self) -> Option<MishandleError> {
        self.failure.take()
    }

    /// Ends the records.
    ///
    /// # Errors
    /// If some of it, or the last checkpoint, could not be written.
    pub(super) fn finish(mut self) -> Result<(), MishandleError> {
        self.records.finish();
        let unsaved = self.unsaved.map(MishandleError::from);
        unsaved.or(self.records.unwritten).map_or(Ok(()), Err)
    }

    fn measure(&self, policy: &Policy, episodes: usize) -> Result<Validation, MishandleError> {
        let mut rollout = Rollout::new(
            self.environment.clone(),
            Arc::new(policy.clone()),
            self.specification.clone(),
            Noise::default(),
        )?;
        let starts = self.environment.initial_box();
        let requests: Vec<Request> = (0..episodes as u64)
            .map(|i| Request { x0: starts.sample(VALIDATION_SEED, i), seed: VALIDATION_SEED.child(i) })
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

impl<W: FnMut(&Progress) -> Flow> Observer for Watcher<W> {
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
        self.records.write(progress);
        match (self.watch)(progress) {
            _ if self.failure.is_some() => Flow::Stop,
            Flow::Continue if self.saved.elapsed() > SAVE_EVERY => Flow::Save,
            flow => flow,
        }
    }

    fn checkpoint(&mut self, checkpoint: &Checkpoint) {
        // First what a resumed training expects to find beside it.
        self.records.finish();
        self.unsaved = checkpoint.save(&self.checkpoint).err();
        self.saved = Instant::now();
    }
}
