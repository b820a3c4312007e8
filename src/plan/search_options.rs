//! Options of a search in plans and flags.

use mishandle_search::{OptionType, OptionValue, SearchOptions, find_search};
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serializer};

/// Serializes options as a table, for `#[serde(with)]`.
pub(crate) fn serialize<S: Serializer>(options: &SearchOptions, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(options.iter())
}

/// Deserializes a table of options, for `#[serde(with)]`.
pub(crate) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<SearchOptions, D::Error> {
    let table = std::collections::BTreeMap::<String, OptionValue>::deserialize(deserializer)?;
    let mut options = SearchOptions::new();
    for (name, value) in table {
        // `max_iterations` and `max-iterations` are the same option.
        if options.get(&name).is_some() {
            return Err(D::Error::custom(format!("option `{name}` is set twice")));
        }
        options.set(&name, value);
    }
    Ok(options)
}

/// Parses the value of a search option from a flag, such as `1e-6`, `true` or
/// `[[0.1, 0.2], [0.3, 0.4]]`.
///
/// Values have TOML syntax, as in a plan, but strings need no quotes.
/// [`ResolvedPlan::new`](crate::resolve::ResolvedPlan::new) checks whether `search` has the option
/// and accepts the value.
///
/// # Example
/// ```
/// use mishandle::search::OptionValue;
/// use mishandle::plan::search_option_value;
/// assert_eq!(search_option_value("nelder-mead", "xatol", "1e-6"), OptionValue::Float(1e-6));
/// assert_eq!(search_option_value("nelder-mead", "start", "[0.5, 1]"), OptionValue::Point(vec![0.5, 1.0]));
/// assert_eq!(search_option_value("nelder-mead", "adaptive", "maybe"), OptionValue::Text("maybe".into()));
/// ```
pub fn search_option_value(search: &str, name: &str, text: &str) -> OptionValue {
    /// A TOML document with a single value.
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Document {
        value: OptionValue,
    }
    let specs = find_search(search).map(|entry| (entry.options)()).unwrap_or_default();
    let is_text =
        specs.iter().any(|spec| spec.name == name.replace('_', "-") && spec.kind == OptionType::Text);
    let read = if is_text { None } else { toml::from_str::<Document>(&format!("value = {text}")).ok() };
    read.map_or_else(|| OptionValue::Text(text.to_string()), |document| document.value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flag_has_the_syntax_of_a_plan_and_exactly_one_value() {
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
