use serde::Serialize;

use crate::Seed;

/// Units of collected results, run again.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Verification {
    /// Commit at which the digests hold, from the manifest; `null` if it names none.
    pub commit: Option<String>,
    /// Commit of this program.
    pub program: String,
    /// Share of the units.
    pub share: f64,
    /// Seed that chose the units.
    pub seed: Seed,
    /// Number of units of the results.
    pub all_units: u64,
    /// Number of units that agree.
    pub agreeing: u64,
    /// The units that were run again.
    pub units: Vec<VerifiedUnit>,
}

/// A unit that was run again: a trial of a falsification, or a hundred simulations of an
/// evaluation.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct VerifiedUnit {
    /// Name of the campaign.
    pub campaign: String,
    /// Name of the run.
    pub run: String,
    /// Number of the trial.
    pub trial: u32,
    /// Number of the first simulation.
    pub first: u32,
    /// Number of simulations, as recorded.
    pub simulations: u32,
    /// Whether the rows have the recorded digest, and all counts are the same.
    pub agrees: bool,
    /// Each difference as text: name, recorded value, value of the new simulations.
    pub differences: Vec<String>,
}
