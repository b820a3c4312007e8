use serde::Serialize;

use crate::{AxisFacts, CheckedFailure, FailureMode, Number, PhysicsCheck, Repeats, Scenario, Seed};

/// The failure modes of a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Counterexamples {
    /// Path of the run file.
    pub run: String,
    /// Target of the run.
    pub target: String,
    /// Requirement of the run.
    pub formula: String,
    /// Number of simulations that violate the requirement.
    pub failures: u64,
    /// Number of these that are in no mode: without a recorded trace, or beyond 5,000.
    pub not_grouped: u64,
    /// Failure modes, the one with the most failures first.
    pub modes: Vec<FailureMode>,
    /// The axes of the scenario space.
    pub space_axes: Vec<AxisFacts>,
    /// Duration of a control step, s.
    pub control_dt: f64,
}

/// Exported counterexamples.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Exports {
    /// Path of the run file.
    pub run: String,
    /// The files.
    pub files: Vec<ExportedCounterexample>,
    /// The axes of the scenario space.
    pub space_axes: Vec<AxisFacts>,
}

/// An exported counterexample.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct ExportedCounterexample {
    /// Path of the file; `null` if it was not written: it is the same as another one, or depends on
    /// the solver of the physics.
    pub file: Option<String>,
    /// Path of a file whose minimized scenario differs by at most 1 % of the width of each axis, so
    /// that this one was not written; `null` if it was.
    pub same_as: Option<String>,
    /// Failure mode; `null` with `regress.simulation`.
    pub mode: Option<u64>,
    /// Number of the trial.
    pub trial: u32,
    /// Number of the simulation within the trial.
    pub simulation: u32,
    /// Random seed of the simulation.
    pub seed: Seed,
    /// Scenario by axis; a value that is drawn at random is `null`.
    pub scenario: Scenario,
    /// Robustness of the requirement.
    pub robustness: Number,
    /// Decisive predicate; `null` without one.
    pub predicate: Option<String>,
    /// The minimization; `null` without `regress.minimize`.
    pub minimized: Option<Minimized>,
    /// The check of the physics; `null` for a target whose physics MuJoCo C does not step. A
    /// counterexample that depends on the solver is not written.
    pub physics: Option<PhysicsCheck>,
}

/// How a counterexample was minimized.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Minimized {
    /// Recorded scenario by axis.
    pub scenario: Scenario,
    /// Its robustness.
    pub robustness: Option<Number>,
    /// Number of axes off nominal, recorded and minimized.
    pub axes_off_nominal: [u64; 2],
    /// Number of simulations.
    pub simulations: u64,
    /// Whether the budget was enough.
    pub complete: bool,
    /// Whether a signal ended the minimization or its repeats early.
    pub interrupted: bool,
    /// Whether every smaller set of axes passes, with these axes at their recorded values and the
    /// others at nominal.
    pub fewest_axes: bool,
    /// Simulations of the minimized scenario with other seeds; `null` without randomness.
    pub repeats: Option<Repeats>,
    /// Whether it went back toward the recorded scenario, because nearer failures depend on the
    /// solver of the physics.
    pub went_back: bool,
    /// The failures whose physics was checked, in order.
    pub checked: Vec<CheckedFailure>,
}
