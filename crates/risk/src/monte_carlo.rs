//! Plain Monte Carlo: independent simulations under the distribution itself.

use mishandle_evaluation::{Estimate, clopper_pearson};
use mishandle_random::Sequence;

use crate::experiment::Experiment;
use crate::{CONFIDENCE, Draw, RiskError};

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
}

/// Number of draws that are made at once.
const CHUNK: u64 = 4096;

impl MonteCarlo {
    /// Adds `n` simulations.
    pub(crate) fn run(
        &mut self,
        experiment: &mut Experiment<'_>,
        random: &mut Sequence,
        n: u64,
    ) -> Result<(), RiskError> {
        let end = self.simulations + n;
        while self.simulations < end {
            let count = CHUNK.min(end - self.simulations);
            let draws: Vec<Draw> = (0..count).map(|_| experiment.scenarios.draw(random)).collect();
            let robustness = experiment.simulate(&draws)?;
            self.simulations += count;
            self.without_verdict += robustness.iter().filter(|rho| rho.is_none()).count() as u64;
            let failed =
                draws.into_iter().zip(&robustness).filter(|(_, rho)| **rho < Some(0.0) && rho.is_some());
            self.failed.extend(failed.map(|(draw, _)| draw));
            self.failures = self.failed.len() as u64;
        }
        Ok(())
    }

    /// Returns the failure rate with its exact 95 % interval (Clopper and Pearson).
    pub fn estimate(&self) -> Estimate {
        self.estimate_at(CONFIDENCE)
    }

    pub(crate) fn estimate_at(&self, confidence: f64) -> Estimate {
        clopper_pearson(self.failures, self.simulations, confidence)
    }

    /// Returns an upper bound (97.5 %) of the failure rate in which every simulation without a verdict counts as a failure.
    pub fn bound_with_undecided(&self) -> Option<f64> {
        clopper_pearson(self.failures + self.without_verdict, self.simulations, CONFIDENCE).high
    }
}
