//! Edits of plans: one key gets one value, from the words of a command line or from a program.

use std::collections::BTreeMap;

use mishandle_rollout::Interval;
use mishandle_search::OptionValue;
use serde::Deserialize;
use toml::de::{DeTable, DeValue, ValueDeserializer};
use toml::{Spanned, Table, Value};

use super::keys::{
    AXES, DISTRIBUTIONS, Key, OPTIONS, RELATIONS, REQUIREMENTS, RESOLUTION, TOPICS, find, keys,
};
use super::read::{CHANGE, HOLDS, may_be_list};
use super::search_options::search_option_value;
use super::{AxisSetting, FalsifyPlan, Plan};
use crate::error::MishandleError;

/// Tables whose keys are chosen by the user: their entries are the keys to set.
const MAPS: [&str; 7] = [RELATIONS, DISTRIBUTIONS, OPTIONS, REQUIREMENTS, AXES, TOPICS, RESOLUTION];

/// Whether a list of values makes a grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Values {
    /// A key has one value.
    One,
    /// A list is a list of values, except for keys that are lists.
    Lists,
}

/// Sets a key of the table of a plan by a text: a key of text takes it as it stands, any other key
/// takes TOML, and an integer also `1e6`.
///
/// A search option has the type that the search in the table gives it.
///
/// # Errors
/// If there is no such key, or the text is not a value of it.
///
/// # Example
/// ```
/// use mishandle::plan::{Values, set};
/// let mut plan = toml::Table::new();
/// set(&mut plan, "falsify.budget", "1e3", Values::One)?;
/// set(&mut plan, "falsify.formula", "always(x <= 1)", Values::One)?;
/// set(&mut plan, "axes.ball_x", "0.2:0.3", Values::One)?;
/// assert_eq!(plan["falsify"]["budget"].as_integer(), Some(1000));
/// assert!(set(&mut plan, "falsify.budget", "many", Values::One).is_err());
/// assert!(set(&mut plan, "falsify.bugdet", "1", Values::One).is_err());
/// # Ok::<(), mishandle::MishandleError>(())
/// ```
pub fn set(table: &mut Table, key: &str, text: &str, values: Values) -> Result<(), MishandleError> {
    let place = place(key)?;
    let value = match place.entry() {
        Some((AXES, _)) => axis_value(text),
        Some((OPTIONS, name)) => {
            let falsify = table.get("falsify").and_then(|falsify| falsify.get("search"));
            let default = FalsifyPlan::default().search;
            let search = falsify.and_then(Value::as_str).unwrap_or(&default);
            Value::try_from(search_option_value(search, name, text)).ok()
        }
        Some((RESOLUTION, _)) => text.trim().parse().ok().map(Value::Float),
        Some(_) => Some(Value::String(text.to_string())),
        None => value_of(place.key, text, values),
    };
    let value = value.ok_or_else(|| place.wrong(text))?;
    place.write(table, value)
}

/// As [`set`], by a value that has a type already. In the name of the key, `_` is as good as `-`.
///
/// # Errors
/// As [`set`].
pub fn set_value(table: &mut Table, key: &str, value: Value) -> Result<(), MishandleError> {
    let key = match MAPS.iter().find(|map| key.starts_with(&format!("{map}."))) {
        Some(_) => key.to_string(),
        None => key.replace('_', "-"),
    };
    let place = place(&key)?;
    let text = value.to_string();
    let is_right = match place.entry() {
        None => reads(place.key, &text),
        Some((AXES, _)) => AxisSetting::deserialize(value.clone()).is_ok(),
        Some((OPTIONS, _)) => OptionValue::deserialize(value.clone()).is_ok(),
        Some((RESOLUTION, _)) => f64::deserialize(value.clone()).is_ok(),
        Some(_) => value.is_str(),
    };
    if is_right { place.write(table, value) } else { Err(place.wrong(&text)) }
}

/// As [`set_value`] for each key of nested tables, such as `{falsify: {early_stopping: true}}`.
/// Returns the names of the keys.
///
/// # Errors
/// As [`set_value`].
///
/// # Example
/// ```
/// use mishandle::plan::set_tables;
/// let mut plan = toml::Table::new();
/// let given = toml::toml! { seed = 3
/// falsify = { early_stopping = true } };
/// assert_eq!(set_tables(&mut plan, given)?, ["falsify.early-stopping", "seed"]);
/// assert!(set_tables(&mut plan, toml::toml! { falsify = 3 }).is_err());
/// # Ok::<(), mishandle::MishandleError>(())
/// ```
pub fn set_tables(table: &mut Table, given: Table) -> Result<Vec<String>, MishandleError> {
    let mut stated = Vec::new();
    set_within(table, "", given, &mut stated)?;
    Ok(stated)
}

fn set_within(
    table: &mut Table,
    within: &str,
    given: Table,
    stated: &mut Vec<String>,
) -> Result<(), MishandleError> {
    for (name, value) in given {
        let is_entry = MAPS.iter().any(|map| within == format!("{map}."));
        let key = format!("{within}{}", if is_entry { name } else { name.replace('_', "-") });
        let as_table = format!("{key}.");
        let is_table =
            MAPS.contains(&key.as_str()) || keys().iter().any(|known| known.name.starts_with(&as_table));
        match value {
            Value::Table(inner) if is_table || as_table.starts_with(&format!("{RELATIONS}.")) => {
                set_within(table, &as_table, inner, stated)?;
            }
            value if is_table => {
                let found = super::read::shortened(&value.to_string());
                return Err(MishandleError::KeyValue {
                    line: None,
                    key,
                    found,
                    expected: "a table of keys".to_string(),
                });
            }
            value => {
                set_value(table, &key, value)?;
                stated.push(key);
            }
        }
    }
    Ok(())
}

/// A key, and where it stands in the table of a plan.
struct Place<'a> {
    name: &'a str,
    key: &'static Key,
    /// Tables and key.
    path: Vec<&'a str>,
}

impl<'a> Place<'a> {
    /// Returns the table whose keys the user chooses and the key in it, if it stands in one.
    fn entry(&self) -> Option<(&'static str, &'a str)> {
        let table: &'static str = self.key.name.as_str();
        let entry = self.name.strip_prefix(table)?.strip_prefix('.')?;
        Some((table, entry))
    }

    fn wrong(&self, found: &str) -> MishandleError {
        let expected = match self.entry() {
            Some((AXES, _)) => "a number, a range such as 0.2:0.3, an interval such as [0, 1), or a category",
            Some((OPTIONS, _)) => super::read::OPTION,
            Some((RESOLUTION, _)) => "a number, such as 0.1",
            Some((RELATIONS, entry)) if entry.ends_with(".holds") => HOLDS,
            Some((RELATIONS, _)) => CHANGE,
            _ => self.key.allowed,
        };
        let found = super::read::shortened(found);
        let key = self.name.to_string();
        MishandleError::KeyValue { line: None, key, found, expected: expected.to_string() }
    }

    fn write(&self, table: &mut Table, value: Value) -> Result<(), MishandleError> {
        let (last, tables) = self.path.split_last().unwrap_or((&"", &[]));
        let mut within = table;
        for name in tables {
            let entry = within.entry(*name).or_insert_with(|| Value::Table(Table::new()));
            within = entry.as_table_mut().ok_or_else(|| self.wrong("below a key that is no table"))?;
        }
        if self.key.name == OPTIONS {
            // `max_iterations` and `max-iterations` are the same option.
            within.retain(|name, _| name.replace('_', "-") != last.replace('_', "-"));
        }
        within.insert((*last).to_string(), value);
        Ok(())
    }
}

/// Finds a key.
fn place(name: &str) -> Result<Place<'_>, MishandleError> {
    let unknown = || {
        let known = keys().iter().map(|key| key.name.as_str()).collect();
        MishandleError::UnknownKey { line: None, key: name.to_string(), known }
    };
    let entry = MAPS.iter().find_map(|map| Some((*map, name.strip_prefix(map)?.strip_prefix('.')?)));
    let Some((map, entry)) = entry.filter(|(_, entry)| !entry.is_empty()) else {
        let key = find(name).filter(|key| !MAPS.contains(&key.name.as_str())).ok_or_else(unknown)?;
        return Ok(Place { name, key, path: name.splitn(2, '.').collect() });
    };
    let key = find(map).ok_or_else(unknown)?;
    let mut path: Vec<&str> = map.split('.').collect();
    if map == RELATIONS {
        // The name of a relation, and what it says.
        let change = entry.split_once(".change.").map(|(relation, axis)| vec![relation, "change", axis]);
        let holds = || entry.strip_suffix(".holds").map(|relation| vec![relation, "holds"]);
        path.extend(change.or_else(holds).ok_or_else(unknown)?);
    } else {
        path.push(entry);
    }
    Ok(Place { name, key, path })
}

/// Returns the value of a text for a key.
fn value_of(key: &Key, text: &str, values: Values) -> Option<Value> {
    if values == Values::Lists
        && may_be_list(&key.name)
        && text.starts_with('[')
        && let Some(Value::Array(items)) = parsed(text)
        && items.iter().all(|item| reads(key, &item.to_string()))
    {
        return Some(Value::Array(items));
    }
    if (key.reads)(&Spanned::new(0..0, DeValue::String(text.into()))) {
        return Some(Value::String(text.to_string()));
    }
    let value = if reads(key, text) { parsed(text) } else { None };
    value.or_else(|| {
        let number = mishandle_text::parse_integer(text).ok()?;
        reads(key, &number.to_string()).then(|| i64::try_from(number).ok().map(Value::Integer))?
    })
}

/// Returns whether a text in TOML is a value of a key.
fn reads(key: &Key, text: &str) -> bool {
    let document = format!("value = {text}");
    let stated = DeTable::parse(&document);
    stated.is_ok_and(|table| {
        let table = table.get_ref();
        table.len() == 1 && table.get("value").is_some_and(|value| (key.reads)(value))
    })
}

/// Parses a value in TOML.
fn parsed(text: &str) -> Option<Value> {
    let document = format!("value = {text}");
    let table = DeTable::parse(&document).ok()?;
    let value = table.get_ref().get("value").filter(|_| table.get_ref().len() == 1)?.clone();
    Value::deserialize(ValueDeserializer::from(value)).ok()
}

/// Parses the value of an axis: `LOW:HIGH`, an interval, a number, or the name of a category.
///
/// # Example
/// ```
/// use mishandle::plan::{AxisSetting, axis_setting};
/// assert_eq!(axis_setting("0.2:0.3"), Some(AxisSetting::Range([0.2, 0.3])));
/// assert_eq!(axis_setting("2"), Some(AxisSetting::Value(2.0)));
/// assert_eq!(axis_setting("steel"), Some(AxisSetting::Text("steel".into())));
/// assert_eq!(axis_setting(""), None);
/// ```
pub fn axis_setting(text: &str) -> Option<AxisSetting> {
    let text = text.trim();
    if text.is_empty() {
        return None;
    }
    if text.parse::<Interval>().is_ok() {
        return Some(AxisSetting::Text(text.to_string()));
    }
    if let Some((low, high)) = text.split_once(':')
        && let (Ok(low), Ok(high)) = (low.trim().parse(), high.trim().parse())
    {
        return Some(AxisSetting::Range([low, high]));
    }
    // `nan` is the name of a category of lost samples, and no axis has it as a number.
    let number = text.parse::<f64>().ok().filter(|number| number.is_finite());
    Some(number.map_or_else(|| AxisSetting::Text(text.to_string()), AxisSetting::Value))
}

fn axis_value(text: &str) -> Option<Value> {
    Value::try_from(axis_setting(text)?).ok()
}

/// Returns the keys and texts with which [`set`] makes `plan` of another plan that has no key that
/// `plan` lacks.
pub fn assignments(plan: &Plan, from: &Plan) -> Vec<(String, String)> {
    let [plan, from] = [plan, from].map(|plan| Table::try_from(plan).unwrap_or_default());
    let mut found = Vec::new();
    add_assignments("", &plan, &from, &mut found);
    found
}

fn add_assignments(within: &str, table: &Table, from: &Table, found: &mut Vec<(String, String)>) {
    for (key, value) in table {
        let known = from.get(key);
        let name = format!("{within}{key}");
        let text = match value {
            value if known == Some(value) => continue,
            Value::Table(inner) => {
                let none = Table::new();
                let known = known.and_then(Value::as_table).unwrap_or(&none);
                add_assignments(&format!("{name}."), inner, known, found);
                continue;
            }
            Value::String(text) => text.clone(),
            Value::Array(ends) if within == format!("{AXES}.") => {
                ends.iter().map(ToString::to_string).collect::<Vec<_>>().join(":")
            }
            value => value.to_string(),
        };
        found.push((name, text));
    }
}

/// Returns the values of a plan by key, as text. A key of a table has the name of the table before
/// a dot.
pub(crate) fn key_values(table: &Table) -> BTreeMap<String, String> {
    let mut found = BTreeMap::new();
    for (key, value) in table {
        match value {
            Value::Table(table) => {
                let inner = key_values(table).into_iter();
                found.extend(inner.map(|(name, value)| (format!("{key}.{name}"), value)));
            }
            value => {
                found.insert(key.clone(), value.to_string());
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn assignments_make_the_plan_again() {
        let plan = "target = 'pole.toml'\nspace = 'starts+delay'\naction-noise = 0.5\nseed = 18446744073709551615\n\
                    careful = true\n[axes]\nx = [0.2, 0.3]\ny = '[0, 1)'\nz = 'steel'\nd = 2\n\
                    [requirements]\nnear = 'always(d <= 0.1)'\n[guard]\nformula = 'always(d <= 1)'\nthreshold = 0.25\n\
                    [evaluate]\nepisodes = 7\nbox = 'reachable'\nuntil = 'decided'\nrate = 0.9\ncorners = false\n";
        let plan = Plan::from_toml(plan).unwrap();
        let base = Plan::new("", "");
        let mut table = Table::new();
        for (key, text) in assignments(&plan, &base) {
            set(&mut table, &key, &text, Values::One).unwrap();
        }
        assert_eq!(Plan::from_toml(&table.to_string()).unwrap(), plan);
    }
}
