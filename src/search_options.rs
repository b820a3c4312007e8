//! Options of a search in plans and flags: TOML values by name.

use mishandle_search::{OptionType, OptionValue, SearchOptions, find_search};
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// An [`OptionValue`] as TOML spells it.
#[derive(Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = "expected a number, true or false, a text, a list of numbers, or a list of lists of numbers"
)]
enum Spelled {
    Boolean(bool),
    Integer(i64),
    Float(f64),
    Text(String),
    Point(Vec<f64>),
    Points(Vec<Vec<f64>>),
}

impl From<Spelled> for OptionValue {
    fn from(value: Spelled) -> OptionValue {
        match value {
            Spelled::Boolean(value) => OptionValue::Boolean(value),
            Spelled::Integer(value) => OptionValue::Integer(value),
            Spelled::Float(value) => OptionValue::Float(value),
            Spelled::Text(value) => OptionValue::Text(value),
            Spelled::Point(value) => OptionValue::Point(value),
            Spelled::Points(value) => OptionValue::Points(value),
        }
    }
}

impl From<OptionValue> for Spelled {
    fn from(value: OptionValue) -> Spelled {
        match value {
            OptionValue::Boolean(value) => Spelled::Boolean(value),
            OptionValue::Integer(value) => Spelled::Integer(value),
            OptionValue::Float(value) => Spelled::Float(value),
            OptionValue::Text(value) => Spelled::Text(value),
            OptionValue::Point(value) => Spelled::Point(value),
            OptionValue::Points(value) => Spelled::Points(value),
        }
    }
}

/// For `#[serde(with)]`: a table of options.
pub(crate) fn serialize<S: Serializer>(options: &SearchOptions, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(options.iter().map(|(name, value)| (name, Spelled::from(value.clone()))))
}

/// For `#[serde(with)]`: a table of options.
pub(crate) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<SearchOptions, D::Error> {
    let table = std::collections::BTreeMap::<String, Spelled>::deserialize(deserializer)?;
    let mut options = SearchOptions::new();
    for (name, value) in table {
        // `max_iterations` and `max-iterations` are the same option.
        if options.get(&name).is_some() {
            return Err(D::Error::custom(format!("option `{name}` is set twice")));
        }
        options.set(&name, OptionValue::from(value));
    }
    Ok(options)
}

/// Reads the value of an option from a flag: `1e-6`, `true`, `[[0.1, 0.2], [0.3, 0.4]]`.
///
/// A value is written as in a plan (TOML), but a text needs no quotes. Whether `search` has the option and accepts the
/// value is checked when the plan becomes a search.
///
/// # Example
/// ```
/// use mishandle::search::OptionValue;
/// use mishandle::search_option_value;
/// assert_eq!(search_option_value("nelder-mead", "xatol", "1e-6"), OptionValue::Float(1e-6));
/// assert_eq!(search_option_value("nelder-mead", "start", "[0.5, 1]"), OptionValue::Point(vec![0.5, 1.0]));
/// assert_eq!(search_option_value("nelder-mead", "adaptive", "maybe"), OptionValue::Text("maybe".into()));
/// ```
pub fn search_option_value(search: &str, name: &str, text: &str) -> OptionValue {
    /// A document of one value.
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Document {
        value: Spelled,
    }
    let specs = find_search(search).map(|entry| (entry.options)()).unwrap_or_default();
    let is_text =
        specs.iter().any(|spec| spec.name == name.replace('_', "-") && spec.kind == OptionType::Text);
    let read = if is_text { None } else { toml::from_str::<Document>(&format!("value = {text}")).ok() };
    read.map_or_else(|| OptionValue::Text(text.to_string()), |document| document.value.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flag_is_read_as_in_a_plan_and_is_never_two_values() {
        let value = |text: &str| search_option_value("dual-annealing", "visit", text);
        assert_eq!(value("2"), OptionValue::Integer(2));
        assert_eq!(value("true"), OptionValue::Boolean(true));
        assert_eq!(value("\"a b\""), OptionValue::Text("a b".into()));
        assert_eq!(value("[[0, 1], [0.5, 1]]"), OptionValue::Points(vec![vec![0.0, 1.0], vec![0.5, 1.0]]));
        for text in ["", "2\nother = 3", "1979-05-27", "{ a = 1 }", "[1, \"a\"]"] {
            assert_eq!(value(text), OptionValue::Text(text.into()), "{text}");
        }
    }
}
