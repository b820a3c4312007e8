use serde::Serialize;

use crate::Named;

/// Counts of a screening: another engine simulates everything, MuJoCo C confirms what it flags and
/// an audit sample of the rest.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Screening {
    /// Device of the other engine: `gpu`.
    pub device: String,
    /// Number of screened simulations.
    pub simulations: u64,
    /// Number of these that were flagged: with a violation (for an evaluation without success) or
    /// without a verdict there, for a falsification also those with a lower robustness than all
    /// earlier ones of their trial. MuJoCo C repeated all of them.
    pub flagged: u64,
    /// Number of others that MuJoCo C repeated: a random sample.
    pub audit_sample: u64,
    /// Number of screened simulations without a verdict.
    pub without_verdict: u64,
    /// Number of these for lack of memory for contacts or constraints.
    pub overflows: u64,
    /// Number of simulations of MuJoCo C without a verdict.
    pub confirmed_without_verdict: u64,
    /// Findings of MuJoCo C, by kind: `failure`, and for an evaluation `strict_failure` and
    /// `dangerous` if the target has these formulas, which do not flag; missing for a
    /// falsification.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub findings: Option<Named<Finding>>,
    /// Of a falsification, the simulations of MuJoCo C by their reason: `violated`,
    /// `without_verdict`, `lowest` (lower than all earlier ones of the trial) and `audit_sample`;
    /// missing for other questions.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reasons: Option<Named<Confirmed>>,
}

/// Number of simulations in which MuJoCo C found something.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Finding {
    /// Number among the flagged simulations.
    pub flagged: u64,
    /// Number in the audit sample.
    pub audit_sample: u64,
}

/// Simulations that MuJoCo C repeated for one reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Confirmed {
    /// Number of simulations.
    pub simulations: u64,
    /// Number of these that violate the requirement.
    pub violations: u64,
}
