use serde::{Deserialize, Serialize};

#[cfg(feature = "schema")]
use crate::Number;
use crate::word::words;
use crate::{Estimate, GuardFacts, Seed, WithoutVerdict, optional};

/// A controller before and after a hardening: the final comparison, and how it was reached.
///
/// The measures, the failure probabilities, the margins and the searches are from the final set:
/// scenarios and seeds that are simulated once, after the last decision. No training run and no
/// decision used them. The corners of the initial box are the same points everywhere.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Hardening {
    /// Name of the target.
    pub target: String,
    /// Scenario space in which the controller shall fail less often.
    pub space: String,
    /// Random seed.
    pub seed: Seed,
    /// Name or path of the controller before.
    pub before: String,
    /// Guard under which the controllers act and train; left out without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub guard: Option<GuardFacts>,
    /// Command of the trainer of the user; left out if this program trained.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub trainer: Option<String>,
    /// File of the accepted controller; `null` if no round was accepted.
    pub after: Option<String>,
    /// Folder of the runs.
    pub folder: String,
    /// Git commit of the program that began the final comparison.
    pub commit: String,
    /// The random simulations in the space without a verdict, before and after: the simulations of
    /// the final set that measure the success rate and the failure probability.
    pub without_verdict: WithoutVerdict,
    /// The result in a sentence.
    pub verdict: String,
    /// Names of the measures that are worse after, at 5 % after Holm's correction, and `corners` if
    /// the controller succeeds at fewer of them.
    pub worse: Vec<String>,
    /// The measures before and after.
    pub measures: Vec<HardenedMeasure>,
    /// Corners of the initial box at which all simulations succeed; `null` without a box.
    pub corners: Option<HardenedCorners>,
    /// Failure probability in the space by Monte Carlo, with its Clopper-Pearson interval, before
    /// and, if a round was accepted, after.
    pub failure_probability: Vec<Estimate>,
    /// Bounds of the smallest disturbance that breaks the controller, before and, if a round was
    /// accepted, after; empty if the space has starts only.
    pub margin: Vec<HardenedMargin>,
    /// Searches with the same budget, before and, if a round was accepted, after.
    pub searches: Vec<HardenedSearch>,
    /// Failure modes of these searches, before and after.
    pub modes: Vec<HardenedMode>,
    /// Failures that were found and trained on, and how many of them are fixed: no held-out
    /// measure. `null` if no round was accepted.
    pub archive: Option<HardenedArchive>,
    /// The rounds, in order.
    pub rounds: Vec<HardeningRound>,
    /// Environment steps of all training runs; 0 with a trainer of the user.
    pub environment_steps: u64,
    /// Simulations of all runs in the folder.
    pub simulations: u64,
}

/// A rate of success before and after.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct HardenedMeasure {
    /// Name: `space` (success in the space), `success`, `strict` and `careful` (from random
    /// starts), `noise` (from random starts with action noise of 0.5).
    pub name: String,
    /// Rate before, with its Wilson interval.
    pub before: Estimate,
    /// Rate after; `null` if no round was accepted.
    pub after: Option<Estimate>,
    /// After minus before, with Newcombe's interval for pairs.
    pub difference: Option<Estimate>,
    /// Number of pairs in which only the controller before succeeds.
    pub broken: u64,
    /// Number of pairs in which only the controller after succeeds.
    pub fixed: u64,
    /// Two-sided p-value of the exact McNemar test; `null` without a controller after.
    #[serde(with = "optional")]
    #[cfg_attr(feature = "schema", schemars(with = "Option<Number>"))]
    pub p_value: Option<f64>,
    /// The p-value, adjusted by Holm's method for all measures.
    #[serde(with = "optional")]
    #[cfg_attr(feature = "schema", schemars(with = "Option<Number>"))]
    pub adjusted_p_value: Option<f64>,
}

impl HardenedMeasure {
    /// Returns the name in words.
    pub fn label(&self) -> &str {
        match self.name.as_str() {
            "space" => "success in the space",
            "success" => "success from random starts",
            "strict" => "strict success",
            "careful" => "careful success",
            "noise" => "success with action noise 0.5",
            other => other,
        }
    }
}

/// Corners of the initial box before and after.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct HardenedCorners {
    /// Number of corners.
    pub corners: u64,
    /// Number of these at which all simulations succeed, before.
    pub before: u64,
    /// The same, after; `null` if no round was accepted.
    pub after: Option<u64>,
}

/// The smallest disturbance of a controller.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct HardenedMargin {
    /// Amplitude of the smallest disturbance that breaks it; `null` if none was found.
    #[serde(with = "optional")]
    #[cfg_attr(feature = "schema", schemars(with = "Option<Number>"))]
    pub amplitude: Option<f64>,
    /// Largest amplitude at which no simulation failed.
    #[serde(with = "optional")]
    #[cfg_attr(feature = "schema", schemars(with = "Option<Number>"))]
    pub without_failure: Option<f64>,
    /// Number of simulations.
    pub simulations: u64,
}

/// Searches for failures of a controller.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct HardenedSearch {
    /// Number of simulations.
    pub simulations: u64,
    /// Number of these that fail.
    pub failures: u64,
    /// Number of failure modes.
    pub modes: u64,
}

/// A failure mode in the searches of the final comparison.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct HardenedMode {
    /// Decisive predicate.
    pub predicate: String,
    /// Axes by which its failures were grouped.
    pub axes: Vec<String>,
    /// `vanished`, `stayed` or `appeared`.
    pub change: ModeChange,
    /// Number of its failures before.
    pub before: u64,
    /// Number of its failures after.
    pub after: u64,
}

impl HardenedMode {
    /// Returns the index of the controller whose failures show the mode: 0 for the one before, if
    /// it vanished, otherwise 1.
    pub fn failing(&self) -> usize {
        usize::from(self.change != ModeChange::Vanished)
    }
}

words! {
    /// Change of a failure mode, the most important one for a decision first.
    pub enum ModeChange { Appeared = "appeared", Stayed = "stayed", Vanished = "vanished" }
}

impl ModeChange {
    /// Returns the change by the numbers of failures before and after.
    pub fn new(before: u64, after: u64) -> ModeChange {
        match (before, after) {
            (0, _) => ModeChange::Appeared,
            (_, 0) => ModeChange::Vanished,
            _ => ModeChange::Stayed,
        }
    }
}

/// Failures that the searches of the rounds found, simulated again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct HardenedArchive {
    /// Number of failures.
    pub failures: u64,
    /// Number of these that the controller after passes, with the same seed.
    pub fixed: u64,
}

/// A round of a hardening.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct HardeningRound {
    /// Number of the round, from 1.
    pub number: u32,
    /// Failures that its searches found.
    pub failures: u64,
    /// Environment steps of its training; 0 if a trainer of the user trained, which does not say.
    pub environment_steps: u64,
    /// First 32 digits of the SHA-256 of the file that a trainer of the user wrote; left out
    /// without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file_hash: Option<String>,
    /// Upper bound of the failure rate in the space before the round, on the validation set.
    #[serde(with = "optional")]
    #[cfg_attr(feature = "schema", schemars(with = "Option<Number>"))]
    pub bound_before: Option<f64>,
    /// The same after the round; `null` without a candidate.
    #[serde(with = "optional")]
    #[cfg_attr(feature = "schema", schemars(with = "Option<Number>"))]
    pub bound_after: Option<f64>,
    /// Whether the round was accepted.
    pub accepted: bool,
    /// Reason for it, in a sentence.
    pub reason: String,
}
