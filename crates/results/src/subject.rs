use serde::{Deserialize, Serialize};

use crate::{Number, Seed};

/// Subject of a question: target, controller, noise and scenario space.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Subject {
    /// Name of the target.
    pub target: String,
    /// The same; the older name of `target`.
    pub task: String,
    /// Kind of the target: `task`, `toy`, `arch`, `robot`, `process` or `python`.
    pub target_kind: String,
    /// Hash of the target.
    pub target_hash: String,
    /// Task preset; `null` if the target is not a task.
    pub preset: Option<String>,
    /// Name of the controller; `null` without one.
    pub controller: Option<String>,
    /// The controller as the plan names it, by its name or its path; `null` without one.
    #[serde(skip)]
    pub controller_given: Option<String>,
    /// Hash of what the controller does; `null` without one.
    pub controller_hash: Option<String>,
    /// Guard of the controller; left out without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub guard: Option<GuardFacts>,
    /// Whether actions are sampled from the policy's distribution.
    pub stochastic: bool,
    /// Standard deviation of the noise that is added to actions.
    pub action_noise: f64,
    /// Standard deviation of the noise that is added to observations.
    pub observation_noise: f64,
    /// Seed of the plan, from which the seeds of simulations are derived. For `simulate`, and for
    /// `margin` of a target without noise, it is the seed of the simulations themselves; only those
    /// of repeats are derived from it.
    pub seed: Seed,
    /// Name of the scenario space.
    pub space: String,
    /// Names of its axes, the order of `initial_configuration`.
    pub axes: Vec<String>,
    /// The axes of the space in the same order.
    pub space_axes: Vec<AxisFacts>,
    /// Names of the axes whose range the plan sets.
    pub set_axes: Vec<String>,
    /// Duration of a control step, s.
    pub control_dt: f64,
    /// Number of control steps of a whole episode.
    pub episode_steps: u64,
    /// Other spaces and formulas of the target; `None` if only its run file is known.
    #[serde(skip)]
    pub offered: Option<Offered>,
}

/// Parts of a target, for advice on what to ask next.
#[derive(Clone, Debug, PartialEq)]
pub struct Offered {
    /// Names of its spaces.
    pub spaces: Vec<String>,
    /// Names and texts of its formulas.
    pub formulas: Vec<(String, String)>,
    /// Whether a simulation depends on its seed when every axis is nominal.
    pub is_random: bool,
    /// Names of the axes that add randomness where they are off nominal.
    pub random_axes: Vec<String>,
    /// Whether a hardening can train its controller.
    pub can_harden: bool,
}

impl Subject {
    /// Returns the axes whose range the plan sets and whose nominal value may follow from it: the
    /// midpoint of an initial state, a bound of another axis. That of the target is elsewhere if
    /// the range excludes it.
    pub fn moved_axes(&self) -> impl Iterator<Item = &AxisFacts> {
        let is_of_range = |axis: &AxisFacts, nominal: f64| match axis.kind.as_str() {
            "start" => nominal == f64::midpoint(axis.low, axis.high),
            _ => nominal == axis.low || nominal == axis.high,
        };
        let set = self.space_axes.iter().filter(|axis| self.set_axes.contains(&axis.name));
        set.filter(move |axis| axis.nominal.is_some_and(|nominal| is_of_range(axis, nominal)))
    }
}

/// A guard: an online monitor of the controller, and who acts instead of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct GuardFacts {
    /// Formula that is monitored.
    pub formula: String,
    /// Robustness below which the fallback takes over, in the unit of the formula.
    pub threshold: Number,
    /// Robustness from which on the controller acts again; `null` if the fallback keeps the
    /// control.
    pub return_threshold: Option<f64>,
    /// Shortest time for which the fallback acts, s.
    pub dwell: f64,
    /// The fallback: `hold`, `retreat`, or a controller.
    pub fallback: String,
    /// Whether the guard reads signals of the target, which the controller does not see.
    pub privileged: bool,
}

impl GuardFacts {
    /// Returns all settings in a sentence.
    pub fn sentence(&self) -> String {
        let back = match self.return_threshold {
            Some(value) => format!("; the controller acts again from {value} on"),
            None => String::new(),
        };
        let dwell = if self.dwell > 0.0 { format!(", at least for {} s", self.dwell) } else { String::new() };
        format!(
            "{} acts where the robustness of {} is below {}{dwell}{back}",
            self.words(),
            self.formula,
            self.threshold.0
        )
    }

    /// Returns the guard in words, such as `a guard with the fallback expert`.
    pub fn words(&self) -> String {
        let guard = if self.privileged { "a privileged guard" } else { "a guard" };
        format!("{guard} with the fallback {}", self.fallback)
    }
}

/// An axis of a scenario space.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct AxisFacts {
    /// Name.
    pub name: String,
    /// Kind of quantity: `start`, `model`, `event`, `fault`, `input` or `noise`.
    pub kind: String,
    /// Unit; empty without one.
    pub unit: String,
    /// Lower bound.
    pub low: f64,
    /// Upper bound.
    pub high: f64,
    /// Value in the undisturbed episode; `null`: drawn at random.
    pub nominal: Option<f64>,
    /// `continuous`, `logarithmic`, `integer`, or the names of the categories, whose values count
    /// from 0.
    pub values: AxisValues,
    /// Values of other axes that this axis needs for an effect, all of them; missing if it always
    /// has one. In other scenarios it is nominal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub only_if: Option<Vec<NeededAxis>>,
}

/// Values of an axis without which another one has no effect.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct NeededAxis {
    /// Name of the axis.
    pub axis: String,
    /// Its values with an effect; `null`: all but `other_than`.
    pub one_of: Option<Vec<f64>>,
    /// Its value without an effect; `null`: all but those in `one_of`.
    pub other_than: Option<f64>,
}

/// The values that an axis can take between its bounds.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(untagged)]
#[cfg_attr(feature = "schema", schemars(inline))]
pub enum AxisValues {
    /// `continuous`, `logarithmic` or `integer`.
    Kind(String),
    /// Names of the categories, whose values count from 0.
    Categories(Vec<String>),
}

impl AxisFacts {
    /// Returns whether the axis has whole numbers or categories.
    pub fn is_discrete(&self) -> bool {
        match &self.values {
            AxisValues::Kind(kind) => kind == "integer",
            AxisValues::Categories(_) => true,
        }
    }

    /// Returns whether the axis has an effect. `value` returns the values of other axes; an absent
    /// one has no effect on this.
    pub fn has_effect(&self, value: impl Fn(&str) -> Option<f64>) -> bool {
        self.only_if.iter().flatten().all(|needed| {
            value(&needed.axis).is_none_or(|value| match (&needed.one_of, needed.other_than) {
                (Some(values), _) => values.contains(&value),
                (None, other) => Some(value) != other,
            })
        })
    }

    /// Returns whether the axis has one value only.
    pub fn is_fixed(&self) -> bool {
        self.low == self.high
    }
}
