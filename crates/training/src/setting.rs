//! What is known of a setting besides its value: what it means, and what it may be.

use mishandle_network::Activation;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::{DeValue, ValueDeserializer};

use crate::TrainingError;

/// What is known of a setting besides its value.
#[derive(Clone, Debug)]
pub struct Setting {
    /// Its table, if it is in one, and its key: `run.total_steps`.
    pub name: &'static str,
    /// What it means, as Markdown.
    pub meaning: &'static str,
    /// What it may be.
    pub wanted: String,
    /// The names that it may be, if it is a choice of some.
    pub choices: &'static [Choice],
    pub(crate) reads: fn(Spanned<DeValue<'_>>) -> bool,
}

/// A name that a setting may be.
#[derive(Clone, Copy, Debug)]
pub struct Choice {
    /// The name.
    pub name: &'static str,
    /// What it means, as Markdown.
    pub meaning: &'static str,
}

impl Setting {
    pub(crate) fn new<K: Kind>(name: &'static str, meaning: &'static str, rule: Option<&Rule>) -> Setting {
        let wanted = rule.map_or_else(K::wanted, |rule| rule.wanted.to_string());
        Setting { name, meaning, wanted, choices: K::choices(), reads: K::reads }
    }

    /// The table that it is in, empty for none, and its key in there.
    pub fn table_and_key(&self) -> (&'static str, &'static str) {
        self.name.rsplit_once('.').unwrap_or(("", self.name))
    }
}

/// What numbers of a setting have to be.
pub(crate) struct Rule {
    /// In words, with the kind of the setting: "a number above 0".
    pub wanted: &'static str,
    pub holds: fn(&[f64]) -> bool,
}

const fn each(wanted: &'static str, holds: fn(&[f64]) -> bool) -> Rule {
    Rule { wanted, holds }
}

/// More of anything would be a slip of the pen; and what is multiplied by it stays within 64 bits.
const MOST: f64 = 1e12;

pub(crate) const AT_LEAST_1: Rule =
    each("a whole number from 1 to 10^12", |x| x.iter().all(|x| (1.0..=MOST).contains(x)));
pub(crate) const AT_LEAST_2: Rule =
    each("a whole number from 2 to 10^12", |x| x.iter().all(|x| (2.0..=MOST).contains(x)));
pub(crate) const SHARE: Rule = each("a number from 0 to 1", |x| x.iter().all(|x| (0.0..=1.0).contains(x)));
pub(crate) const POSITIVE: Rule = each("a number above 0", |x| x.iter().all(|x| *x > 0.0 && x.is_finite()));
pub(crate) const NOT_NEGATIVE: Rule =
    each("a number of at least 0", |x| x.iter().all(|x| *x >= 0.0 && x.is_finite()));
pub(crate) const FINITE: Rule = each("a finite number", |x| x.iter().all(|x| x.is_finite()));
pub(crate) const SIZES: Rule = each("a list of whole numbers from 1 to 10^12, as [64, 64]", AT_LEAST_1.holds);
pub(crate) const WEIGHTS: Rule =
    each("\"orthogonal\", \"uniform\" or { normal = σ }, σ being a number above 0", POSITIVE.holds);
pub(crate) const RISING: Rule = each("two finite numbers, above 0 and not falling, as [0.1, 0.5]", |x| {
    x.is_sorted() && x.iter().all(|x| *x > 0.0 && x.is_finite())
});
pub(crate) const RISING_FROM_0: Rule =
    each("two finite numbers, at least 0 and not falling, as [0.1, 0.5]", |x| {
        x.is_sorted() && x.iter().all(|x| *x >= 0.0 && x.is_finite())
    });
pub(crate) const DECAY: Rule =
    each("{ steps = N, share = X }, N being a whole number from 1 to 10^12, X a number from 0 to 1", |x| {
        (1.0..=MOST).contains(&x[0]) && (0.0..=1.0).contains(&x[1])
    });

/// A kind of value that a setting has.
pub(crate) trait Kind {
    /// What it may be, if no rule says it.
    fn wanted() -> String;

    fn choices() -> &'static [Choice] {
        &[]
    }

    /// Whether a value can be read as one of this kind.
    fn reads(value: Spanned<DeValue<'_>>) -> bool;

    /// The numbers that a rule may be about, if there are any.
    fn numbers(&self) -> Option<Vec<f64>> {
        None
    }
}

pub(crate) fn reads_as<T: DeserializeOwned>(value: Spanned<DeValue<'_>>) -> bool {
    // A whole number may be too large for TOML and not for Rust.
    toml::Value::deserialize(ValueDeserializer::from(value.clone())).is_ok()
        && T::deserialize(ValueDeserializer::from(value)).is_ok()
}

/// `"a", "b" or "c"`
pub(crate) fn one_of<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    let mut names: Vec<String> = names.into_iter().map(|name| format!("\"{name}\"")).collect();
    let last = names.pop().unwrap_or_default();
    if names.is_empty() { last } else { format!("{} or {last}", names.join(", ")) }
}

/// A kind of one number, or of some, that serde reads.
macro_rules! kind {
    ($kind:ty, $wanted:literal, $value:ident => $numbers:expr) => {
        impl $crate::setting::Kind for $kind {
            fn wanted() -> String {
                $wanted.to_string()
            }

            fn reads(value: toml::Spanned<toml::de::DeValue<'_>>) -> bool {
                $crate::setting::reads_as::<$kind>(value)
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
kind!(Vec<usize>, "a list of whole numbers", x => Some(x.iter().map(|x| *x as f64).collect()));

impl<K: Kind> Kind for Option<K> {
    fn wanted() -> String {
        K::wanted()
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

impl Kind for Activation {
    fn wanted() -> String {
        one_of(["elu", "tanh", "relu"])
    }

    fn reads(value: Spanned<DeValue<'_>>) -> bool {
        matches!(value.get_ref(), DeValue::String(name) if name.parse::<Activation>().is_ok())
    }
}

/// Checks that a setting keeps its rule.
///
/// # Errors
/// If it does not; the message says what it must be.
pub(crate) fn check<K: Kind>(name: &'static str, value: &K, rule: &Rule) -> Result<(), TrainingError> {
    let Some(numbers) = value.numbers() else { return Ok(()) };
    let found = match numbers[..] {
        [x] => x.to_string(),
        _ => format!("{numbers:?}"),
    };
    ask(name, rule.wanted, found, (rule.holds)(&numbers))
}

/// Checks what hangs on more than one setting.
///
/// # Errors
/// If it is not right; the message says what the one that is named must be.
pub(crate) fn ask(
    name: &'static str,
    wanted: &str,
    found: impl std::fmt::Display,
    right: bool,
) -> Result<(), TrainingError> {
    if right {
        return Ok(());
    }
    Err(TrainingError::Setting {
        line: None,
        name: name.to_string(),
        wanted: wanted.to_string(),
        found: found.to_string(),
        known: Vec::new(),
    })
}
