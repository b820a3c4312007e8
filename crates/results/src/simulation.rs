use serde::Serialize;

use crate::{Explanation, Number, Repeats, Scenario, Subject};

/// Simulations of one chosen scenario.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Simulation {
    /// Target, controller, noise and space of the simulation.
    #[serde(flatten)]
    pub subject: Subject,
    /// Scenario by axis; a value that is drawn at random is `null`.
    pub scenario: Scenario,
    /// The requirement.
    pub formula: String,
    /// How the simulation ended, in words; `null` with `--repeat`, as the next three keys.
    pub end: Option<String>,
    /// Why the simulation ended so, in the words of the target or its controller; missing if they
    /// said nothing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Number of control steps.
    pub steps: Option<u64>,
    /// Robustness of the requirement.
    pub robustness: Option<Number>,
    /// Whether the requirement is violated; `null` without a verdict. At a robustness of 0, `<=`,
    /// `>=` and `==` hold, and `<`, `>` and `!=` do not.
    pub violated: Option<bool>,
    /// The document of `show --simulation`, without `schema` and `run`.
    pub explanation: Option<Explanation>,
    /// Each named requirement; missing without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub requirements: Option<Vec<RequirementVerdict>>,
    /// Repeated simulations; `null` without `--repeat`.
    pub repeats: Option<Repeats>,
    /// Split of the variance of the robustness; `null` without `--repeat` or randomness.
    pub noise: Option<Noise>,
}

/// A named requirement on one simulation.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct RequirementVerdict {
    /// Name.
    pub name: String,
    /// Formula.
    pub formula: String,
    /// Its robustness; `null` without a verdict.
    pub robustness: Option<Number>,
    /// Whether it is violated; `null` without a verdict.
    pub violated: Option<bool>,
    /// Why it is satisfied and asks nothing; `null` otherwise.
    pub asks_nothing: Option<String>,
}

/// The share of the variance of the robustness that comes from the scenario; the rest comes from
/// noise. A region of failures that none of the scenarios met is in neither share.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Noise {
    /// Share that comes from the scenario, from 0 to 1; `null` if the robustness is constant,
    /// infinite or undecided.
    pub scenario_share: Option<f64>,
    /// Lower and upper bound of its 95 % interval, which assumes no distribution of the robustness.
    pub scenario_share_interval: Option<[f64; 2]>,
    /// Number of random scenarios.
    pub scenarios: u64,
    /// Number of simulations of each.
    pub repeats: u64,
}
