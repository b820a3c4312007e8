use serde::Serialize;

use crate::{AxisFacts, BoxPoint, GuardFacts, Number, Scenario, Seed};

/// A recorded simulation, simulated again.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Replay {
    /// Path of the run file, or of the exported counterexample.
    pub run: String,
    /// Target.
    pub target: String,
    /// Guard of the controller; left out without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub guard: Option<GuardFacts>,
    /// Scenario space.
    pub space: String,
    /// Names of the axes, the order of `initial_configuration`.
    pub axes: Vec<String>,
    /// Number of the trial.
    pub trial: u32,
    /// Number of the simulation within the trial.
    pub simulation: u32,
    /// `corner` or `center` for a simulation at the corners of the initial box, trial 2 of an
    /// evaluation; otherwise `null`.
    pub point: Option<BoxPoint>,
    /// The values of `scenario` in the order of `axes`.
    pub initial_configuration: Vec<Option<f64>>,
    /// Scenario by axis; a value that is drawn at random is `null`.
    pub scenario: Scenario,
    /// Random seed of the simulation.
    pub seed: Seed,
    /// How the simulation ended, in words.
    pub end: String,
    /// Why the simulation ended so, in the words of the target or its controller; missing if they
    /// said nothing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Number of control steps.
    pub steps: u64,
    /// Robustness of the requirement; `null` without a verdict.
    pub robustness: Option<Number>,
    /// Whether the requirement is violated; `null` without a verdict. At a robustness of 0, `<=`,
    /// `>=` and `==` hold, and `<`, `>` and `!=` do not.
    pub violated: Option<bool>,
    /// Whether everything recorded of the simulation agrees with the plan of the run and with the
    /// replay, bit for bit.
    pub same: bool,
    /// Each difference as text: name, recorded value, expected or replayed value.
    pub differences: Vec<String>,
    /// The requirement.
    pub formula: String,
    /// Whether the end of the simulation allows a verdict.
    pub has_verdict: bool,
    /// The axes of the scenario space.
    pub space_axes: Vec<AxisFacts>,
}
