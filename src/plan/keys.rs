//! The keys of plans: name, description, default and allowed values of each.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use serde::de::{DeserializeOwned, Error};
use serde::{Deserialize, Deserializer};
use toml::Spanned;
use toml::de::{DeValue, ValueDeserializer};

use super::seed::SeedValue;
use super::{
    ComparePlan, EvaluatePlan, FalsifyPlan, GuardPlan, HardenPlan, MarginPlan, MetamorphicPlan, Plan,
    RiskPlan, ScreeningPlan, Settings,
};
use crate::error::MishandleError;

/// Table whose keys are the options of any search.
pub(super) const OPTIONS: &str = "falsify.options";

/// Table whose keys are names of axes.
pub(super) const AXES: &str = "axes";

/// Table whose keys are names of requirements, and whose values are formulas.
pub(super) const REQUIREMENTS: &str = "requirements";

/// Table whose keys are names of axes, and whose values are distributions.
pub(super) const DISTRIBUTIONS: &str = "risk.distributions";

/// Table whose keys are names of topics, and whose values are files.
pub(super) const TOPICS: &str = "log.topics";

/// Table whose keys are names of parameters, and whose values are steps.
pub(super) const RESOLUTION: &str = "formula.resolution";

/// Table whose keys are names of relations, each of which is a table.
pub(super) const RELATIONS: &str = "metamorphic.relations";

/// Allowed values of keys of several tables.
pub(super) const BOOLEAN: &str = "true or false";
pub(super) const FORMULA: &str = "a string, such as \"strict\"";
pub(super) const BATCH: &str = "an integer from 1 to 65536";
pub(super) const BUDGET: &str = "an integer from 1 to 1000000";
pub(super) const EPISODES: &str = "an integer from 1 to 1000000000";
pub(super) const SIMULATIONS: &str = "an integer from 100 to 1000000000";
pub(super) const SHARE: &str = "a number from 0 to 1";
pub(super) const NOISE: &str = "a number from 0 to 10";
pub(super) const UNTIL: &str = "\"decided\", or a width above 0, such as \"width=0.04\"";
pub(super) const SEED: &str = "an integer from 0 to 18446744073709551615; above 2^63 - 1 as a string";

/// A key of a plan.
#[derive(Clone, Debug)]
pub struct Key {
    /// Table and key, such as `falsify.budget`.
    pub name: String,
    /// Description.
    pub doc: &'static str,
    /// The default as TOML, if the key has one.
    pub default: Option<String>,
    /// Allowed values, in words.
    pub allowed: &'static str,
    /// Returns whether a value has the right type. Ranges are checked later, when the whole plan is
    /// known.
    pub(super) reads: fn(&Spanned<DeValue<'_>>) -> bool,
}

impl Key {
    /// Adds the name of the field and its description.
    pub(super) fn named(self, field: &str, doc: &'static str) -> Key {
        Key { name: field.replace('_', "-"), doc, ..self }
    }

    /// Completes the key of a field: its name with the table, and its default.
    pub(super) fn in_table(mut self, table: &str, defaults: &toml::Table) -> Key {
        self.default = defaults.get(&self.name).map(ToString::to_string);
        self.name = if table.is_empty() { self.name } else { format!("{table}.{}", self.name) };
        self
    }
}

/// The type of an integer from `LOW` to `HIGH`. Settings are checked key by key; the numbers of a
/// question are checked when the whole plan is known.
pub(super) struct Within<const LOW: u64, const HIGH: u64>;

impl<'de, const LOW: u64, const HIGH: u64> Deserialize<'de> for Within<LOW, HIGH> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let number = u64::deserialize(deserializer)?;
        if (LOW..=HIGH).contains(&number) { Ok(Within) } else { Err(D::Error::custom("out of range")) }
    }
}

/// The type of a number from 0 to 1.
pub(super) struct Share;

impl<'de> Deserialize<'de> for Share {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let share = f64::deserialize(deserializer)?;
        if (0.0..=1.0).contains(&share) { Ok(Share) } else { Err(D::Error::custom("out of range")) }
    }
}

/// The type of a number between 0 and 1, without both.
pub(super) struct OpenShare;

impl<'de> Deserialize<'de> for OpenShare {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let share = f64::deserialize(deserializer)?;
        if 0.0 < share && share < 1.0 { Ok(OpenShare) } else { Err(D::Error::custom("out of range")) }
    }
}

/// The type of a time above 0, seconds.
pub(super) struct Seconds;

impl<'de> Deserialize<'de> for Seconds {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let secs = f64::deserialize(deserializer)?;
        if secs > 0.0 && secs.is_finite() { Ok(Seconds) } else { Err(D::Error::custom("out of range")) }
    }
}

/// The type of the width and the height of an image, pixels.
pub(super) struct ImageSize;

impl<'de> Deserialize<'de> for ImageSize {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let sides = <[u16; 2]>::deserialize(deserializer)?;
        let is_allowed = sides.iter().all(|side| (1..=1024).contains(side));
        if is_allowed { Ok(ImageSize) } else { Err(D::Error::custom("out of range")) }
    }
}

/// Returns the key of a field of a type, without what identifies it.
pub(super) fn key<T: DeserializeOwned>(allowed: &'static str) -> Key {
    Key { name: String::new(), doc: "", default: None, allowed, reads: reads::<T> }
}

/// Returns whether a value has a type.
pub(super) fn reads<T: DeserializeOwned>(value: &Spanned<DeValue<'_>>) -> bool {
    T::deserialize(ValueDeserializer::from(value.clone())).is_ok()
}

/// Returns all keys: those of plans, in the order in which a plan is written, then those of
/// settings.
pub fn keys() -> &'static [Key] {
    static KEYS: LazyLock<Vec<Key>> =
        LazyLock::new(|| [plan_keys().to_vec(), Settings::described()].concat());
    &KEYS
}

/// Returns the keys of plans.
pub(super) fn plan_keys() -> &'static [Key] {
    static KEYS: LazyLock<Vec<Key>> = LazyLock::new(|| {
        [
            of_plan(),
            GuardPlan::described(),
            EvaluatePlan::described(),
            ComparePlan::described(),
            FalsifyPlan::described(),
            MarginPlan::described(),
            MetamorphicPlan::described(),
            RiskPlan::described(),
            HardenPlan::described(),
            ScreeningPlan::described(),
        ]
        .concat()
    });
    &KEYS
}

/// Returns the key with a name.
pub(super) fn find(name: &str) -> Option<&'static Key> {
    keys().iter().find(|key| key.name == name)
}

/// Returns the error of a value that a key does not allow.
pub(super) fn wrong(name: &str, found: &str) -> MishandleError {
    let expected = find(name).map_or("", |key| key.allowed).to_string();
    MishandleError::KeyValue { line: None, key: name.to_string(), found: found.to_string(), expected }
}

/// Returns the keys of a plan outside of its tables.
fn of_plan() -> Vec<Key> {
    let keys = [
        key::<u32>("2").named("format", "Version of the format."),
        key::<String>("a string, such as \"ball-balancing\"")
            .named("target", "Name of the target: a task, `toy/NAME`, or the path of a target file."),
        key::<String>("a string, such as \"simulators\"")
            .named("folder", "Working folder of the simulator and of the trainer."),
        key::<String>("a string, such as \"starts\"")
            .named("space", "Scenario space, or several joined by `+`."),
        key::<toml::Table>("a table of axes, as [axes]")
            .named(AXES, "Axes with a narrower range or a fixed value, by name."),
        key::<String>("\"paper\" or \"code\"")
            .named("preset", "Initial boxes and formulas: those of the benchmark's paper or of its code."),
        key::<String>("a string, such as \"ppo\"")
            .named("controller", "Name of a shipped controller, or a path."),
        key::<bool>(BOOLEAN).named("stochastic", "Sample the policy's actions instead of taking their mean."),
        key::<f64>(NOISE).named("action-noise", "Standard deviation of the Gaussian noise on each action."),
        key::<f64>(NOISE)
            .named("observation-noise", "Standard deviation of the Gaussian noise on each observation."),
        key::<SeedValue>(SEED).named("seed", "Random seed of the run."),
        key::<bool>(BOOLEAN).named("careful", "Evaluate the formula `careful` in every question."),
        key::<Share>(SHARE).named(
            "max-without-verdict",
            "Largest share of the simulations without a verdict with which a question has a conclusion.",
        ),
        key::<BTreeMap<String, String>>("a table of formulas by name, as [requirements], each a string")
            .named(REQUIREMENTS, "Requirements by name: names of formulas, or texts."),
    ];
    let mut defaults = toml::Table::try_from(Plan::new("", "")).unwrap_or_default();
    // Written only if it is another one.
    defaults.insert("max-without-verdict".to_string(), Plan::MAX_WITHOUT_VERDICT.into());
    keys.into_iter().map(|key| key.in_table("", &defaults)).collect()
}
