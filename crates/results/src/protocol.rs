use serde::Serialize;

/// Whether a simulator that is a program keeps the protocol.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct ProtocolCheck {
    /// The command.
    pub command: String,
    /// Name of the simulator; `null` if it does not describe itself.
    pub name: Option<String>,
    /// Whether all checks passed.
    pub passed: bool,
    /// The checks, in the order in which they were made. A check that a failed one makes pointless
    /// is missing.
    pub checks: Vec<ProtocolFinding>,
    /// Time from the start of the program to its description, s; `null` without one.
    pub start_seconds: Option<f64>,
    /// Median time of the simulations of the nominal scenario, s; `null` without one.
    pub simulation_seconds: Option<f64>,
    /// Mean time of a control step in these simulations, s; `null` in the mode `trace`.
    pub step_seconds: Option<f64>,
}

/// The outcome of one check.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct ProtocolFinding {
    /// Name of the check: `hello`, `nominal`, `corners`, `repeat`, `seeds`, `order`, `unknown`,
    /// `process`, `output` or `end`.
    pub check: String,
    /// Whether it passed.
    pub passed: bool,
    /// Finding in words; if the check failed, with a way out.
    pub finding: String,
}
