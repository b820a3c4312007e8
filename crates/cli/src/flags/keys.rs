//! Keys of plans on the command line: `-k KEY=VALUE`, and the plan that they, `--plan` and the
//! flags describe together.

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use clap::builder::{PossibleValue, TypedValueParser};
use mishandle::files::{limits, read_text_bounded};
use mishandle::plan::{Key, Settings, Values, keys, set, set_value};
use mishandle::{MishandleError, Plan};
use toml::{Table, Value};

/// Keys of a plan that stand outside of its tables.
const TOP: &str = "";

const MAX_SHARE: &str = "max-without-verdict";

/// Tables and single keys of plans that a command reads.
const TABLES: [(&str, &[&str]); 24] = [
    ("evaluate", &[TOP, "axes", "requirements", "guard", "evaluate", "screening", "size", "engine"]),
    (
        "falsify",
        &[
            TOP,
            "axes",
            "requirements",
            "guard",
            "falsify",
            "screening",
            "report.repeats",
            "report.smooth-region",
            "engine",
        ],
    ),
    ("margin", &[TOP, "axes", "requirements", "guard", "margin", "engine"]),
    ("metamorphic", &[TOP, "axes", "requirements", "guard", "metamorphic", "engine"]),
    ("risk", &[TOP, "axes", "requirements", "guard", "risk", "screening", "engine"]),
    ("check", &[TOP, "axes", "guard", "check"]),
    (
        "compare",
        &[TOP, "axes", "requirements", "guard", "evaluate", "compare", "size", "report.replay", "engine"],
    ),
    ("simulate", &[TOP, "axes", "requirements", "guard", "falsify.formula", "simulate", "trace"]),
    ("harden", &[TOP, "axes", "guard", "harden"]),
    ("guard", &[TOP, "axes", "requirements", "guard", "evaluate", "tune"]),
    ("record", &[TOP, "axes", "requirements", "guard", "evaluate", "record"]),
    ("train", &["target", "space", "seed", "axes", "guard", "train"]),
    ("controller", &["import"]),
    (
        "run",
        &[
            TOP,
            "axes",
            "requirements",
            "guard",
            "evaluate",
            "compare",
            "falsify",
            "margin",
            "metamorphic",
            "risk",
            "harden",
            "screening",
            "report.repeats",
            "report.smooth-region",
            "engine",
        ],
    ),
    ("show", &["report.axes", "engine"]),
    ("replay", &["trace", "engine"]),
    ("render", &["render", "engine"]),
    (
        "report",
        &[
            "report.simulations",
            "report.probes",
            "report.sensitivity",
            "report.repeats",
            "report.replay",
            "log",
            "engine",
        ],
    ),
    ("monitor", &["log", "monitor"]),
    ("formula", &["log", "formula"]),
    ("regress", &[TOP, "axes", "requirements", "guard", "evaluate", "regress", "engine"]),
    ("evidence", &["engine", "evidence"]),
    ("export", &["engine"]),
    ("list", &["preset"]),
];

/// Returns the tables and keys that a command reads.
pub fn tables(command: &str) -> &'static [&'static str] {
    TABLES.iter().find(|(name, _)| *name == command).map_or(&[], |(_, tables)| tables)
}

/// Returns whether a command, or the question of a plan, reads a key.
pub fn reads_key(command: &str, key: &str) -> bool {
    is_within(key, tables(command))
}

/// Returns whether a key is one of these tables or stands in one.
fn is_within(key: &str, tables: &[&str]) -> bool {
    let table = key.split_once('.').map_or(TOP, |(table, _)| table);
    tables.iter().any(|known| *known == table || *known == key)
}

/// Flags that set keys of a plan.
#[derive(Clone, Debug, Args)]
pub struct Keys {
    /// Set a key of the plan; repeat the flag for several. Text stands as it is, other values are
    /// TOML
    #[arg(short = 'k', value_name = "KEY=VALUE", allow_hyphen_values = true, value_parser = assignment)]
    #[arg(hide_possible_values = true)]
    pub keys: Vec<Assignment>,
    /// Read a plan (TOML); flags and keys override it
    #[arg(long, value_name = "FILE")]
    pub plan: Option<PathBuf>,
}

impl Keys {
    /// Returns the settings of a command that asks no question of a plan, and what states them.
    pub fn settings(&self, command: &str) -> Result<(Settings, Planned)> {
        let mut planned = Planned::new(self)?;
        planned.assign(&self.keys, command, Values::One)?;
        Ok((Settings::take(&mut planned.table)?, planned))
    }
}

/// Flag of commands that read no plan, but have settings.
#[derive(Debug, Args)]
pub struct SettingKeys {
    /// Set a key; repeat the flag for several
    #[arg(short = 'k', value_name = "KEY=VALUE", allow_hyphen_values = true, value_parser = assignment)]
    #[arg(hide_possible_values = true)]
    pub keys: Vec<Assignment>,
}

impl SettingKeys {
    /// Returns the settings of a command.
    pub fn settings(&self, command: &str) -> Result<Settings> {
        settings(&self.keys, command)
    }
}

/// Returns the settings that assignments make, without a plan.
pub fn settings(assignments: &[Assignment], command: &str) -> Result<Settings> {
    let mut planned = Planned::from(Table::new());
    planned.assign(assignments, command, Values::One)?;
    planned.settings("a resumed run takes from its file")
}

/// As [`settings`], with the largest share of simulations without a verdict that the assignments
/// state: recorded simulations do not depend on it.
pub fn settings_of_runs(assignments: &[Assignment], command: &str) -> Result<(Settings, Option<f64>)> {
    let (share, others): (Vec<_>, Vec<_>) =
        assignments.iter().cloned().partition(|assignment| assignment.key == MAX_SHARE);
    let mut planned = Planned::from(Table::new());
    planned.assign(&share, command, Values::One)?;
    let share = planned.table.remove(MAX_SHARE).map(Value::try_into).transpose()?;
    Ok((settings(&others, command)?, share))
}

/// The assignment of a text to a key.
#[derive(Clone, Debug)]
pub struct Assignment {
    pub key: String,
    pub text: String,
}

/// Parses `KEY=VALUE`.
pub fn assignment(text: &str) -> Result<Assignment, String> {
    match text.split_once('=') {
        Some((key, text)) if !key.trim().is_empty() => {
            Ok(Assignment { key: key.trim().to_string(), text: text.to_string() })
        }
        _ => Err("expected KEY=VALUE, such as falsify.early-stopping=true".to_string()),
    }
}

/// Parses an assignment, and offers the keys of a command for completion.
#[derive(Clone)]
pub struct KeyParser(pub &'static [&'static str]);

impl KeyParser {
    fn keys(&self) -> impl Iterator<Item = &'static Key> {
        let tables = self.0;
        keys().iter().filter(move |key| is_within(&key.name, tables))
    }

    /// Returns a line for each key: its name, its default and its allowed values.
    pub fn help(&self) -> String {
        let column = self.keys().map(|key| key.name.len()).max().unwrap_or(0);
        let line = |key: &Key| {
            let default = key.default.as_ref().map(|default| format!(" [default: {default}]"));
            format!("  {:column$}  {}{}", key.name, key.allowed, default.unwrap_or_default())
        };
        self.keys().map(line).collect::<Vec<_>>().join("\n")
    }
}

impl TypedValueParser for KeyParser {
    type Value = Assignment;

    fn parse_ref(
        &self,
        command: &clap::Command,
        argument: Option<&clap::Arg>,
        value: &std::ffi::OsStr,
    ) -> Result<Assignment, clap::Error> {
        assignment.parse_ref(command, argument, value)
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        let value = |key: &Key| {
            let about = key.doc.trim().lines().next().unwrap_or_default().trim().to_string();
            // The parser wants names that live as long as the program, which asks once.
            PossibleValue::new(&*format!("{}=", key.name).leak()).help(about)
        };
        Some(Box::new(self.keys().map(value)))
    }
}

/// A plan in the making: a table, and who has stated each of its keys.
#[derive(Debug)]
pub struct Planned {
    pub table: Table,
    /// Flag or assignment that set a key.
    stated: BTreeMap<String, String>,
    /// Assignments of search options, whose type depends on the search.
    options: Vec<Assignment>,
}

impl From<Table> for Planned {
    fn from(table: Table) -> Planned {
        Planned { table, stated: BTreeMap::new(), options: Vec::new() }
    }
}

impl Planned {
    /// Reads the file of a plan.
    pub fn new(flags: &Keys) -> Result<Planned> {
        let table = match &flags.plan {
            Some(path) => {
                let name = || path.display().to_string();
                let text = read_text_bounded(path, limits::PLAN).with_context(name)?;
                mishandle::plan::table(&text, Values::One).with_context(name)?
            }
            None => Table::new(),
        };
        Ok(Planned::from(table))
    }

    /// Sets the keys of a command.
    pub fn assign(&mut self, assignments: &[Assignment], command: &str, values: Values) -> Result<()> {
        for Assignment { key, text } in assignments {
            check_table(key, command)?;
            self.state(key, &format!("-k {key}={text}"))?;
            if key.starts_with("falsify.options.") {
                self.options.push(Assignment { key: key.clone(), text: text.clone() });
            } else {
                set(&mut self.table, key, text, values)?;
            }
        }
        Ok(())
    }

    /// Sets a key to the value of a flag, if the flag is given.
    pub fn flag(&mut self, flag: &str, key: &str, value: Option<impl Into<Value>>) -> Result<()> {
        if let Some(value) = value {
            self.state(key, flag)?;
            set_value(&mut self.table, key, value.into())?;
        }
        Ok(())
    }

    /// As [`Planned::flag`] for an integer.
    pub fn number(&mut self, flag: &str, key: &str, value: Option<impl Into<u64>>) -> Result<()> {
        // Integers of TOML end at 2⁶³ - 1. Seeds above are texts.
        let value = value.map(|number| {
            let number = number.into();
            i64::try_from(number).map_or_else(|_| Value::String(number.to_string()), Value::Integer)
        });
        self.flag(flag, key, value)
    }

    /// Notes who states a key.
    fn state(&mut self, key: &str, who: &str) -> Result<()> {
        match self.stated.insert(key.to_string(), who.to_string()) {
            Some(earlier) => bail!("{key} is set twice, by {earlier} and by {who}; set it once"),
            None => Ok(()),
        }
    }

    /// Returns whether a flag or an assignment stated a key.
    pub fn has_stated(&self, key: &str) -> bool {
        self.stated.contains_key(key)
    }

    /// Returns the keys of a table that a flag or an assignment stated, without the table.
    pub fn stated_in(&self, table: &str) -> impl Iterator<Item = &str> {
        self.stated.keys().filter_map(move |key| key.strip_prefix(table)?.strip_prefix('.'))
    }

    /// Returns whether the plan has a key of a table.
    pub fn has(&self, table: &str, key: &str) -> bool {
        self.table.get(table).and_then(Value::as_table).is_some_and(|table| table.contains_key(key))
    }

    /// Returns whether a flag or an assignment states anything.
    pub fn is_edited(&self) -> bool {
        !self.stated.is_empty()
    }

    /// Sets the options of a search, whose types depend on the search.
    fn set_options(&mut self, values: Values) -> Result<()> {
        for Assignment { key, text } in &self.options {
            set(&mut self.table, key, text, values)?;
        }
        Ok(())
    }

    /// Returns the table of the plan.
    pub fn into_table(mut self, values: Values) -> Result<Table> {
        self.set_options(values)?;
        Ok(self.table)
    }

    /// Returns the plan of one question, whose table has its defaults if nothing sets its keys.
    pub fn question(mut self, question: &str) -> Result<(Plan, Settings)> {
        self.remove_questions(|name| name != question);
        self.table.entry(question).or_insert_with(|| Value::Table(Table::new()));
        self.plan()
    }

    /// Returns the plan of what asks no question.
    pub fn no_question(mut self) -> Result<(Plan, Settings)> {
        self.remove_questions(|_| true);
        self.plan()
    }

    /// Removes tables of questions.
    fn remove_questions(&mut self, is_removed: impl Fn(&str) -> bool) {
        let all = ["evaluate", "compare", "falsify", "margin", "metamorphic", "risk", "harden"];
        self.table.retain(|name, _| !(all.contains(&name) && is_removed(name)));
    }

    /// Returns the settings alone. `who` says who has the question that an assigned key belongs to.
    pub fn settings(mut self, who: &str) -> Result<Settings> {
        let settings = Settings::take(&mut self.table)?;
        match self.stated.keys().find(|key| !Settings::has(key)) {
            Some(key) => bail!("{key} is part of the question, which {who}"),
            None => Ok(settings),
        }
    }

    /// Returns the plan with all of its tables.
    pub fn plan(self) -> Result<(Plan, Settings)> {
        let (plan, settings) = self.without_target()?;
        ensure!(!plan.target.is_empty(), "there is no target: name one in the plan or as an argument");
        Ok((plan, settings))
    }

    /// As [`Planned::plan`], for what needs no target.
    pub fn without_target(mut self) -> Result<(Plan, Settings)> {
        self.set_options(Values::One)?;
        let settings = Settings::take(&mut self.table)?;
        let is_typed = self.has_stated("target");
        if is_typed && !self.has_stated("folder") {
            self.table.remove("folder");
        }
        let is_trainer_typed = self.has_stated("harden.trainer");
        let mut plan = Plan::from_toml(&self.table.to_string())?;
        plan.is_typed = is_typed;
        if let Some(harden) = &mut plan.harden {
            harden.is_trainer_typed = is_trainer_typed;
        }
        Ok((plan, settings))
    }
}

/// Checks that a command reads a key.
fn check_table(key: &str, command: &str) -> Result<()> {
    let tables = tables(command);
    let is_known = keys().iter().any(|known| {
        known.name == key || key.strip_prefix(&known.name).is_some_and(|rest| rest.starts_with('.'))
    });
    if !is_known {
        let known = keys().iter().map(|key| key.name.as_str()).filter(|key| is_within(key, tables));
        return Err(
            MishandleError::UnknownKey { line: None, key: key.to_string(), known: known.collect() }.into()
        );
    }
    if is_within(key, tables) {
        return Ok(());
    }
    let table = key.split_once('.').map_or(TOP, |(table, _)| table);
    let known: Vec<&str> = tables.iter().copied().filter(|table| !table.is_empty()).collect();
    bail!(
        "{key} is a key of the table {table}, which `mishandle {command}` does not read; it reads {}",
        known.join(", ")
    )
}
