//! Things that can be named: tasks, targets and searches.

use serde::Serialize;

use crate::{AxisFacts, RequirementPattern};

/// A task.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Task {
    /// Name of the task.
    pub name: String,
    /// Base task of a variant; `null` for other tasks.
    pub variant_of: Option<String>,
    /// Formula of success.
    pub success: String,
    /// Formula of strict success.
    pub strict: String,
    /// Formula of careful success; missing if the task has none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub careful: Option<String>,
    /// Formula that every safe sample satisfies.
    pub safe: String,
    /// Formula that holds when the task is complete.
    pub completion: String,
    /// Names of the signals. Traces contain those of the manner, which come last, only if a formula
    /// reads one of them.
    pub signals: Vec<String>,
    /// The axes of the initial box.
    pub initial_box: Vec<InitialAxis>,
    /// Names of the shipped controllers.
    pub controllers: Vec<String>,
    /// Notes on the task.
    pub notes: Vec<Note>,
}

/// An axis of an initial box.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct InitialAxis {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// Lower bound.
    pub low: f64,
    /// Upper bound.
    pub high: f64,
}

/// A note on a task.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Note {
    /// `paper` (differences from the paper), `physics` (that the MJCF does not show), `success`
    /// (what it does not say) or `weaknesses` (of the shipped controllers).
    pub topic: String,
    /// Whether the note applies to every task.
    pub every_task: bool,
    /// Subject; for `weaknesses` the controllers.
    pub subject: String,
    /// For `paper`: what the paper prints.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub paper: Option<String>,
    /// For `paper`: what this program uses.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub here: Option<String>,
    /// For `paper`: why it differs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub why: Option<String>,
    /// For the other topics: the fact.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fact: Option<String>,
    /// For the other topics: how it was measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub measured: Option<String>,
}

/// Everything that can be named, or one of it.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Listing {
    /// Tasks.
    pub tasks: Vec<Task>,
    /// Names of targets.
    pub targets: Vec<String>,
    /// The target with the name; missing if the name is none of a target.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub target: Option<Target>,
    /// Searches.
    pub searches: Vec<Search>,
    /// Shipped controllers, as TASK/NAME.
    pub controllers: Vec<String>,
    /// Patterns of requirements.
    pub patterns: Vec<RequirementPattern>,
}

/// A target.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Target {
    /// Name.
    pub name: String,
    /// Kind: `task`, `toy`, `arch`, `robot`, `process` or `python`.
    pub kind: String,
    /// Whether the same scenario and seed give the same episode.
    pub deterministic: bool,
    /// Duration of a control step, s.
    pub control_dt: f64,
    /// Number of control steps of an episode.
    pub episode_steps: u64,
    /// Named formulas, the default requirement first.
    pub formulas: Vec<Formula>,
    /// Signals.
    pub signals: Vec<Signal>,
    /// Named scenario spaces, the default first.
    pub spaces: Vec<Space>,
}

/// A named formula.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Formula {
    /// Name.
    pub name: String,
    /// Text.
    pub text: String,
}

/// A signal.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Signal {
    /// Name.
    pub name: String,
    /// Unit; empty without one.
    pub unit: String,
}

/// A scenario space.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Space {
    /// Name.
    pub name: String,
    /// Its axes.
    pub axes: Vec<Axis>,
}

/// An axis of a scenario space, with its distribution and meaning.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Axis {
    /// Name, bounds and values.
    #[serde(flatten)]
    pub facts: AxisFacts,
    /// Distribution of drawn values: `uniform` (of the logarithm for `logarithmic`) or `normal`.
    pub distribution: String,
    /// Quantity that the axis sets.
    pub meaning: String,
}

/// A search.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Search {
    /// Name.
    pub name: String,
    /// Summary in one line.
    pub summary: String,
    /// Paper.
    pub reference: String,
    /// Options.
    pub options: Vec<SearchOption>,
}

/// An option of a search.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct SearchOption {
    /// Name.
    pub name: String,
    /// Type of the value.
    #[serde(rename = "type")]
    pub kind: String,
    /// Default.
    pub default: String,
    /// Allowed values; empty if the type says all.
    pub range: String,
    /// Meaning.
    pub meaning: String,
}
