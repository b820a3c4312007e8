//! Runs simulations of draws and counts them.

use std::ops::ControlFlow;

use mishandle_evaluation::{EndCounts, count_end};
use mishandle_rollout::{Episode, EpisodeEnd, Request, Steerable, SteeredEpisode, Steering, System};
use mishandle_stl::is_violated;

use crate::{Draw, RiskError, Scenarios};

/// Why a part of an estimation ends early.
pub(crate) enum Stop {
    /// The caller stops the estimation.
    Interrupted,
    /// A simulation cannot be run.
    Error(RiskError),
}

impl<E: Into<RiskError>> From<E> for Stop {
    fn from(error: E) -> Stop {
        Stop::Error(error.into())
    }
}

/// Largest number of failures that are kept.
const KEPT: usize = 1000;

/// Outcome of the simulation of a draw.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Outcome {
    /// Robustness; `None` without a verdict.
    pub robustness: Option<f64>,
    /// End of the simulation.
    pub end: EpisodeEnd,
}

impl Outcome {
    /// Adds the simulation to the counts of ends.
    pub(crate) fn count(&self, ends: &mut EndCounts) {
        count_end(ends, self.end, self.robustness.is_some(), 1);
    }
}

/// A simulation that violates the requirement.
#[derive(Clone, Debug, PartialEq)]
pub struct Failure {
    /// Scenario and seed.
    pub draw: Draw,
    /// Number of the simulation: that of its [`Episode`](mishandle_rollout::Episode).
    pub number: u32,
    /// Robustness, below 0.
    pub robustness: f64,
}

/// The simulations of an estimation.
pub(crate) struct Experiment<'a> {
    system: &'a mut dyn System,
    pub(crate) scenarios: &'a Scenarios,
    batch: usize,
    budget: u64,
    done: u64,
    /// Failures nearest to the center of the latent space, unordered.
    failures: Vec<Failure>,
    watch: &'a mut dyn FnMut(u64) -> ControlFlow<()>,
    is_interrupted: bool,
}

impl<'a> Experiment<'a> {
    pub(crate) fn new(
        system: &'a mut dyn System,
        scenarios: &'a Scenarios,
        budget: u64,
        batch: usize,
        watch: &'a mut dyn FnMut(u64) -> ControlFlow<()>,
    ) -> Experiment<'a> {
        let batch = batch.max(1);
        let failures = Vec::new();
        Experiment { system, scenarios, batch, budget, done: 0, failures, watch, is_interrupted: false }
    }

    /// Returns the number of simulations so far.
    pub(crate) fn done(&self) -> u64 {
        self.done
    }

    /// Returns the number of simulations that the budget still allows.
    pub(crate) fn left(&self) -> u64 {
        self.budget.saturating_sub(self.done)
    }

    /// Returns the outcome of each draw. After an interruption, the last draws are missing.
    pub(crate) fn simulate(&mut self, draws: &[Draw]) -> Result<Vec<Outcome>, RiskError> {
        let mut outcomes = Vec::with_capacity(draws.len());
        for batch in draws.chunks(self.batch) {
            if self.is_interrupted {
                break;
            }
            let request = |draw: &Draw| Request::new(self.scenarios.scenario(&draw.latent), draw.seed);
            let requests: Vec<Request> = batch.iter().map(request).collect();
            let episodes = self.system.rollout(&requests)?;
            if episodes.len() != requests.len() {
                return Err(RiskError::EpisodeCount { requested: requests.len(), returned: episodes.len() });
            }
            self.count(batch.iter().zip(&episodes));
            outcomes.extend(
                episodes.iter().map(|episode| Outcome { robustness: episode.robustness(), end: episode.end }),
            );
        }
        Ok(outcomes)
    }

    /// Counts a batch of simulations and keeps its failures.
    fn count<'b>(&mut self, batch: impl ExactSizeIterator<Item = (&'b Draw, &'b Episode)>) {
        self.done += batch.len() as u64;
        let failed = |(draw, episode): (&Draw, &Episode)| {
            let robustness = episode.robustness().filter(|rho| is_violated(*rho))?;
            Some(Failure { draw: draw.clone(), number: episode.request.number, robustness })
        };
        self.failures.extend(batch.filter_map(failed));
        if self.failures.len() > 2 * KEPT {
            self.sort_failures();
            self.failures.truncate(KEPT);
        }
        self.is_interrupted = (self.watch)(self.done).is_break();
    }

    /// Returns what can be steered in the simulations.
    pub(crate) fn steerable(&self) -> Option<Steerable> {
        self.system.steerable()
    }

    /// Simulates draws with a steering. `complete` sets the latent numbers that it chose, from what
    /// it remembers. Returns robustness, the worst possible one without a verdict, and memory.
    pub(crate) fn steered(
        &mut self,
        draws: &mut [Draw],
        steering: &dyn Steering,
        complete: impl Fn(&mut Draw, &[f64]),
    ) -> Result<Vec<(f64, Vec<f64>)>, Stop> {
        let mut outcomes = Vec::with_capacity(draws.len());
        for batch in draws.chunks_mut(self.batch) {
            if self.is_interrupted {
                return Err(Stop::Interrupted);
            }
            let request = |draw: &Draw| Request::new(self.scenarios.scenario(&draw.latent), draw.seed);
            let requests: Vec<Request> = batch.iter().map(request).collect();
            let steered = self.system.rollout_steered(&requests, steering)?;
            if steered.len() != requests.len() {
                let error = RiskError::EpisodeCount { requested: requests.len(), returned: steered.len() };
                return Err(error.into());
            }
            batch.iter_mut().zip(&steered).for_each(|(draw, steered)| complete(draw, &steered.memory));
            self.count(batch.iter().zip(steered.iter().map(|steered| &steered.episode)));
            outcomes.extend(steered.into_iter().map(|SteeredEpisode { episode, memory }| {
                (episode.robustness().unwrap_or(f64::INFINITY), memory)
            }));
        }
        Ok(outcomes)
    }

    /// Returns the robustness of each draw, the worst possible one without a verdict.
    pub(crate) fn robustness(&mut self, draws: &[Draw]) -> Result<Vec<f64>, Stop> {
        let outcomes = self.simulate(draws)?;
        if outcomes.len() < draws.len() {
            return Err(Stop::Interrupted);
        }
        Ok(outcomes.into_iter().map(|outcome| outcome.robustness.unwrap_or(f64::INFINITY)).collect())
    }

    /// Returns up to `n` failures, the ones nearest to the center of the distribution first, each
    /// at a distance of at least `apart` from the ones before it.
    pub(crate) fn distinct_failures(mut self, n: usize, apart: f64) -> Vec<Failure> {
        self.sort_failures();
        let mut chosen: Vec<Failure> = Vec::new();
        for failure in self.failures {
            let is_new = chosen.iter().all(|other| distance(&other.draw, &failure.draw) >= apart);
            if chosen.len() < n && is_new {
                chosen.push(failure);
            }
        }
        chosen
    }

    fn sort_failures(&mut self) {
        self.failures.sort_by(|a, b| a.draw.squared_radius().total_cmp(&b.draw.squared_radius()));
    }
}

fn distance(a: &Draw, b: &Draw) -> f64 {
    a.latent.iter().zip(&b.latent).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}
