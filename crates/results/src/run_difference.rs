use serde::Serialize;

use crate::word::words;
use crate::{AxisFacts, Estimate, Number, RunFacts, Scenario, Seed};

/// How two runs differ, A and B.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct RunDifference {
    /// The run A.
    pub first: DifferingRun,
    /// The run B.
    pub second: DifferingRun,
    /// Whether all trials, simulations and traces are the same to the bit; exit code 0. The facts
    /// may differ nevertheless, such as the commit of the program.
    pub same_records: bool,
    /// Facts that differ: keys of the plan, target, controller, axes, formulas, program.
    pub facts: Vec<DifferingFact>,
    /// Rates and means of both runs, also equal ones.
    pub results: Vec<DifferingResult>,
    /// Why results of a run are missing.
    pub notes: Vec<String>,
    /// The simulations.
    pub simulations: DifferingSimulations,
    /// The axes of the scenarios of A.
    pub space_axes: Vec<AxisFacts>,
}

/// A run of a difference.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct DifferingRun {
    /// Path of the run file.
    pub run: String,
    /// Digest of all trials, simulations and traces, 32 hexadecimal digits.
    pub digest: String,
    /// Contents of the file.
    #[serde(flatten)]
    pub facts: RunFacts,
}

/// A fact in which two runs differ.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct DifferingFact {
    /// Subject of the fact, such as `plan action-noise` or `hash of the target`.
    pub name: String,
    /// In A; `null` if A has no such fact.
    pub first: Option<String>,
    /// In B; `null` if B has no such fact.
    pub second: Option<String>,
}

words! {
    /// The kind of the values of a result: a share from 0 to 1, a difference of two shares, or
    /// another number.
    pub enum Quantity { Share = "share", Difference = "difference", Number = "number" }
}

/// A rate or mean of two runs.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct DifferingResult {
    /// Name, such as `success rate`.
    pub name: String,
    /// The kind of its values.
    pub quantity: Quantity,
    /// In A, with its interval; `null` if A has none.
    pub first: Option<Estimate>,
    /// In B, with its interval; `null` if B has none.
    pub second: Option<Estimate>,
}

/// The simulations of two runs, place by place: trial and number.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct DifferingSimulations {
    /// Number of simulations with the same scenario and seed at the same place.
    pub shared: u64,
    /// Number of places with other scenarios or seeds.
    pub other_scenarios: u64,
    /// Number of places that only A has.
    pub first_only: u64,
    /// Number of places that only B has.
    pub second_only: u64,
    /// Number of shared simulations that are the same to the bit.
    pub same: u64,
    /// Number of shared simulations with another verdict.
    pub changed: u64,
    /// The first of these, at most 100.
    pub changes: Vec<ChangedVerdict>,
}

/// A simulation with another verdict in B than in A.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct ChangedVerdict {
    /// Number of the trial.
    pub trial: u32,
    /// Number of the simulation within the trial.
    pub simulation: u32,
    /// Random seed.
    pub seed: Seed,
    /// Scenario by axis; a value that is drawn at random is `null`.
    pub scenario: Scenario,
    /// Verdict in A: `passes`, `fails`, or the end of a simulation without one.
    pub first: String,
    /// Verdict in B.
    pub second: String,
    /// Robustness in A; `null` without a verdict.
    pub first_robustness: Option<Number>,
    /// Robustness in B; `null` without a verdict.
    pub second_robustness: Option<Number>,
}
