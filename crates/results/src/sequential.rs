use serde::Serialize;

use crate::word::words;
use crate::{Estimate, Number, Seed};

words! {
    /// Quantity that a rule watches.
    #[derive(Default)]
    pub enum Measure { #[default] Success = "success", Robustness = "robustness" }

    /// Reason that ended the simulations.
    pub enum StopDecision { Narrow = "narrow", Above = "above", Below = "below", Equivalent = "equivalent" }
}

/// A rule that ends simulations, and what it found. Its interval holds at any time: at all ends of
/// batches together, it contains the true value with a probability of at least 95 %.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Sequential {
    /// The rule: `decided` or `width=W`.
    pub until: String,
    /// Quantity that the rule watches: `success` or `robustness`.
    pub measure: Measure,
    /// The rate that `decided` compares with; missing without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rate: Option<Number>,
    /// The largest difference that counts as none; missing without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub margin: Option<Number>,
    /// Bounds of the robustness; values beyond them count as the bound. Missing for `success`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub robustness_bounds: Option<[Number; 2]>,
    /// Rate, or difference B - A, with an interval that holds at any time.
    pub interval: Estimate,
    /// p-value of "no difference" that holds at any time; missing for a rate.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub p_value: Option<f64>,
    /// Reason that ended the simulations: `narrow`, `above`, `below` or `equivalent`; `null` if the
    /// rule did not end them.
    pub decision: Option<StopDecision>,
    /// Number of simulations, or of pairs.
    pub simulations: u64,
    /// Largest number of simulations, or of pairs.
    pub max_simulations: u64,
    /// Finding of the rule, in a sentence.
    pub verdict: String,
}

/// How many simulations, or pairs, a question takes: fixed beforehand, and with a rule that stops
/// by itself. No target is simulated.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct SampleSize {
    /// The rule: `decided` or `width=W`.
    pub until: String,
    /// The rate that `decided` compares with; missing without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rate: Option<Number>,
    /// The largest difference that counts as none; missing without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub margin: Option<Number>,
    /// The expected success rate; missing for pairs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expected_rate: Option<Number>,
    /// The expected shares of pairs; missing for a rate.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expected_pairs: Option<ExpectedPairs>,
    /// Smallest number that is fixed beforehand and is enough with a probability of 90 %: the usual
    /// 5 % test or interval decides rightly, or the interval is as narrow as asked. `null` if it is
    /// above the maximum.
    pub fixed: Option<u64>,
    /// Median number of the rule that stops by itself, from replications of the rule; `null` if it
    /// does not decide in half of them.
    pub median: Option<u64>,
    /// Number within which the rule decides in 90 % of the replications; `null` if it does not.
    pub ninety_percent: Option<u64>,
    /// Mean number of the rule; a replication without a decision counts the maximum.
    pub mean: Number,
    /// Share of the replications in which the rule decides within the maximum.
    pub decided: Number,
    /// The maximum.
    pub max_simulations: u64,
    /// Number of simulations, or pairs, between two looks of the rule.
    pub batch: u64,
    /// Number of replications.
    pub replications: u64,
    /// Random seed of the replications.
    pub seed: Seed,
}

/// Expected shares of pairs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct ExpectedPairs {
    /// Both succeed.
    pub both: Number,
    /// Only A succeeds.
    pub first_only: Number,
    /// Only B succeeds.
    pub second_only: Number,
    /// Neither succeeds.
    pub neither: Number,
}
