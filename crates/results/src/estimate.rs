use serde::{Deserialize, Serialize};

use crate::{Number, optional};

/// A rate or mean over `n` simulations with its 95 % confidence interval.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Estimate {
    /// Estimate; `null` if `n` is 0 or no simulation has a verdict.
    #[serde(with = "optional")]
    #[cfg_attr(feature = "schema", schemars(with = "Option<Number>"))]
    pub value: Option<f64>,
    /// Lower bound of the interval; `null` for a degenerate sample.
    #[serde(with = "optional")]
    #[cfg_attr(feature = "schema", schemars(with = "Option<Number>"))]
    pub low: Option<f64>,
    /// Upper bound of the interval; `null` for a degenerate sample.
    #[serde(with = "optional")]
    #[cfg_attr(feature = "schema", schemars(with = "Option<Number>"))]
    pub high: Option<f64>,
    /// Number of simulations in the estimate.
    pub n: u64,
}

/// The probabilities of [`Repeats::quantiles`].
pub const QUANTILES: [f64; 5] = [0.0, 0.05, 0.5, 0.95, 1.0];

/// Simulations of one scenario with other random seeds.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Repeats {
    /// Number of simulations, with or without a verdict.
    pub simulations: u64,
    /// Number of these that violate the requirement.
    pub failures: u64,
    /// Number of these without a verdict.
    pub without_verdict: u64,
    /// Failure rate with its Wilson interval. Simulations without a verdict count as failures in
    /// the upper bound only; `null` without any verdict.
    pub failure_rate: Estimate,
    /// Quantiles of the robustness at the probabilities 0, 0.05, 0.5, 0.95 and 1, linearly
    /// interpolated; `null` without a verdict.
    pub quantiles: Option<Vec<Quantile>>,
}

impl Repeats {
    /// Returns whether more than half of the simulations violate the requirement. One without a
    /// verdict counts as one that does not.
    pub fn fails_in_most(&self) -> bool {
        2 * self.failures > self.simulations
    }
}

/// A quantile of the robustness.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Quantile {
    /// Probability.
    pub p: f64,
    /// Robustness that this fraction of the simulations does not exceed.
    pub robustness: Number,
}
