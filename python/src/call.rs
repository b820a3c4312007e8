//! The document of a call in Python: its arguments and its `plan`.

use std::collections::BTreeSet;

use mishandle::plan::{GuardPlan, HardenPlan, ScreeningPlan, Settings, set_tables};
use mishandle::{MishandleError as Error, Plan};
use mishandle_cli::words::{argument, in_plan};
use pyo3::prelude::*;
use serde::Deserialize;
use serde_json::{Map, Value as Json};
use toml::{Table, Value};

use crate::{InvalidValueError, raised};

/// Returns whether a question, or a function that asks none, reads a key. Files and topics of logs
/// are arguments, and only the command line follows a log or starts several runs.
fn is_read(question: &str, key: &str) -> bool {
    const OF_FILES: [&str; 7] = [
        "log.time",
        "log.time-unit",
        "log.utc-offset",
        "log.topic-column",
        "log.format",
        "log.delimiter",
        "log.decimal",
    ];
    let table = key.split_once('.').map_or("", |(table, _)| table);
    let is_log = table == "log" && !key.starts_with("log.topics");
    let is_of_formula = is_log && key != "log.strict-horizon";
    let is_moved = ["engine.controller", "engine.target"].contains(&key);
    match question {
        "read_log" => OF_FILES.contains(&key),
        "robustness" => is_of_formula && key != "log.unit",
        "monitor" => is_log || key == "monitor.values",
        "formula" => is_of_formula || key == "formula.episode",
        "mine" => {
            let keys = ["formula.resolution", "formula.share", "formula.points"];
            is_of_formula || keys.iter().any(|known| key.starts_with(known))
        }
        "explain" => is_moved || key == "report.axes",
        "report" => {
            let keys = ["simulations", "probes", "sensitivity", "replay"];
            key.strip_prefix("report.").is_some_and(|key| keys.contains(&key))
        }
        "export" => ["regress.minimize", "regress.budget"].contains(&key),
        "evidence" | "to_rerun" => is_moved,
        "verify_evidence" => key == "evidence.replay",
        "regress" => mishandle_cli::reads_key("simulate", key) || key == "regress.max-failure-rate",
        "bisect" => match table {
            "regress" => ["regress.every", "regress.rate"].contains(&key),
            table => table != "engine" && mishandle_cli::reads_key("regress", key),
        },
        question => {
            let is_of_run = ["engine.durable", "engine.any-build"].contains(&key);
            mishandle_cli::reads_key(question, key) && (table != "engine" || is_of_run)
        }
    }
}

/// A call: nested tables of the keys of plans.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    /// The question, whose table the plan gets, or the function.
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
    pub stated: BTreeSet<String>,
}

/// The keys of a call, and the settings among them.
pub(crate) struct Keys {
    question: String,
    /// Keys of a plan.
    table: Table,
    pub settings: Settings,
    /// Keys that an argument or `plan` states.
    pub stated: BTreeSet<String>,
    guard: Option<String>,
}

impl Keys {
    /// Reads a document.
    pub(crate) fn read(text: &str) -> PyResult<Keys> {
        let Document { question, defaults, plan, arguments, guard } =
            serde_json::from_str(text).map_err(crate::plain)?;
        let mut table = Table::new();
        set_tables(&mut table, toml_table(defaults)).map_err(raised)?;
        let planned = set_tables(&mut table, toml_table(plan));
        let mut stated = BTreeSet::new();
        for key in planned.map_err(|error| wrong(error, in_plan))? {
            if let Some(key) = stated.replace(key) {
                return Err(InvalidValueError::new_err(format!(
                    "{} is set twice; set it once",
                    in_plan(&key)
                )));
            }
        }
        if let Some(key) = stated.iter().find(|key| !is_read(&question, key)) {
            let message = format!("{} has no effect on this question; leave it out", in_plan(key));
            return Err(InvalidValueError::new_err(message));
        }
        let given = set_tables(&mut table, toml_table(arguments));
        for key in given.map_err(|error| wrong(error, argument))? {
            if !stated.insert(key.clone()) {
                let twice =
                    format!("{} is set twice, as an argument and in `plan`; set it once", argument(&key));
                return Err(InvalidValueError::new_err(twice));
            }
        }
        let settings = Settings::take(&mut table).map_err(|error| wrong(error, in_plan))?;
        Ok(Keys { question, table, settings, stated, guard })
    }
}

/// Returns the settings of a call.
pub(crate) fn settings(text: &str) -> PyResult<Settings> {
    Ok(Keys::read(text)?.settings)
}

impl Call {
    /// Reads a document.
    pub(crate) fn read(text: &str) -> PyResult<Call> {
        let Keys { question, mut table, settings, stated, guard } = Keys::read(text)?;
        let has_batch = stated.contains("falsify.batch");
        let tables: &[&str] = match &*question {
            "simulate" | "regress" => &["falsify"],
            "compare" => &["evaluate", "compare"],
            "record" | "check" | "bisect" => &[],
            question => &[question],
        };
        for name in tables {
            table.entry(*name).or_insert_with(|| Value::Table(Table::new()));
        }
        let mut plan = Plan::from_toml(&table.to_string()).map_err(raised)?;
        if let Some(guard) = guard {
            plan.guard = Some(GuardPlan::from_toml(&guard).map_err(raised)?);
        }
        let measured = settings.engine.screening.map(|_| ScreeningPlan::default());
        let screening = plan.screening.as_ref().or(measured.as_ref());
        if let (Some(falsify), Some(screening), false) = (&mut plan.falsify, screening, has_batch) {
            falsify.batch = screening.batch();
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

    /// Checks that the call states no key outside of tables but these and [`EVERYWHERE`].
    pub(crate) fn check_keys(&self, known: &[&str]) -> PyResult<()> {
        let other = self.stated.iter().find(|key| {
            !key.contains('.') && !EVERYWHERE.contains(&key.as_str()) && !known.contains(&key.as_str())
        });
        match other {
            None => Ok(()),
            Some(key) => {
                let message = format!("{} has no effect on this system; leave it out", in_plan(key));
                Err(InvalidValueError::new_err(message))
            }
        }
    }
}

/// Keys outside of tables that mean something for every system.
const EVERYWHERE: [&str; 2] = ["seed", "max-without-verdict"];

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

/// Converts an error about a key to an exception with the name of the key in Python.
fn wrong(error: Error, name: impl Fn(&str) -> String) -> PyErr {
    match error {
        Error::KeyValue { key, found, expected, .. } => {
            InvalidValueError::new_err(format!("{} is {found}; it must be {expected}", name(&key)))
        }
        Error::UnknownKey { .. } => InvalidValueError::new_err(error.to_string().replace('-', "_")),
        error => raised(error),
    }
}
