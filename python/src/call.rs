//! The document of a call in Python: its arguments and its `plan`.

use std::collections::BTreeSet;

use mishandle::plan::{GuardPlan, HardenPlan, Settings, set_tables};
use mishandle::{MishandleError as Error, Plan};
use pyo3::prelude::*;
use serde::Deserialize;
use serde_json::{Map, Value as Json};
use toml::{Table, Value};

use crate::{InvalidValueError, raised, words};

/// Tables whose keys are names that the user chose.
const NAMED: [&str; 4] = ["axes", "requirements", "falsify.options", "risk.distributions"];

/// Settings of the engine that functions in Python read.
const ENGINE: [&str; 2] = ["engine.durable", "engine.any-build"];

/// A call: nested tables of the keys of plans.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    /// Question whose table the plan gets.
    question: String,
    /// Values of keys that nothing else sets.
    #[serde(default)]
    defaults: Map<String, Json>,
    /// The argument `plan`.
    #[serde(default)]
    plan: Map<String, Json>,
    /// The other arguments.
    #[serde(default)]
    arguments: Map<String, Json>,
    /// The keys of a guard as TOML.
    guard: Option<String>,
}

/// The plan and the settings of a call.
pub(crate) struct Call {
    pub plan: Plan,
    pub settings: Settings,
    /// Keys that an argument or `plan` states.
    stated: BTreeSet<String>,
}

impl Call {
    /// Reads a document.
    pub(crate) fn read(text: &str) -> PyResult<Call> {
        let document: Document = serde_json::from_str(text).map_err(crate::plain)?;
        let mut table = Table::new();
        set_tables(&mut table, toml_table(document.defaults)).map_err(raised)?;
        let planned = set_tables(&mut table, toml_table(document.plan));
        let mut stated: BTreeSet<String> =
            planned.map_err(|error| wrong(error, in_plan))?.into_iter().collect();
        let question = &*document.question;
        let is_read = |key: &str| {
            mishandle_cli::reads_key(question, key) && (!key.starts_with("engine.") || ENGINE.contains(&key))
        };
        if let Some(key) = stated.iter().find(|key| !is_read(key)) {
            let message = format!("{} has no effect on this question; leave it out", in_plan(key));
            return Err(InvalidValueError::new_err(message));
        }
        let given = set_tables(&mut table, toml_table(document.arguments));
        for key in given.map_err(|error| wrong(error, argument))? {
            if !stated.insert(key.clone()) {
                let twice =
                    format!("{} is set twice, as an argument and in `plan`; set it once", argument(&key));
                return Err(InvalidValueError::new_err(twice));
            }
        }
        let has_batch = stated.contains("falsify.batch");
        let settings = Settings::take(&mut table).map_err(|error| wrong(error, in_plan))?;
        let tables: &[&str] = match question {
            "simulate" => &["falsify"],
            "compare" => &["evaluate", "compare"],
            "record" | "check" => &[],
            question => &[question],
        };
        for name in tables {
            table.entry(*name).or_insert_with(|| Value::Table(Table::new()));
        }
        let mut plan = Plan::from_toml(&table.to_string()).map_err(raised)?;
        if let Some(guard) = document.guard {
            plan.guard = Some(GuardPlan::from_toml(&guard).map_err(raised)?);
        }
        if let (Some(falsify), Some(screening), false) = (&mut plan.falsify, &plan.screening, has_batch) {
            falsify.batch = screening.rows.min(*Plan::BATCH.end() as u32);
        }
        if let Some(falsify) = &mut plan.falsify {
            falsify.isolate_by_default();
        }
        if let Some(HardenPlan { is_trainer_typed, .. }) = &mut plan.harden {
            *is_trainer_typed = true;
        }
        // A function may start the program that its argument names.
        plan.is_typed = stated.contains("folder");
        Ok(Call { plan, settings, stated })
    }

    /// Checks that the call states no key outside of tables but these and the seed.
    pub(crate) fn check_keys(&self, known: &[&str]) -> PyResult<()> {
        let other = self
            .stated
            .iter()
            .find(|key| !key.contains('.') && *key != "seed" && !known.contains(&key.as_str()));
        match other {
            None => Ok(()),
            Some(key) => {
                let message = format!("{} has no effect on this system; leave it out", in_plan(key));
                Err(InvalidValueError::new_err(message))
            }
        }
    }
}

/// Returns a table of TOML. `null` is a key that is left out.
fn toml_table(given: Map<String, Json>) -> Table {
    given.into_iter().filter_map(|(key, value)| Some((key, toml_value(value)?))).collect()
}

fn toml_value(given: Json) -> Option<Value> {
    Some(match given {
        Json::Null => return None,
        Json::Bool(value) => Value::Boolean(value),
        Json::String(text) => Value::String(text),
        Json::Number(number) => match (number.as_i64(), number.as_u64()) {
            (Some(integer), _) => Value::Integer(integer),
            // Integers of TOML end at 2⁶³ - 1. Seeds above are texts.
            (None, Some(integer)) => Value::String(integer.to_string()),
            (None, None) => Value::Float(number.as_f64().unwrap_or(f64::NAN)),
        },
        Json::Array(items) => Value::Array(items.into_iter().filter_map(toml_value).collect()),
        Json::Object(table) => Value::Table(toml_table(table)),
    })
}

/// Returns the parts of a key in Python.
fn parts(key: &str) -> Vec<String> {
    let named = NAMED.iter().find_map(|table| Some((*table, key.strip_prefix(table)?.strip_prefix('.')?)));
    let (table, name) = named.map_or((key, None), |(table, name)| (table, Some(name.to_string())));
    table.split('.').map(|part| part.replace('-', "_")).chain(name).collect()
}

/// Returns a key as it stands in the argument `plan`, such as `plan["falsify"]["batch"]`.
fn in_plan(key: &str) -> String {
    let parts: String = parts(key).iter().map(|part| format!("[{}]", words::quoted(part))).collect();
    format!("plan{parts}")
}

/// Returns the name of the argument that sets a key.
fn argument(key: &str) -> String {
    match &parts(key)[..] {
        [table, name] if NAMED.contains(&table.as_str()) => format!("{table}[{}]", words::quoted(name)),
        parts => parts.last().cloned().unwrap_or_default(),
    }
}

/// Converts an error about a key to an exception with the name of the key in Python.
fn wrong(error: Error, name: impl Fn(&str) -> String) -> PyErr {
    match error {
        Error::KeyValue { key, found, expected } => {
            InvalidValueError::new_err(format!("{} is {found}; it must be {expected}", name(&key)))
        }
        Error::UnknownKey { .. } => InvalidValueError::new_err(error.to_string().replace('-', "_")),
        error => raised(error),
    }
}
