//! Plain Monte Carlo: independent simulations under the distribution itself.

use mishandle_evaluation::{EndCounts, Estimate, TwoStage, clopper_pearson, two_stage};
use mishandle_random::Sequence;
use mishandle_stl::is_violated;

use crate::experiment::{Experiment, Outcome, Stop};
use crate::{CONFIDENCE, Draw, FREQUENT};

/// Independent simulations under the distribution, and their failures.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MonteCarlo {
    /// Number of simulations.
    pub simulations: u64,
    /// Number of those that violate the requirement.
    pub failures: u64,
    /// Those without a verdict, which count as passed in the estimate. Scenarios from which the
    /// target cannot start leave the estimate, which is that of the probability among valid
    /// scenarios: valid draws are a random sample of these.
    pub ends: EndCounts,
    /// The draws that violate the requirement.
    pub(crate) failed: Vec<Draw>,
    /// The decision after the first part; `None` before it.
    pub(crate) stages: Option<TwoStage>,
}

/// Number of draws that are made at once.
const CHUNK: u64 = 4096;

impl MonteCarlo {
    /// Adds `n` simulations, fewer after an interruption.
    pub(crate) fn run(
        &mut self,
        experiment: &mut Experiment<'_>,
        random: &mut Sequence,
        n: u64,
    ) -> Result<(), Stop> {
        let end = self.simulations + n;
        while self.simulations < end {
            let count = CHUNK.min(end - self.simulations);
            let draws: Vec<Draw> = (0..count).map(|_| experiment.scenarios.draw(random)).collect();
            let outcomes = experiment.simulate(&draws)?;
            self.simulations += outcomes.len() as u64;
            for outcome in &outcomes {
                outcome.count(&mut self.ends);
            }
            let is_failed = |outcome: &Outcome| outcome.robustness.is_some_and(is_violated);
            let failed = draws.into_iter().zip(&outcomes).filter(|(_, outcome)| is_failed(outcome));
            self.failed.extend(failed.map(|(draw, _)| draw));
            self.failures = self.failed.len() as u64;
            if (outcomes.len() as u64) < count {
                return Err(Stop::Interrupted);
            }
        }
        Ok(())
    }

    /// Decides from the simulations so far, the first part, whether failures are frequent enough
    /// for Monte Carlo alone.
    pub(crate) fn decide(&mut self) -> bool {
        let is_reached = self.failures >= FREQUENT;
        self.stages = Some(TwoStage { first: self.valid(), threshold: FREQUENT, is_reached });
        is_reached
    }

    /// Returns the number of simulations with a valid scenario, which the estimate counts.
    pub fn valid(&self) -> u64 {
        self.simulations - self.ends.invalid_starts
    }

    /// Returns whether any simulation has a verdict.
    pub fn has_verdict(&self) -> bool {
        self.ends.total() < self.valid()
    }

    /// Returns the failure rate with its exact 95 % interval, which accounts for the decision after
    /// the first part: see [`two_stage`](mishandle_evaluation::two_stage()).
    pub fn estimate(&self) -> Estimate {
        self.estimate_at(CONFIDENCE)
    }

    pub(crate) fn estimate_at(&self, confidence: f64) -> Estimate {
        match self.stages {
            _ if !self.has_verdict() => Estimate { n: self.valid(), ..Estimate::default() },
            None => clopper_pearson(self.failures, self.valid(), confidence),
            Some(stages) => two_stage(self.failures, self.valid(), stages, confidence),
        }
    }

    /// Returns the failure rate with an interval that holds whatever the simulations without a
    /// verdict would have done: they count as failures in its upper bound only.
    pub fn failure_rate(&self) -> Estimate {
        let estimate = self.estimate();
        let undecided = self.ends.total() > 0 && self.has_verdict();
        Estimate { high: if undecided { self.bound_with_undecided() } else { estimate.high }, ..estimate }
    }

    /// Returns an upper bound (97.5 %) of the failure rate in which every simulation without a
    /// verdict counts as a failure. It alone assumes nothing if there are such simulations.
    pub fn bound_with_undecided(&self) -> Option<f64> {
        // The decision was made from the failures alone. It has two outcomes, each with half of the
        // probability of a miss.
        let confidence = 0.5 + 0.5 * CONFIDENCE;
        clopper_pearson(self.failures + self.ends.total(), self.valid(), confidence).high
    }
}
