//! Facts about a setting besides its value: its description and its allowed values.

use mishandle_controllers::ActionInterface;
use mishandle_network::Activation;
use mishandle_rollout::Noise;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::{DeValue, ValueDeserializer};

use crate::TrainingError;

/// Facts about a setting besides its value.
#[derive(Clone, Debug)]
pub struct Setting {
    /// Table and key: `run.total_steps`, or the key alone for a setting outside of tables.
    pub name: &'static str,
    /// Description, as Markdown.
    pub description: &'static str,
    /// Allowed values, in words.
    pub allowed: String,
    /// Allowed names, if the setting is an enumeration.
    pub choices: &'static [Choice],
    pub(crate) reads: fn(Spanned<DeValue<'_>>) -> bool,
}

/// One of the names that an enumerated setting accepts.
#[derive(Clone, Copy, Debug)]
pub struct Choice {
    /// Name in the settings file.
    pub name: &'static str,
    /// Description, as Markdown.
    pub description: &'static str,
}

impl Setting {
    pub(crate) fn new<K: SettingKind>(
        name: &'static str,
        description: &'static str,
        constraint: Option<&Constraint>,
    ) -> Setting {
        let allowed = constraint.map_or_else(K::allowed, |constraint| constraint.allowed.to_string());
        Setting { name, description, allowed, choices: K::choices(), reads: K::reads }
    }

    /// Returns the table, empty for a setting outside of tables, and the key.
    pub fn table_and_key(&self) -> (&'static str, &'static str) {
        self.name.rsplit_once('.').unwrap_or(("", self.name))
    }
}

/// Constraint on the numbers of a setting.
pub(crate) struct Constraint {
    /// The constraint in words: "a number above 0".
    pub allowed: &'static str,
    pub holds: fn(&[f64]) -> bool,
}

pub(crate) const fn constraint(allowed: &'static str, holds: fn(&[f64]) -> bool) -> Constraint {
    Constraint { allowed, holds }
}

/// Largest count of anything. A larger one is a typing error.
const MAX_COUNT: f64 = 1e12;

pub(crate) const AT_LEAST_1: Constraint =
    constraint("a whole number from 1 to 10^12", |x| x.iter().all(|x| (1.0..=MAX_COUNT).contains(x)));
pub(crate) const AT_LEAST_2: Constraint =
    constraint("a whole number from 2 to 10^12", |x| x.iter().all(|x| (2.0..=MAX_COUNT).contains(x)));
/// Sizes of arrays are bounded, so that a typing error is reported instead of exhausting the
/// memory.
pub(crate) const ARRAY_SIZE: Constraint =
    constraint("a whole number from 1 to 10^6", |x| x.iter().all(|x| (1.0..=1e6).contains(x)));
pub(crate) const CAPACITY: Constraint =
    constraint("a whole number from 1 to 10^9", |x| x.iter().all(|x| (1.0..=1e9).contains(x)));
/// The memory of all rows and of the replay buffer grows with the history.
pub(crate) const HISTORY: Constraint =
    constraint("a whole number from 0 to 500", |x| x.iter().all(|x| (0.0..=500.0).contains(x)));
pub(crate) const FRACTION: Constraint =
    constraint("a number from 0 to 1", |x| x.iter().all(|x| (0.0..=1.0).contains(x)));
pub(crate) const POSITIVE: Constraint =
    constraint("a number above 0", |x| x.iter().all(|x| *x > 0.0 && x.is_finite()));
pub(crate) const NOT_NEGATIVE: Constraint =
    constraint("a number of at least 0", |x| x.iter().all(|x| *x >= 0.0 && x.is_finite()));
/// The bound of [`Noise::MAX_STD`](mishandle_rollout::Noise::MAX_STD).
pub(crate) const NOISE: Constraint =
    constraint("a number from 0 to 10", |x| x.iter().all(|x| (0.0..=Noise::MAX_STD).contains(x)));
pub(crate) const FINITE: Constraint = constraint("a finite number", |x| x.iter().all(|x| x.is_finite()));
/// The sizes and the weights between hidden layers are bounded, so that a controller is smaller
/// than the limit for reading it.
pub(crate) const LAYER_SIZES: Constraint = constraint(
    "a list of up to 100 whole numbers from 1 to 10^4, as [64, 64], with at most 5·10^7 weights between them",
    |x| {
        let weights: f64 = x.windows(2).map(|sizes| sizes[0] * sizes[1]).sum();
        x.len() <= 100 && x.iter().all(|x| (1.0..=1e4).contains(x)) && weights <= 5e7
    },
);
pub(crate) const INITIALIZATION: Constraint =
    constraint("\"orthogonal\", \"uniform\" or { normal = σ } with σ above 0", POSITIVE.holds);
pub(crate) const POSITIVE_RANGE: Constraint =
    constraint("two numbers above 0 in ascending order, as [0.1, 0.5]", |x| {
        x.is_sorted() && x.iter().all(|x| *x > 0.0 && x.is_finite())
    });
pub(crate) const NOT_NEGATIVE_RANGE: Constraint =
    constraint("two numbers of at least 0 in ascending order, as [0.1, 0.5]", |x| {
        x.is_sorted() && x.iter().all(|x| *x >= 0.0 && x.is_finite())
    });
pub(crate) const DECAY: Constraint = constraint(
    "{ steps = N, share = X } with a whole number N from 1 to 10^12 and a number X from 0 to 1",
    |x| (1.0..=MAX_COUNT).contains(&x[0]) && (0.0..=1.0).contains(&x[1]),
);

/// Type of a setting's value.
pub(crate) trait SettingKind {
    /// Returns the allowed values in words, for a setting without a constraint.
    fn allowed() -> String;

    fn choices() -> &'static [Choice] {
        &[]
    }

    /// Returns whether a TOML value has this type.
    fn reads(value: Spanned<DeValue<'_>>) -> bool;

    /// Returns the numbers that a constraint applies to, if the value has any.
    fn numbers(&self) -> Option<Vec<f64>> {
        None
    }
}

pub(crate) fn reads_as<T: DeserializeOwned>(value: Spanned<DeValue<'_>>) -> bool {
    // Integers above 2^63 fit into a Rust u64, but not into a TOML integer.
    toml::Value::deserialize(ValueDeserializer::from(value.clone())).is_ok()
        && T::deserialize(ValueDeserializer::from(value)).is_ok()
}

/// `"a", "b" or "c"`
pub(crate) fn one_of<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    let mut names: Vec<String> = names.into_iter().map(|name| format!("\"{name}\"")).collect();
    let last = names.pop().unwrap_or_default();
    if names.is_empty() { last } else { format!("{} or {last}", names.join(", ")) }
}

/// Implements [`SettingKind`] for a type that serde reads and that consists of numbers.
macro_rules! kind {
    ($kind:ty, $allowed:literal, $value:ident => $numbers:expr) => {
        impl $crate::settings::setting::SettingKind for $kind {
            fn allowed() -> String {
                $allowed.to_string()
            }

            fn reads(value: toml::Spanned<toml::de::DeValue<'_>>) -> bool {
                $crate::settings::setting::reads_as::<$kind>(value)
            }

            fn numbers(&self) -> Option<Vec<f64>> {
                let $value = self;
                $numbers
            }
        }
    };
}

pub(crate) use kind;

kind!(usize, "a whole number of at least 0", x => Some(vec![*x as f64]));
kind!(u64, "a whole number of at least 0", x => Some(vec![*x as f64]));
kind!(f64, "a number", x => Some(vec![*x]));
kind!(bool, "true or false", _x => None);
kind!([f64; 2], "two numbers", x => Some(x.to_vec()));
kind!(Vec<String>, "a list of texts", _x => None);
kind!(
    ActionInterface,
    "{ velocity = [...], acceleration = [...], target_velocity = [...], margin = A, lead = B } with one number per joint",
    x => Some([x.velocity.as_slice(), &x.acceleration, &x.target_velocity, &[x.margin, x.lead]].concat())
);
kind!(Vec<usize>, "a list of whole numbers", x => Some(x.iter().map(|x| *x as f64).collect()));

impl<K: SettingKind> SettingKind for Option<K> {
    fn allowed() -> String {
        K::allowed()
    }

    fn choices() -> &'static [Choice] {
        K::choices()
    }

    fn reads(value: Spanned<DeValue<'_>>) -> bool {
        K::reads(value)
    }

    fn numbers(&self) -> Option<Vec<f64>> {
        self.as_ref()?.numbers()
    }
}

impl SettingKind for Activation {
    fn allowed() -> String {
        one_of(["elu", "tanh", "relu", "leaky_relu"])
    }

    fn reads(value: Spanned<DeValue<'_>>) -> bool {
        matches!(value.get_ref(), DeValue::String(name) if name.parse().is_ok_and(Activation::is_trainable))
    }
}

/// Checks the constraint of a setting.
///
/// # Errors
/// If the value violates the constraint. The message names the setting and the allowed values.
pub(crate) fn check<K: SettingKind>(
    name: &'static str,
    value: &K,
    constraint: &Constraint,
) -> Result<(), TrainingError> {
    let Some(numbers) = value.numbers() else { return Ok(()) };
    let found = match numbers[..] {
        [x] => x.to_string(),
        _ => format!("{numbers:?}"),
    };
    require(name, constraint.allowed, found, (constraint.holds)(&numbers))
}

/// Checks a condition on the setting `name` that depends on other settings.
///
/// # Errors
/// If `condition` is false. The message says that the setting must be `expected`.
pub(crate) fn require(
    name: &'static str,
    expected: &str,
    found: impl std::fmt::Display,
    condition: bool,
) -> Result<(), TrainingError> {
    if condition {
        return Ok(());
    }
    Err(TrainingError::Setting {
        line: None,
        name: name.to_string(),
        expected: expected.to_string(),
        found: found.to_string(),
        known: Vec::new(),
    })
}
