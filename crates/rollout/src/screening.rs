//! Episodes that another physics engine simulates, many at a time. They propose; they are no evidence.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use rayon::prelude::*;

use crate::lane::{Lane, ROWS};
use crate::{Episode, EpisodeEnd, Request, Rollout, RolloutError, Scenario, Seed, StepStatus, Verdict};

/// An environment whose rows start at given scenarios and are stepped together.
///
/// All arrays are row-major, `[rows, …]`.
pub trait ScenarioBatch: Send {
    /// Returns the number of rows.
    fn rows(&self) -> usize;

    /// Starts an episode in each of these rows. No row may occur twice.
    ///
    /// # Errors
    /// If the batch fails as a whole.
    fn start(&mut self, starts: &[(usize, &Scenario, Seed)]) -> Result<(), RolloutError>;

    /// Advances every row by one control step. `actions` has the shape `[rows, action_size]` and is not clipped.
    ///
    /// # Errors
    /// If the batch fails as a whole. The failure of one row is its status.
    fn step(&mut self, actions: &[f64]) -> Result<(), RolloutError>;

    /// Returns the samples after the last start or step of each row.
    fn samples(&self) -> BatchSamples<'_>;
}

/// Samples of all rows of a [`ScenarioBatch`].
#[derive(Clone, Copy, Debug)]
pub struct BatchSamples<'a> {
    /// Observations, `[rows, observation_size]`.
    pub observations: &'a [f32],
    /// Signals, `[rows, signals]`.
    pub signals: &'a [f64],
    /// Reward terms, `[rows, reward terms]`.
    pub rewards: &'a [f64],
    /// Status of each row.
    pub statuses: &'a [BatchStatus],
}

/// Status of a row after a control step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BatchStatus {
    /// The engine simulated the step.
    Step(StepStatus),
    /// The engine had too little memory for all contacts or constraints of the row.
    Overflow,
}

/// The outcome of one simulation by another physics engine.
///
/// It has no trace and is no [`Episode`], so it can enter neither a run file nor a verdict. The same request, simulated by the
/// target's system, gives the episode that counts.
#[derive(Clone, Debug, PartialEq)]
pub struct ScreenedEpisode {
    /// How the simulation ended. An overflow counts as crashed.
    pub end: EpisodeEnd,
    /// Values of the formulas; undecided if the end yields no verdict.
    pub verdict: Verdict,
    /// Whether the engine had too little memory for the row.
    pub has_overflowed: bool,
}

impl ScreenedEpisode {
    /// Returns the robustness of the requirement; `None` if the simulation has no verdict.
    pub fn robustness(&self) -> Option<f64> {
        self.end.has_verdict().then_some(self.verdict.robustness).flatten()
    }
}

/// Runs simulations of a controller on batches of another physics engine. While the engine steps one batch, the CPU computes the
/// samples and actions of another one.
pub struct Screening {
    rollout: Rollout,
    batches: Vec<Box<dyn ScenarioBatch>>,
}

impl Screening {
    /// Makes a screening from the system that the engine replaces, and the batches of its environment.
    pub fn new(rollout: Rollout, batches: Vec<Box<dyn ScenarioBatch>>) -> Screening {
        Screening { rollout, batches }
    }

    /// Simulates all requests and returns their outcomes in the same order. A free row takes the next request at once.
    ///
    /// `watch` gets the number of finished simulations now and then. If it returns `false`, the screening ends, and the outcomes of
    /// unfinished simulations are `None`.
    ///
    /// # Errors
    /// If a scenario does not belong to the space, or a batch fails as a whole.
    pub fn run(
        &mut self,
        requests: &[Request],
        watch: &(dyn Fn(usize) -> bool + Sync),
    ) -> Result<Vec<Option<ScreenedEpisode>>, RolloutError> {
        let rollout = &self.rollout;
        for request in requests {
            rollout.space.check(&request.scenario)?;
        }
        let queue = Queue {
            requests,
            next: AtomicUsize::new(0),
            done: AtomicUsize::new(0),
            is_stopped: AtomicBool::new(false),
            outcomes: Mutex::new(vec![None; requests.len()]),
        };
        std::thread::scope(|scope| {
            let batches = self.batches.iter_mut().map(|batch| {
                let queue = &queue;
                scope.spawn(move || {
                    let result = run_batch(rollout, &mut **batch, queue, watch);
                    if result.is_err() {
                        queue.is_stopped.store(true, Ordering::Relaxed);
                    }
                    result
                })
            });
            let threads: Vec<_> = batches.collect();
            threads.into_iter().try_for_each(|thread| match thread.join() {
                Ok(result) => result,
                Err(panic) => std::panic::resume_unwind(panic),
            })
        })?;
        Ok(queue.outcomes.into_inner().unwrap_or_default())
    }
}

/// The requests of all batches.
struct Queue<'a> {
    requests: &'a [Request],
    next: AtomicUsize,
    done: AtomicUsize,
    is_stopped: AtomicBool,
    outcomes: Mutex<Vec<Option<ScreenedEpisode>>>,
}

impl Queue<'_> {
    fn take(&self) -> Option<usize> {
        let index = self.next.fetch_add(1, Ordering::Relaxed);
        (index < self.requests.len()).then_some(index)
    }
}

/// Up to 16 adjacent rows of a batch.
struct Group {
    first_row: usize,
    lane: Lane,
    episodes: Vec<Episode>,
    /// Index of the request of each row; `None` if the row is idle.
    indices: Vec<Option<usize>>,
    has_overflowed: Vec<bool>,
    /// Rows of the group that start now.
    starting: Vec<usize>,
    finished: Vec<(usize, ScreenedEpisode)>,
}

fn run_batch(
    rollout: &Rollout,
    batch: &mut dyn ScenarioBatch,
    queue: &Queue<'_>,
    watch: &(dyn Fn(usize) -> bool + Sync),
) -> Result<(), RolloutError> {
    let (_, action_size) = rollout.sizes();
    let mut actions = vec![0.0; batch.rows() * action_size];
    let mut groups = (0..batch.rows())
        .step_by(ROWS)
        .map(|first_row| {
            let rows = ROWS.min(batch.rows() - first_row);
            Ok(Group {
                first_row,
                lane: Lane::new(rollout)?,
                episodes: Vec::with_capacity(rows),
                indices: vec![None; rows],
                has_overflowed: vec![false; rows],
                starting: Vec::with_capacity(rows),
                finished: Vec::new(),
            })
        })
        .collect::<Result<Vec<Group>, RolloutError>>()?;
    loop {
        groups.par_iter_mut().try_for_each(|group| group.refill(rollout, queue))?;
        collect_finished(&mut groups, queue);
        let starts: Vec<_> = groups.iter().flat_map(|group| group.starts(queue)).collect();
        if !starts.is_empty() {
            let scenarios: Vec<_> = starts
                .iter()
                .map(|(row, request)| (*row, rollout.environment_scenario(request), request.seed))
                .collect();
            let starts: Vec<_> =
                scenarios.iter().map(|(row, scenario, seed)| (*row, &**scenario, *seed)).collect();
            batch.start(&starts)?;
            if !watch(queue.done.load(Ordering::Relaxed)) {
                queue.is_stopped.store(true, Ordering::Relaxed);
            }
        }
        let is_idle = groups.iter().all(|group| group.indices.iter().all(Option::is_none));
        if is_idle || queue.is_stopped.load(Ordering::Relaxed) {
            return Ok(());
        }
        let samples = batch.samples();
        groups.par_iter_mut().zip(actions.par_chunks_mut(ROWS * action_size)).for_each(|(group, actions)| {
            group.start(rollout, queue, samples);
            group.act(rollout, actions);
        });
        batch.step(&actions)?;
        let samples = batch.samples();
        groups.par_iter_mut().for_each(|group| group.record(rollout, samples));
    }
}

fn collect_finished(groups: &mut [Group], queue: &Queue<'_>) {
    let finished: usize = groups.iter().map(|group| group.finished.len()).sum();
    if finished > 0
        && let Ok(mut outcomes) = queue.outcomes.lock()
    {
        for (index, outcome) in groups.iter_mut().flat_map(|group| group.finished.drain(..)) {
            outcomes[index] = Some(outcome);
        }
        queue.done.fetch_add(finished, Ordering::Relaxed);
    }
}

impl Group {
    /// Evaluates the episodes that have ended, and gives their rows the next requests.
    fn refill(&mut self, rollout: &Rollout, queue: &Queue<'_>) -> Result<(), RolloutError> {
        let steps = rollout.environment.episode_steps();
        self.starting.clear();
        for row in 0..self.indices.len() {
            if let Some(index) = self.indices[row] {
                let episode = &mut self.episodes[row];
                if episode.end == EpisodeEnd::Completed && episode.steps < steps {
                    continue;
                }
                self.lane.finish(rollout, episode)?;
                let outcome = ScreenedEpisode {
                    end: episode.end,
                    verdict: std::mem::take(&mut episode.verdict),
                    has_overflowed: self.has_overflowed[row],
                };
                self.finished.push((index, outcome));
            }
            self.indices[row] = queue.take();
            if self.indices[row].is_some() {
                self.starting.push(row);
            }
        }
        Ok(())
    }

    fn starts<'a>(&self, queue: &Queue<'a>) -> Vec<(usize, &'a Request)> {
        let request = |row: &usize| {
            let index = self.indices[*row]?;
            Some((self.first_row + row, &queue.requests[index]))
        };
        self.starting.iter().filter_map(request).collect()
    }

    /// Starts the episodes of the rows that the batch has started.
    fn start(&mut self, rollout: &Rollout, queue: &Queue<'_>, samples: BatchSamples<'_>) {
        for row in std::mem::take(&mut self.starting) {
            let Some(index) = self.indices[row] else { continue };
            self.copy_sample(row, samples);
            let episode = self.lane.start(rollout, row, &queue.requests[index]);
            self.has_overflowed[row] = false;
            match self.episodes.get_mut(row) {
                Some(place) => *place = episode,
                None => self.episodes.push(episode),
            }
        }
    }

    fn act(&mut self, rollout: &Rollout, actions: &mut [f64]) {
        self.lane.act(rollout, &mut self.episodes);
        let (_, action_size) = rollout.sizes();
        for ((row, episode), actions) in self.episodes.iter().enumerate().zip(actions.chunks_mut(action_size))
        {
            actions.fill(0.0);
            if self.indices[row].is_some() && episode.end == EpisodeEnd::Completed {
                self.lane.action(rollout, row, episode);
                actions.copy_from_slice(&self.lane.action);
            }
        }
    }

    fn record(&mut self, rollout: &Rollout, samples: BatchSamples<'_>) {
        for row in 0..self.episodes.len() {
            if self.indices[row].is_none() || self.episodes[row].end != EpisodeEnd::Completed {
                continue;
            }
            self.copy_sample(row, samples);
            let episode = &mut self.episodes[row];
            match samples.statuses[self.first_row + row] {
                BatchStatus::Step(status) => self.lane.record(rollout, status, episode),
                BatchStatus::Overflow => {
                    self.has_overflowed[row] = true;
                    episode.end = EpisodeEnd::Crashed { step: episode.steps + 1 };
                }
            }
        }
    }

    fn copy_sample(&mut self, row: usize, samples: BatchSamples<'_>) {
        let Lane { observations, signals, rewards, .. } = &mut self.lane;
        let (batch_row, size) = (self.first_row + row, observations.len() / ROWS);
        observations[row * size..][..size].copy_from_slice(&samples.observations[batch_row * size..][..size]);
        let signal_count = signals.len();
        signals.copy_from_slice(&samples.signals[batch_row * signal_count..][..signal_count]);
        let reward_count = rewards.len();
        rewards.copy_from_slice(&samples.rewards[batch_row * reward_count..][..reward_count]);
    }
}
