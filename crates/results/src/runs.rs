use serde::Serialize;

use crate::{Answer, Counterexamples, GuardFacts, Number, Seed};

/// A run file. One that cannot be read has the keys `run` and `error` only.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct RunSummary {
    /// Path of the run file.
    pub run: String,
    /// Why the file cannot be read; `null` if it can.
    pub error: Option<String>,
    /// Contents of the file.
    #[serde(flatten)]
    pub facts: Option<RunFacts>,
}

/// The answer of `show` about a run file.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct RunShown {
    /// Answer of its question, as its command prints it, without the parts that take further
    /// simulations; `null` if the answer takes the target, which is not there.
    pub answer: Option<Answer>,
    /// Failure modes.
    pub counterexamples: Counterexamples,
}

/// Contents of a run file.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct RunFacts {
    /// Kind of the run: `evaluate`, `falsify`, `margin`, `metamorphic` or `risk`.
    pub kind: String,
    /// Name of the target.
    pub target: String,
    /// Kind of the target.
    pub target_kind: String,
    /// Name of the controller; empty without one.
    pub controller: String,
    /// Guard of the controller; left out without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub guard: Option<GuardFacts>,
    /// Scenario space.
    pub space: String,
    /// Requirement.
    pub formula: String,
    /// Search; empty for `evaluate`.
    pub search: String,
    /// Seed of the run.
    pub seed: Seed,
    /// Number of simulations.
    pub simulations: u64,
    /// Number of these that violate the requirement.
    pub failures: u64,
    /// Number of started trials.
    pub trials: u64,
    /// Number of these that found a counterexample.
    pub falsified_trials: u64,
    /// Relations of a metamorphic run; left out for other questions.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub relations: Option<RelationCounts>,
    /// Whether all trials have ended.
    pub is_complete: bool,
    /// Minimum robustness; `null` if no simulation has one.
    pub minimum_robustness: Option<Number>,
    /// Git commit of the program that made the run.
    pub commit: String,
}

/// Numbers of relations of a metamorphic run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct RelationCounts {
    /// Number of relations.
    pub asked: u64,
    /// Number of these that a pair breaks.
    pub broken: u64,
}
