use serde::Serialize;

use crate::{EndReasons, Estimate, Number, Scenario, Screening, Seed, Subject, WithoutVerdict, number};

/// The probability of a violation under a distribution of scenarios.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Risk {
    /// Path of the run file; missing if none is written.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub run: Option<String>,
    /// Target, controller, noise and space of the simulations.
    #[serde(flatten)]
    pub subject: Subject,
    /// The requirement.
    pub formula: String,
    /// `auto`, `monte-carlo`, `importance`, `splitting` or `sequence`.
    pub method: String,
    /// The distribution of the scenarios.
    pub distribution: Vec<AxisDistribution>,
    /// Whether the seed of each simulation is random, too.
    pub seed_is_random: bool,
    /// Number of all simulations.
    pub simulations: u64,
    /// Whether the estimation was not interrupted; otherwise the answer is that of the finished
    /// parts.
    pub is_complete: bool,
    /// The simulations of Monte Carlo without a verdict.
    pub without_verdict: WithoutVerdict,
    /// Why no simulation asks anything of the controller, so that none is evidence; `null`
    /// otherwise.
    pub asks_nothing: Option<String>,
    /// The answer: lower and upper bound (95 %) of the probability without an assumption. For the
    /// upper one, simulations without a verdict are failures. `[0, 1]` without any verdict.
    pub bounds: [f64; 2],
    /// The estimate, whose interval may have an assumption; `null` without one.
    pub probability: Option<Probability>,
    /// Why parts have no estimate, in words; a budget that is too small for multilevel splitting is
    /// one of them.
    pub refusals: Vec<String>,
    /// Why multilevel splitting has no estimate: `budget`, `chains`, `invalid-starts`,
    /// `monte-carlo`, `below-importance` or `above-importance`; `null` if it has one, or was not
    /// needed.
    pub splitting_refusal: Option<String>,
    /// Plain Monte Carlo.
    pub monte_carlo: MonteCarlo,
    /// The search for failures.
    pub exploration: Exploration,
    /// Importance sampling; `null` if it was not run.
    pub importance: Option<Importance>,
    /// Multilevel splitting; `null` if it was not run.
    pub splitting: Option<Splitting>,
    /// Up to three failures, those nearest to the center of the distribution first.
    pub failures: Vec<RiskFailure>,
    /// Reasons that the target gave for the ends of simulations, by end; missing without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reasons: Option<Vec<EndReasons>>,
    /// Counts of the screening; missing without it. The estimate of Monte Carlo is then that of a
    /// two-phase sample: see `gpu.md`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub screening: Option<Screening>,
}

impl Risk {
    /// Returns the bounds, with the value of the estimate if its interval assumes nothing.
    pub fn without_assumption(&self) -> Estimate {
        let estimate = self.probability.as_ref().filter(|found| found.assumption.is_none());
        let [low, high] = self.bounds.map(Some);
        Estimate { value: estimate.and_then(|found| found.value), low, high, n: self.simulations }
    }

    /// Returns the estimate of a part whose interval counts simulations without a verdict as
    /// passed: without the interval if Monte Carlo met one.
    pub fn part(&self, estimate: Estimate) -> Estimate {
        match self.monte_carlo.without_verdict {
            0 => estimate,
            _ => Estimate { low: None, high: None, ..estimate },
        }
    }
}

/// The distribution of an axis.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct AxisDistribution {
    /// Name of the axis.
    pub axis: String,
    /// Its distribution; `fixed` for an axis with one value.
    pub distribution: String,
    /// Lower bound of the axis, where the distribution is truncated.
    pub low: f64,
    /// Upper bound of the axis, where the distribution is truncated.
    pub high: f64,
    /// Unit of the axis.
    pub unit: String,
}

/// A probability of a violation with its 95 % interval.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Probability {
    /// Assumption of the interval; `null` if it has none.
    pub assumption: Option<String>,
    /// Estimate.
    pub value: Option<f64>,
    /// Lower bound.
    pub low: Option<f64>,
    /// Upper bound.
    pub high: Option<f64>,
    /// Part that it is from: `monte-carlo`, `importance` or `splitting`.
    pub source: String,
}

/// Independent simulations under the distribution itself.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct MonteCarlo {
    /// Number of simulations.
    pub simulations: u64,
    /// Number of these that violate the requirement.
    pub failures: u64,
    /// Number of these from whose scenario the target cannot start, which leave the failure rate;
    /// missing if there are none.
    #[serde(skip_serializing_if = "is_zero")]
    pub invalid_starts: u64,
    /// Number of started simulations without a verdict.
    pub without_verdict: u64,
    /// Upper bound of the probability (97.5 %) if the simulations without a verdict are failures.
    pub bound_with_undecided: Option<Number>,
    /// Failure rate, with its exact 95 % interval (Clopper and Pearson, with the decision that ends
    /// Monte Carlo). Simulations without a verdict count as failures in the upper bound only.
    pub failure_rate: Estimate,
}

impl MonteCarlo {
    /// Returns the numbers behind the failure rate in words: `2 failures, 1 without a verdict`.
    pub fn counts_text(&self) -> String {
        let failures = match self.failures {
            1 => "1 failure".to_string(),
            n => format!("{n} failures"),
        };
        match self.without_verdict {
            0 => failures,
            n => format!("{failures}, {n} without a verdict"),
        }
    }
}

/// The search for failures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Exploration {
    /// Number of simulations.
    pub simulations: u64,
}

/// Simulations under a distribution that is fitted to the failures, with weights.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Importance {
    /// Number of simulations that fitted the regions.
    pub fitting_simulations: u64,
    /// Number of simulations of the estimate.
    pub simulations: u64,
    /// Number of failures in the regions.
    pub failures: u64,
    /// Number of equally weighted failures with the same precision.
    pub effective_failures: f64,
    /// Number of regions.
    pub components: u64,
    /// Probability of a failure in the regions, with a 95 % betting interval. It is that among all
    /// scenarios, so it does not answer the question if `monte_carlo` has invalid starts.
    pub regions: Estimate,
    /// Estimate of the probability of failures outside of the regions from the few draws there,
    /// without an interval.
    pub outside: f64,
    /// Number of failures of Monte Carlo in the regions.
    pub monte_carlo_inside: u64,
    /// Number of failures of Monte Carlo outside of them.
    pub monte_carlo_outside: u64,
}

/// Adaptive multilevel splitting with independent chains.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Splitting {
    /// Number of simulations.
    pub simulations: u64,
    /// Number of particles of a chain.
    pub population: u64,
    /// Mean of the chains; `null` if they disagree or are too small.
    pub estimate: Option<Estimate>,
    /// The chains.
    pub chains: Vec<Chain>,
}

/// A chain of multilevel splitting.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Chain {
    /// Estimate of the probability of a robustness below the level.
    pub probability: f64,
    /// 0 if the chain reached the failures, otherwise the robustness that it reached.
    #[serde(serialize_with = "number")]
    #[cfg_attr(feature = "schema", schemars(with = "Number"))]
    pub level: f64,
    /// Whether it reached the failures.
    pub is_complete: bool,
    /// Number of levels.
    pub levels: u32,
    /// Fraction of accepted moves.
    pub acceptance: f64,
}

/// A failure.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct RiskFailure {
    /// Scenario by axis; a value that is drawn at random is `null`.
    pub scenario: Scenario,
    /// Number of the simulation in the run.
    pub simulation: u32,
    /// Random seed.
    pub seed: Seed,
    /// Robustness.
    pub robustness: Number,
}

fn is_zero(count: &u64) -> bool {
    *count == 0
}
