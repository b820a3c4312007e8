use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use mishandle_controllers::Policy;
use mishandle_controllers::guard::{Guard, Guarded};
use mishandle_controllers::{ActionLimiter, Fitted};
use mishandle_evaluation::{decides_strict_success, decides_success, rate};
use mishandle_rollout::{
    Controller, Environment, Episode, Noise, Request, Rollout, Scenario, Seed, Specification, System,
    TrainingScenarios,
};
use mishandle_training::{Checkpoint, Observer, Rates, TrainingControl, TrainingProgress, Validation};

use super::write_failures::WriteFailures;
use super::{Prepared, TrainObserver};
use crate::error::MishandleError;
use crate::plan::TrainPlan;
use crate::train::curve::{CurveColumns, CurveWriter};
use crate::train::tensorboard::EventFile;

/// Seed of the initial states of validations; no evaluation has it by default.
const VALIDATION_SEED: Seed = Seed(0x7661_6c69_6461_7465);

/// Maximum time between checkpoints, so that a crash loses at most this much work.
const CHECKPOINT_INTERVAL: Duration = Duration::from_secs(60);

/// Observer of a training run: validates on the target's formulas, writes curve, event file and
/// checkpoint, and forwards the progress to the user's observer.
pub(super) struct TrainingRecorder<'a> {
    environment: Arc<dyn Environment>,
    scenarios: TrainingScenarios,
    /// Whether the scenarios contain more than random starts.
    has_scenarios: bool,
    /// The limiter of the policy's action interface, and the guard under which it trains.
    limiter: Option<ActionLimiter>,
    guard: Option<Guard>,
    further_parts: Vec<String>,
    specification: Specification,
    checkpoint: PathBuf,
    records: Records,
    observer: &'a mut dyn TrainObserver,
    /// Error that ends the training run: a failed validation, or the first checkpoint cannot be
    /// written.
    error: Option<MishandleError>,
    write_failures: WriteFailures,
    /// Time of the last attempt to write a checkpoint after the first success; `None` before. A
    /// failure to write the first checkpoint ends the run, later failures do not.
    checkpoint_time: Option<Instant>,
    /// The iterations of a new training run that wait for its first checkpoint: a run that is
    /// killed before it leaves curve and event file without data, which the next start replaces.
    waiting: Vec<TrainingProgress>,
    is_resumed: bool,
}

/// Curve and event file, written after each iteration. A failed write is repeated after the next
/// iteration.
struct Records {
    curve: Option<CurveWriter>,
    events: Option<EventFile>,
}

impl Records {
    fn open(
        plan: &TrainPlan,
        columns: CurveColumns<'_>,
        resumed: Option<&Checkpoint>,
    ) -> Result<Records, MishandleError> {
        let events = plan.tensorboard.as_ref();
        let events = events.map(|folder| EventFile::create(folder, columns.reward_terms, resumed.is_some()));
        let events = events.transpose()?;
        let curve = match (&plan.csv, resumed) {
            (Some(path), Some(checkpoint)) => Some(CurveWriter::resume(path, columns, checkpoint)),
            (Some(path), None) => Some(CurveWriter::create(path, columns)),
            (None, _) => None,
        };
        match curve.transpose() {
            Ok(curve) => Ok(Records { curve, events }),
            Err(error) => {
                // A training run that fails to start leaves no files behind.
                events.into_iter().for_each(EventFile::discard);
                Err(error)
            }
        }
    }

    /// Deletes the files that this run created.
    fn discard(self) {
        self.curve.into_iter().for_each(CurveWriter::discard);
        self.events.into_iter().for_each(EventFile::discard);
    }
}

impl<'a> TrainingRecorder<'a> {
    /// Opens the curve and the event file of the plan.
    ///
    /// # Errors
    /// If a file cannot be opened.
    pub(super) fn new(
        plan: &TrainPlan,
        Prepared { settings, environment, scenarios, guard, limiter, .. }: &Prepared,
        specification: Specification,
        resumed: Option<&Checkpoint>,
        observer: &'a mut dyn TrainObserver,
    ) -> Result<TrainingRecorder<'a>, MishandleError> {
        let has_scenarios = settings.scenarios().is_used();
        let columns = CurveColumns::new(settings, &*environment.environment);
        Ok(TrainingRecorder {
            records: Records::open(plan, columns, resumed)?,
            environment: environment.environment.clone(),
            scenarios: scenarios.clone(),
            has_scenarios,
            limiter: limiter.clone(),
            guard: guard.clone(),
            further_parts: settings.episodes().further_parts.clone(),
            specification,
            checkpoint: plan.checkpoint(),
            observer,
            error: None,
            write_failures: WriteFailures::default(),
            checkpoint_time: None,
            waiting: Vec::new(),
            is_resumed: resumed.is_some(),
        })
    }

    /// Returns the error that ended the training run, if any.
    pub(super) fn take_error(&mut self) -> Option<MishandleError> {
        self.error.take()
    }

    /// Cleans up after a failed run: without a checkpoint that belongs to them, curve and event
    /// file are deleted, because they would block the next run.
    pub(super) fn abandon(self) {
        if self.checkpoint_time.is_none() {
            self.records.discard();
        }
    }

    /// Finishes curve and event file; returns the errors of all files that are not written.
    pub(super) fn finish(mut self) -> Vec<MishandleError> {
        if let Some(events) = self.records.events.take_if(|events| events.is_empty()) {
            events.discard();
        }
        self.finish_records();
        self.write_failures.into_errors()
    }

    fn finish_records(&mut self) {
        for progress in std::mem::take(&mut self.waiting) {
            self.write(&progress);
        }
        let curve = self.records.curve.as_mut().map_or(Ok(()), CurveWriter::finish);
        self.record_write("curve", curve);
        let events = self.records.events.as_mut().map_or(Ok(()), EventFile::finish);
        self.record_write("events", events);
    }

    /// Writes an iteration to curve and event file.
    fn write(&mut self, progress: &TrainingProgress) {
        let curve = self.records.curve.as_mut().map_or(Ok(()), |curve| curve.write(progress));
        self.record_write("curve", curve);
        let events = self.records.events.as_mut().map_or(Ok(()), |events| events.write(progress));
        self.record_write("events", events);
    }

    fn record_write(&mut self, file: &'static str, written: Result<(), MishandleError>) {
        if let Some(error) = self.write_failures.record(file, written) {
            self.observer.write_failed(error);
        }
    }

    /// Returns the results of a policy on scenarios numbered from 0.
    fn rates(
        &self,
        policy: &Policy,
        episodes: usize,
        scenario: &dyn Fn(u64) -> Scenario,
    ) -> Result<Rates, MishandleError> {
        let (further_parts, limiter) = (self.further_parts.clone(), self.limiter.clone());
        let policy: Arc<dyn Controller> =
            Arc::new(Fitted::new(Arc::new(policy.clone()), further_parts, limiter));
        let mut rollout = Rollout::new(
            self.environment.clone(),
            match &self.guard {
                Some(guard) => Arc::new(Guarded::new(policy, guard.clone())),
                None => policy,
            },
            self.specification.clone(),
            Noise::default(),
        )?
        .with_disturbances(self.scenarios.space.clone(), &self.scenarios.disturbances)?;
        let request = |i| Request::new(scenario(i), VALIDATION_SEED.child(i));
        let found = rollout.rollout(&(0..episodes as u64).map(request).collect::<Vec<Request>>())?;
        Ok(rates_of(&found, self.specification.strict.is_some()))
    }

    fn measure(&self, policy: &Policy, episodes: usize) -> Result<Validation, MishandleError> {
        let scenarios = &self.scenarios;
        let measure = |scenario: &dyn Fn(u64) -> Scenario| self.rates(policy, episodes, scenario);
        let starts = Validation::of_starts(measure(&|i| scenarios.nominal(VALIDATION_SEED, i))?);
        if !self.has_scenarios {
            return Ok(starts);
        }
        let space = Some(measure(&|i| scenarios.random(VALIDATION_SEED, i))?);
        let corners = Some(measure(&|i| scenarios.corner(VALIDATION_SEED, i))?);
        Ok(Validation { space, corners, ..starts })
    }

    /// Returns a measurement, or keeps its error, which ends the training run.
    fn or_error<T>(&mut self, measured: Result<T, MishandleError>) -> Option<T> {
        measured.map_err(|error| self.error = Some(error)).ok()
    }
}

impl Observer for TrainingRecorder<'_> {
    fn training_started(&mut self, done: u64, total: u64) {
        self.observer.training_started(done, total);
    }

    fn validate(&mut self, policy: &Policy, episodes: usize) -> Option<Validation> {
        let measured = self.measure(policy, episodes);
        self.or_error(measured)
    }

    fn validate_part(&mut self, policy: &Policy, episodes: usize, share: f64) -> Option<Rates> {
        let part = self.scenarios.part(share);
        let measured = self.rates(policy, episodes, &|i| part.random(VALIDATION_SEED, i));
        self.or_error(measured)
    }

    fn iteration_finished(&mut self, progress: &TrainingProgress) -> TrainingControl {
        if self.is_resumed || self.checkpoint_time.is_some() {
            self.write(progress);
        } else {
            self.waiting.push(progress.clone());
        }
        match self.observer.iteration_finished(progress) {
            _ if self.error.is_some() => TrainingControl::Stop,
            TrainingControl::Continue
                if self.checkpoint_time.is_none_or(|time| time.elapsed() > CHECKPOINT_INTERVAL) =>
            {
                TrainingControl::SaveCheckpoint
            }
            control => control,
        }
    }

    fn save_checkpoint(&mut self, checkpoint: &Checkpoint) {
        if self.error.is_some() {
            return;
        }
        // A resumed run expects curve and event file to contain the iteration of the checkpoint, or
        // no iteration at all.
        if self.waiting.is_empty() {
            self.finish_records();
        }
        let written = checkpoint.save(&self.checkpoint).map_err(MishandleError::from);
        match written {
            Err(error) if self.checkpoint_time.is_none() => self.error = Some(error),
            written => {
                self.record_write("checkpoint", written);
                self.checkpoint_time = Some(Instant::now());
                self.finish_records();
            }
        }
    }
}

/// Returns the results of episodes: rates as those of an evaluation, NaN without any verdict.
/// Without a strict formula, the rate of strict success is 0.
fn rates_of(episodes: &[Episode], has_strict: bool) -> Rates {
    let started: Vec<&Episode> = episodes.iter().filter(|episode| episode.end.counts_in_rates()).collect();
    let count = |is: fn(&Episode) -> bool| started.iter().filter(|episode| is(episode)).count() as u64;
    let n = started.len() as u64;
    let rate = |holds: fn(&Episode) -> bool, decides: fn(&Episode) -> bool| {
        rate(count(holds), count(decides), n).value.unwrap_or(f64::NAN)
    };
    Rates {
        success_rate: rate(Episode::is_success, decides_success),
        strict_success_rate: if has_strict {
            rate(Episode::is_strict_success, decides_strict_success)
        } else {
            0.0
        },
        mean_return: started.iter().map(|episode| episode.total_reward).sum::<f64>() / n as f64,
    }
}

#[cfg(test)]
mod tests {
    use mishandle_rollout::{EpisodeEnd, Seed, Verdict};
    use mishandle_stl::Trace;

    use super::*;

    fn episode(end: EpisodeEnd, rho: Option<f64>) -> Episode {
        Episode {
            request: Request::new([0.5], Seed(0)),
            end,
            reason: String::new(),
            steps: 1,
            verdict: Verdict { robustness: rho, success: rho, strict: rho, ..Verdict::default() },
            total_reward: 2.0,
            trace: Trace::new(Arc::from([])),
            trace_digest: None,
        }
    }

    #[test]
    fn a_validation_has_the_rates_of_an_evaluation() {
        let passed = episode(EpisodeEnd::Completed, Some(1.0));
        let crash = EpisodeEnd::Crashed { step: 1 };
        let rejected = EpisodeEnd::InvalidScenario;
        let rates = |ends: &[EpisodeEnd]| {
            let others = ends.iter().map(|end| episode(*end, None));
            let Rates { success_rate, strict_success_rate, mean_return } =
                rates_of(&std::iter::once(passed.clone()).chain(others).collect::<Vec<_>>(), true);
            assert_eq!((success_rate, mean_return), (strict_success_rate, 2.0));
            success_rate
        };
        assert_eq!(
            [rates(&[]), rates(&[rejected]), rates(&[crash]), rates(&[crash, rejected])],
            [1.0, 1.0, 0.5, 0.5]
        );
        for ends in [vec![crash; 3], vec![rejected; 3]] {
            let found: Vec<Episode> = ends.into_iter().map(|end| episode(end, None)).collect();
            assert!(rates_of(&found, true).success_rate.is_nan());
        }
        assert_eq!(rates_of(&[passed], false).strict_success_rate, 0.0);
    }
}
