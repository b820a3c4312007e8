//! Plain Monte Carlo: independent simulations under the distribution itself.

use mishandle_evaluation::{Estimate, TwoStage, clopper_pearson, two_stage};
use mishandle_random::Sequence;
use mishandle_stl::is_violated;

use crate::experiment::{Experiment, Stop};
use crate::{CONFIDENCE, Draw, FREQUENT};

/// Independent simulations under the distribution, and their failures.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MonteCarlo {
    /// Number of simulations.
    pub simulations: u64,
    /// Number of those that violate the requirement.
    pub failures: u64,
    /// Number of those without a verdict. They count as passed in the estimate.
    pub without_verdict: u64,
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
            let robustness = experiment.simulate(&draws)?;
            self.simulations += robustness.len() as u64;
            self.without_verdict += robustness.iter().filter(|rho| rho.is_none()).count() as u64;
            let failed = draws.into_iter().zip(&robustness).filter(|(_, rho)| rho.is_some_and(is_violated));
            self.failed.extend(failed.map(|(draw, _)| draw));
            self.failures = self.failed.len() as u64;
            if (robustness.len() as u64) < count {
                return Err(Stop::Interrupted);
            }
        }
        Ok(())
    }

    /// Decides from the simulations so far, the first part, whether failures are frequent enough
    /// for Monte Carlo alone.
    pub(crate) fn decide(&mut self) -> bool {
        let is_reached = self.failures >= FREQUENT;
        self.stages = Some(TwoStage { first: self.simulations, threshold: FREQUENT, is_reached });
        is_reached
    }

    /// Returns the failure rate with its exact 95 % interval, which accounts for the decision after
    /// the first part: see [`two_stage`](mishandle_evaluation::two_stage()).
    pub fn estimate(&self) -> Estimate {
        self.estimate_at(CONFIDENCE)
    }

    pub(crate) fn estimate_at(&self, confidence: f64) -> Estimate {
        match self.stages {
            None => clopper_pearson(self.failures, self.simulations, confidence),
            Some(stages) => two_stage(self.failures, self.simulations, stages, confidence),
        }
    }

    /// Returns an upper bound (97.5 %) of the failure rate in which every simulation without a
    /// verdict counts as a failure.
    pub fn bound_with_undecided(&self) -> Option<f64> {
        // The decision was made from the failures alone. It has two outcomes, each with half of the
        // probability of a miss.
        let confidence = 0.5 + 0.5 * CONFIDENCE;
        clopper_pearson(self.failures + self.without_verdict, self.simulations, confidence).high
    }
}
