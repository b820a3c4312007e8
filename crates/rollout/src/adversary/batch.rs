//! Simulations that wait for the decisions of an adversary.

use std::sync::PoisonError;

use mishandle_stl::{Bounds, Clock, OnlineMonitor, Trace};
use rayon::prelude::*;

use super::decisions::Decision;
use super::{AdversaryEnvironment, Shared};
use crate::lane::{Progress, ROWS};
use crate::rollout::RolloutWorker;
use crate::{EnvironmentBatch, Episode, Request, RolloutError, Scenario, Start, StepStatus};

/// Numbers of an observation besides the observation of the controller and the signals: time,
/// running robustness, end.
const OWN: usize = 3;

/// Returns the length of an observation of the adversary.
pub(super) fn observation_size(shared: &Shared) -> usize {
    shared.rollout.environment.observation_size() + shared.rollout.signals.len() + OWN
}

/// A batch of simulations, all at the same decision.
pub(super) struct AdversaryBatch {
    environment: AdversaryEnvironment,
    chunks: Vec<Chunk>,
    /// Number of the first simulation of these rows.
    first: u32,
    /// Index of the next decision.
    decision: usize,
    observations: Vec<f32>,
    rewards: Vec<f64>,
    statuses: Vec<StepStatus>,
}

/// Rows that one thread steps together.
struct Chunk {
    worker: RolloutWorker,
    episodes: Vec<Episode>,
    rows: Vec<Row>,
}

/// State of a simulation for the adversary, besides its last sample.
struct Row {
    monitor: OnlineMonitor,
    /// Number of samples that the monitor has.
    monitored: usize,
    running_robustness: f64,
    has_ended: bool,
    /// Whether each event has been set.
    has_event: Vec<bool>,
}

impl AdversaryBatch {
    pub fn new(environment: AdversaryEnvironment, rows: usize) -> Result<AdversaryBatch, RolloutError> {
        let shared = &environment.shared;
        let size = rows.div_ceil(rayon::current_num_threads()).clamp(1, ROWS);
        let chunk = |first: usize| -> Result<Chunk, RolloutError> {
            let rows = (first..rows.min(first + size)).map(|_| Row::new(shared));
            Ok(Chunk {
                worker: RolloutWorker::new(&shared.rollout)?,
                episodes: Vec::new(),
                rows: rows.collect::<Result<_, _>>()?,
            })
        };
        Ok(AdversaryBatch {
            chunks: (0..rows).step_by(size).map(chunk).collect::<Result<_, _>>()?,
            first: 1,
            decision: 0,
            observations: vec![0.0; rows * observation_size(shared)],
            rewards: vec![0.0; rows],
            statuses: vec![StepStatus::Running; rows],
            environment,
        })
    }

    /// Calls `each` for each chunk, with the parts of `values`, of the observations and of the
    /// rewards that belong to its rows.
    fn for_chunks(
        &mut self,
        values: &[f64],
        each: impl Fn(&Shared, &mut Chunk, &[f64], &mut [f32], &mut [f64]) -> Result<(), RolloutError> + Sync,
    ) -> Result<(), RolloutError> {
        let shared = &self.environment.shared;
        let rows = self.statuses.len();
        let size = self.chunks.first().map_or(1, |chunk| chunk.rows.len());
        let (columns, observed) = (values.len() / rows, observation_size(shared));
        let parts = |chunk: usize| &values[chunk * size * columns..((chunk + 1) * size).min(rows) * columns];
        self.chunks
            .par_iter_mut()
            .zip(self.observations.par_chunks_mut(size * observed))
            .zip(self.rewards.par_chunks_mut(size))
            .enumerate()
            .try_for_each(|(index, ((chunk, observations), rewards))| {
                each(shared, chunk, parts(index), observations, rewards)
            })
    }

    /// Hands over the simulations, which have ended.
    fn hand_over(&mut self) {
        let simulated = (u64::from(self.environment.budget) + 1).saturating_sub(self.first.into()) as usize;
        let ended = self.chunks.iter_mut().flat_map(|chunk| chunk.episodes.drain(..)).take(simulated);
        let finished = &self.environment.finished;
        finished.lock().unwrap_or_else(PoisonError::into_inner).extend(ended);
        self.first += self.statuses.len() as u32;
    }
}

impl EnvironmentBatch for AdversaryBatch {
    fn rows(&self) -> usize {
        self.statuses.len()
    }

    fn reset(&mut self, starts: &[Start]) -> Result<(), RolloutError> {
        if starts.len() != self.rows() || starts.iter().enumerate().any(|(row, start)| start.row != row) {
            return Err(RolloutError::Batch("all simulations of an adversary start together".to_string()));
        }
        self.decision = 0;
        let AdversaryEnvironment { shared, trial, budget, stop_threshold, fixed_seed, .. } =
            self.environment.clone();
        let mut requests = (self.first..).zip(starts).map(|(number, start)| Request {
            trial,
            number,
            stop_threshold,
            ..Request::new(shared.undecided(&start.scenario), fixed_seed.unwrap_or(start.seed))
        });
        for chunk in &mut self.chunks {
            let requests: Vec<Request> = requests.by_ref().take(chunk.rows.len()).collect();
            chunk.episodes = chunk.worker.start(&shared.rollout, &requests, false);
            for (request, progress) in requests.iter().zip(&mut chunk.worker.progress) {
                if request.number > budget {
                    *progress = Progress::IDLE;
                }
            }
        }
        self.observations.fill(0.0);
        self.for_chunks(&[], |shared, chunk, _, observations, _| {
            chunk.rows.iter_mut().for_each(Row::start);
            chunk.observe(shared, observations, &mut vec![0.0; chunk.rows.len()], false)
        })
    }

    fn step(&mut self, actions: &[f64]) -> Result<(), RolloutError> {
        let (decision, last) = (self.decision, self.environment.decisions() - 1);
        self.for_chunks(actions, |shared, chunk, actions, observations, rewards| {
            chunk.decide(shared, decision, actions);
            let steps = shared.decisions.steps_after(decision, shared.rollout.environment.episode_steps());
            for _ in 0..steps {
                if !chunk.worker.advance(&shared.rollout, &mut chunk.episodes, None) {
                    break;
                }
            }
            chunk.observe(shared, observations, rewards, decision == last)
        })?;
        self.decision += 1;
        if decision == last {
            self.hand_over();
        }
        Ok(())
    }

    fn observations(&self) -> &[f32] {
        &self.observations
    }

    fn rewards(&self) -> &[f64] {
        &self.rewards
    }

    fn statuses(&self) -> &[StepStatus] {
        &self.statuses
    }

    /// A simulation between two decisions has no state that could be saved.
    fn read_states(&mut self, _states: &mut [f64]) -> Result<(), RolloutError> {
        Ok(())
    }

    fn write_states(&mut self, _states: &[f64], _observations: &[f32]) -> Result<(), RolloutError> {
        Err(RolloutError::Batch("simulations of an adversary cannot be restored".to_string()))
    }
}

impl Chunk {
    /// Sets the axes of a decision, and of the events that begin with it, in the scenarios of the
    /// simulations that run.
    fn decide(&mut self, shared: &Shared, decision: usize, actions: &[f64]) {
        let space = &shared.rollout.space;
        let channels = shared.decisions.channels();
        for (row, episode) in self.episodes.iter_mut().enumerate() {
            if !self.worker.progress[row].is_running() {
                continue;
            }
            let mut values = episode.request.scenario.values().to_vec();
            let action = |channel: usize| actions[row * channels + channel];
            let chosen = |channel: usize, axis: usize| space.axes()[axis].at(0.5 + 0.5 * action(channel));
            let Decision { step, axes } = &shared.decisions.all()[decision];
            for (channel, axis) in axes {
                let value = chosen(*channel, *axis);
                values[*axis] = Some(value);
                self.worker.rows.set(&shared.rollout, row, *axis, value);
            }
            for (event, has_event) in shared.decisions.events().iter().zip(&mut self.rows[row].has_event) {
                // In the middle of the step: rounding cannot move it to the one before.
                let time = (*step as f64 + 0.5) * shared.rollout.environment.control_dt();
                let (axis, own) = event.time;
                if *has_event || action(event.trigger) <= 0.0 || !space.axes()[axis].accepts(time) {
                    continue;
                }
                *has_event = true;
                let others = event.axes.iter().map(|(channel, place)| (*place, chosen(*channel, place.0)));
                for ((axis, own), value) in others.chain([((axis, own), time)]) {
                    values[axis] = Some(value);
                    self.worker.set_event(&shared.rollout, row, own, value);
                }
            }
            episode.request.scenario = Scenario::new(values);
        }
    }

    /// Writes what the adversary sees and gets after some control steps. `is_over` says whether
    /// these were the last ones.
    fn observe(
        &mut self,
        shared: &Shared,
        observations: &mut [f32],
        rewards: &mut [f64],
        is_over: bool,
    ) -> Result<(), RolloutError> {
        let rollout = &shared.rollout;
        let (size, seen) = (observation_size(shared), rollout.environment.observation_size());
        for (index, (row, episode)) in self.rows.iter_mut().zip(&mut self.episodes).enumerate() {
            let observation = &mut observations[index * size..][..size];
            let before = row.running_robustness;
            rewards[index] = 0.0;
            if row.has_ended {
                continue;
            }
            let is_running = self.worker.progress[index].is_running();
            if is_running && !is_over {
                row.push(&episode.trace);
            } else {
                row.has_ended = true;
                self.worker.finish(rollout, index, episode)?;
                row.running_robustness = episode.robustness().unwrap_or(before);
            }
            if is_running {
                let (controller, rest) = observation.split_at_mut(seen);
                controller.copy_from_slice(self.worker.lane.sample(index).observation);
                let last = episode.trace.len() - 1;
                for (column, signal) in rest[..rollout.signals.len()].iter_mut().enumerate() {
                    *signal = episode.trace.column(column)[last] as f32;
                }
            }
            let steps = self.worker.progress[index].steps as f32;
            let own = [
                steps / rollout.environment.episode_steps() as f32,
                row.running_robustness as f32,
                f32::from(u8::from(row.has_ended)),
            ];
            observation[size - OWN..].copy_from_slice(&own);
            // The controller rejects such an observation in the next step.
            observation.iter_mut().filter(|value| !value.is_finite()).for_each(|value| *value = 0.0);
            rewards[index] = before - row.running_robustness;
        }
        Ok(())
    }
}

impl Row {
    fn new(shared: &Shared) -> Result<Row, RolloutError> {
        let rollout = &shared.rollout;
        let requirement = &rollout.specification.requirement;
        let environment = &rollout.environment;
        let monitor = OnlineMonitor::new(
            std::slice::from_ref(requirement),
            &rollout.signals,
            Clock::steps(environment.control_dt()),
            Some(environment.episode_steps() + 1),
        )
        .map_err(|source| RolloutError::Monitor { formula: requirement.to_string(), source })?;
        let has_event = vec![false; shared.decisions.events().len()];
        Ok(Row { monitor, monitored: 0, running_robustness: 0.0, has_ended: false, has_event })
    }

    fn start(&mut self) {
        self.monitor.reset();
        (self.monitored, self.running_robustness, self.has_ended) = (0, 0.0, false);
        self.has_event.fill(false);
    }

    /// Adds the new samples of a simulation that runs. A sample without a finite value leaves the
    /// running robustness as it is: the verdict reports it.
    fn push(&mut self, trace: &Trace) {
        let new = self.monitored..trace.len();
        self.monitored = trace.len();
        if self.monitor.push_trace(trace, new).is_ok() {
            let Bounds { low, high } = self.monitor.bounds(0);
            let known = [high, low].into_iter().find(|bound| bound.is_finite());
            self.running_robustness = known.unwrap_or(self.running_robustness);
        }
    }
}
