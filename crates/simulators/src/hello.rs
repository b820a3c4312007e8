//! The answer to the first question: what a simulator says about itself.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::words::in_words;

/// Version of the protocol.
pub const PROTOCOL: u64 = 1;

/// Largest length of the answer, bytes.
const LONGEST: usize = 4 << 20;

/// The description of a simulator. The reference page of the protocol describes the keys.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Hello {
    pub id: u64,
    pub protocol: u64,
    pub name: String,
    #[serde(default)]
    pub version: String,
    pub control_dt: f64,
    pub steps: usize,
    #[serde(default)]
    pub axes: Vec<AxisEntry>,
    /// In the order of the text: the first is the default.
    #[serde(default)]
    pub spaces: Map<String, Value>,
    pub signals: Vec<SignalEntry>,
    #[serde(default)]
    pub formulas: Vec<FormulaEntry>,
    #[serde(default = "yes")]
    pub deterministic: bool,
    #[serde(default)]
    pub seeded: bool,
    #[serde(default)]
    pub files: Vec<String>,
    #[serde(default)]
    pub versions: BTreeMap<String, String>,
    #[serde(default)]
    pub time_limit: Option<f64>,
    #[serde(default)]
    pub policy: Option<PolicyEntry>,
    #[serde(default)]
    pub mode: Option<Mode>,
}

/// An axis of the scenarios.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct AxisEntry {
    pub name: String,
    #[serde(default)]
    pub unit: String,
    pub low: Option<f64>,
    pub high: Option<f64>,
    pub nominal: Level,
    #[serde(default = "model")]
    pub kind: String,
    #[serde(default)]
    pub values: Values,
    #[serde(default)]
    pub meaning: String,
}

/// A number, or the name of a category.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub(crate) enum Level {
    Number(f64),
    Name(String),
}

/// Values of an axis: the name of a kind of numbers, or categories.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub(crate) enum Values {
    Kind(String),
    Categories(Vec<String>),
}

impl Default for Values {
    fn default() -> Self {
        Values::Kind("continuous".to_string())
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SignalEntry {
    pub name: String,
    #[serde(default)]
    pub unit: String,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct FormulaEntry {
    pub name: String,
    pub text: String,
}

/// Observation and action of a policy that Mishandle runs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PolicyEntry {
    pub observation: Vec<PartEntry>,
    pub action: Vec<PartEntry>,
    pub action_limit: f64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PartEntry {
    pub name: String,
    #[serde(default)]
    pub unit: String,
    #[serde(default = "one")]
    pub size: usize,
    #[serde(default)]
    pub range: Option<[f64; 2]>,
}

/// Content of one answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// The trace of a whole simulation.
    Trace,
    /// The next control step.
    Step,
}

fn yes() -> bool {
    true
}

fn one() -> usize {
    1
}

fn model() -> String {
    "model".to_string()
}

/// Why an answer to hello is not a description.
pub(crate) enum NoHello {
    /// The program answered with an error.
    Refused(String),
    /// Problem.
    Malformed(String),
}

/// An answer that is an error.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Refusal {
    #[serde(rename = "id")]
    _id: u64,
    error: String,
}

/// Reads the answer to question `id`.
pub(crate) fn read(text: &str, id: u64) -> Result<Hello, NoHello> {
    let malformed = |problem: String| NoHello::Malformed(problem);
    if text.len() > LONGEST {
        return Err(malformed(format!("{} bytes; at most {LONGEST} are possible", text.len())));
    }
    if let Ok(Refusal { error, .. }) = serde_json::from_str(text) {
        return Err(NoHello::Refused(error));
    }
    let hello: Hello = serde_json::from_str(text).map_err(|error| {
        let start: String = text.chars().take(200).collect();
        malformed(format!("`{start}`, which is not a description of a simulator: {}", in_words(&error)))
    })?;
    match (hello.id, hello.protocol) {
        (found, _) if found != id => Err(malformed(format!("the id {found} instead of {id}"))),
        (_, protocol) if protocol != PROTOCOL => {
            Err(malformed(format!("the protocol {protocol}; this program speaks {PROTOCOL}")))
        }
        _ => Ok(hello),
    }
}
