//! The description of a simulator, checked.

use std::cmp::Ordering;
use std::collections::BTreeSet;
use std::time::Duration;

use mishandle_rollout::{
    Axis, AxisKind, AxisValues, ControlLoop, LoopPart, NamedFormula, Signal, Space, Specification,
};
use mishandle_stl::{Clock, Formula, Monitor};
use serde_json::Value;

use crate::hello::{
    AxisEntry, FormulaEntry, Hello, Level, Mode, PartEntry, PolicyEntry, SignalEntry, Values,
};

/// Largest number of control steps.
const MAX_STEPS: usize = 1_000_000;

/// Longest episode, s: about 30,000 years, so that all times are finite and distinct.
const MAX_DURATION: f64 = 1e12;

/// Largest number of numbers of a trace.
const MAX_NUMBERS: usize = 1 << 24;

/// Largest length of a name, characters.
const MAX_NAME: usize = 200;

/// Largest number of axes, signals or formulas, and of numbers of an observation or action.
const MAX_COUNT: usize = 10_000;

/// Time limit of an answer to `simulate`, s.
const SIMULATE_LIMIT: f64 = 60.0;

/// Time limit of an answer to `reset` and `step`, s.
const STEP_LIMIT: f64 = 10.0;

/// Largest time limit, s.
pub(crate) const MAX_LIMIT: f64 = 1e6;

/// Name of the space of all axes.
const SPACE: &str = "scenarios";

/// A simulator as Mishandle uses it.
#[derive(Clone, Debug)]
pub struct Description {
    /// Name.
    pub name: String,
    /// Duration of a control step, s.
    pub control_dt: f64,
    /// Number of control steps of an episode.
    pub steps: usize,
    /// Its own axes.
    pub axes: Vec<Axis>,
    /// Its own spaces; the first is the default.
    pub spaces: Vec<Space>,
    /// Its signals, in the order of a trace.
    pub signals: Vec<Signal>,
    /// Its formulas; the first is the default requirement.
    pub formulas: Vec<NamedFormula>,
    /// Whether equal questions have equal answers.
    pub is_deterministic: bool,
    /// Whether an answer depends on the seed.
    pub depends_on_seed: bool,
    /// Files whose bytes belong to its hash, as it names them.
    pub files: Vec<String>,
    /// Names and versions of its software.
    pub versions: Vec<(String, String)>,
    /// Content of one answer.
    pub mode: Mode,
    /// Observation and action of the policy that Mishandle runs.
    pub policy: Option<ControlLoop>,
    /// Time limit of an answer.
    pub time_limit: Duration,
}

impl Description {
    /// Checks what a simulator says about itself.
    ///
    /// # Errors
    /// Returns the end of a sentence that begins with "the simulator answers with".
    pub(crate) fn new(hello: &Hello) -> Result<Description, String> {
        name("name", &hello.name)?;
        let Hello { control_dt, steps, .. } = *hello;
        if !(control_dt.is_finite() && control_dt > 0.0) {
            return Err(format!("a control step of {control_dt} s; it must be positive and finite"));
        }
        if !(1..=MAX_STEPS).contains(&steps) {
            return Err(format!("{steps} control steps; from 1 to {MAX_STEPS} are possible"));
        }
        if control_dt * steps as f64 > MAX_DURATION {
            return Err(format!(
                "an episode of {} s; at most {MAX_DURATION} s are possible",
                control_dt * steps as f64
            ));
        }
        let (axes, spaces) = axes_and_spaces(hello)?;
        let signals = signals(hello)?;
        let formulas = formulas(hello, &signals)?;
        let policy = hello.policy.as_ref().map(|entry| control_loop(entry, hello)).transpose()?;
        let mode = match (hello.mode, &policy) {
            (Some(Mode::Trace), Some(_)) => {
                return Err(
                    "a policy in the mode `trace`; Mishandle runs policies in the mode `step`".to_string()
                );
            }
            (None, Some(_)) => Mode::Step,
            (mode, _) => mode.unwrap_or(Mode::Trace),
        };
        let default = if mode == Mode::Trace { SIMULATE_LIMIT } else { STEP_LIMIT };
        let limit = hello.time_limit.unwrap_or(default);
        if !(limit > 0.0 && limit <= MAX_LIMIT) {
            return Err(format!(
                "a time limit of {limit} s; it must be more than 0 and at most {MAX_LIMIT} s"
            ));
        }
        count("files", hello.files.len())?;
        count("versions", hello.versions.len())?;
        for (software, version) in &hello.versions {
            name("name of a software", software)?;
            name("version of a software", version)?;
        }
        let own = (hello.name.clone(), hello.version.clone());
        let own = Some(own).filter(|(_, version)| !version.is_empty());
        let others = hello.versions.iter().filter(|(software, _)| **software != hello.name);
        let others = others.map(|(software, version)| (software.clone(), version.clone()));
        Ok(Description {
            name: hello.name.clone(),
            control_dt,
            steps,
            axes,
            spaces,
            signals,
            formulas,
            is_deterministic: hello.deterministic,
            depends_on_seed: hello.seeded,
            files: hello.files.clone(),
            versions: own.into_iter().chain(others).collect(),
            mode,
            policy,
            time_limit: Duration::from_secs_f64(limit),
        })
    }
}

/// Checks a name, which formulas, flags and run files contain.
fn name(what: &str, name: &str) -> Result<(), String> {
    let is_long = name.chars().count() > MAX_NAME;
    if name.is_empty() || is_long || name.chars().any(char::is_control) {
        let shown: String = name.chars().take(50).flat_map(char::escape_debug).collect();
        return Err(format!("the {what} `{shown}`; it must have from 1 to {MAX_NAME} visible characters"));
    }
    Ok(())
}

fn count(what: &str, count: usize) -> Result<(), String> {
    match count {
        0..=MAX_COUNT => Ok(()),
        _ => Err(format!("{count} {what}; at most {MAX_COUNT} are possible")),
    }
}

fn axes_and_spaces(hello: &Hello) -> Result<(Vec<Axis>, Vec<Space>), String> {
    count("axes", hello.axes.len())?;
    let axes = hello.axes.iter().map(axis).collect::<Result<Vec<Axis>, String>>()?;
    let space =
        |name: &str, axes| Space::new(name, axes).map_err(|error| format!("axes that are wrong: {error}"));
    let all = space(SPACE, axes.clone())?;
    if hello.spaces.is_empty() {
        return Ok((axes, vec![all]));
    }
    count("spaces", hello.spaces.len())?;
    let mut spaces = Vec::new();
    for (key, value) in &hello.spaces {
        name("name of a space", key)?;
        if key.contains('+') || key == "all" {
            return Err(format!("the space `{key}`; `all` is the space of all axes, and `+` joins names"));
        }
        let Value::Array(names) = value else {
            return Err(format!("the space `{key}`, which is not a list of names of axes"));
        };
        let named = |name: &Value| {
            let found = axes.iter().find(|axis| name.as_str() == Some(&axis.name)).cloned();
            found.ok_or_else(|| format!("the space `{key}` with {name}, which is the name of no axis"))
        };
        spaces.push(space(key, names.iter().map(named).collect::<Result<_, _>>()?)?);
    }
    Ok((axes, spaces))
}

fn axis(entry: &AxisEntry) -> Result<Axis, String> {
    name("name of an axis", &entry.name)?;
    let wrong = |problem: String| format!("the axis `{}`, {problem}", entry.name);
    let kind = match AxisKind::by_name(&entry.kind) {
        Some(kind) if kind != AxisKind::Noise => kind,
        _ => {
            return Err(wrong(format!(
                "whose kind is `{}`; it must be start, model, event, fault or input",
                entry.kind.chars().take(50).collect::<String>()
            )));
        }
    };
    if let Values::Categories(names) = &entry.values {
        return categories(entry, kind, names).map_err(wrong);
    }
    let (Some(low), Some(high)) = (entry.low, entry.high) else {
        return Err(wrong("which lacks `low` or `high`".to_string()));
    };
    let Level::Number(nominal) = entry.nominal else {
        return Err(wrong("whose nominal value is not a number".to_string()));
    };
    let values = match &entry.values {
        Values::Kind(kind) if kind == "continuous" => AxisValues::Continuous,
        Values::Kind(kind) if kind == "integer" => AxisValues::Integer,
        Values::Kind(kind) if kind == "logarithmic" => AxisValues::Logarithmic,
        _ => {
            let known = "continuous, integer, logarithmic or a list of names";
            return Err(wrong(format!("whose values must be {known}")));
        }
    };
    if low > high {
        return Err(wrong(format!("whose `low` {low} is above its `high` {high}")));
    }
    if !(low..=high).contains(&nominal) {
        return Err(wrong(format!("whose nominal value {nominal} is not from {low} to {high}")));
    }
    if values == AxisValues::Integer && nominal.fract() != 0.0 {
        return Err(wrong(format!("whose nominal value {nominal} is not a whole number")));
    }
    let axis = Axis::new(kind, &entry.name, &entry.unit, [low, high], Some(nominal));
    Ok(axis.with_values(values).meaning(&entry.meaning))
}

/// Returns an axis of names.
fn categories(entry: &AxisEntry, kind: AxisKind, names: &[String]) -> Result<Axis, String> {
    if entry.low.is_some() || entry.high.is_some() {
        return Err("which has names and bounds; names have no bounds".to_string());
    }
    let different: BTreeSet<&String> = names.iter().collect();
    count("values", names.len())?;
    // Run files list them with commas.
    let is_wrong = |name: &String| name.contains(',') || self::name("value", name).is_err();
    if names.is_empty() || different.len() < names.len() || names.iter().any(is_wrong) {
        return Err("whose values must be different short names without commas".to_string());
    }
    let Level::Name(nominal) = &entry.nominal else {
        return Err("whose nominal value is none of its names".to_string());
    };
    let index = names.iter().position(|name| name == nominal);
    let index = index.ok_or_else(|| format!("whose nominal value `{nominal}` is none of its names"))?;
    let bounds = [0.0, (names.len() - 1) as f64];
    let axis = Axis::new(kind, &entry.name, &entry.unit, bounds, Some(index as f64));
    Ok(axis.with_values(AxisValues::Categorical(names.into())).meaning(&entry.meaning))
}

fn signals(hello: &Hello) -> Result<Vec<Signal>, String> {
    count("signals", hello.signals.len())?;
    if hello.signals.is_empty() {
        return Err("no signals; a formula needs one".to_string());
    }
    let numbers = (hello.steps + 1).saturating_mul(hello.signals.len());
    if numbers > MAX_NUMBERS {
        return Err(format!("traces of {numbers} numbers; at most {MAX_NUMBERS} are possible"));
    }
    let mut known = BTreeSet::new();
    for signal in &hello.signals {
        name("name of a signal", &signal.name)?;
        if !known.insert(&signal.name) {
            return Err(format!("two signals `{}`", signal.name));
        }
    }
    let signal = |signal: &SignalEntry| Signal { name: signal.name.clone(), unit: signal.unit.clone() };
    Ok(hello.signals.iter().map(signal).collect())
}

fn formulas(hello: &Hello, signals: &[Signal]) -> Result<Vec<NamedFormula>, String> {
    count("formulas", hello.formulas.len())?;
    let names: Vec<String> = signals.iter().map(|signal| signal.name.clone()).collect();
    let mut known = BTreeSet::new();
    for formula in &hello.formulas {
        name("name of a formula", &formula.name)?;
        if !known.insert(&formula.name) {
            return Err(format!("two formulas `{}`", formula.name));
        }
        let wrong = |problem: String| format!("the formula `{}`: {problem}", formula.name);
        let parsed = Formula::parse(&formula.text).map_err(|error| wrong(error.to_string()))?;
        let monitor = Monitor::new(&parsed, &names, Clock::steps(hello.control_dt));
        let monitor = monitor.map_err(|error| wrong(error.to_string()))?;
        if let Some(needed) = monitor.horizon().filter(|needed| *needed > hello.steps) {
            return Err(wrong(format!(
                "it needs {needed} control steps, and an episode has {}",
                hello.steps
            )));
        }
    }
    let named = |f: &FormulaEntry| NamedFormula { name: f.name.clone(), text: f.text.clone() };
    let formulas: Vec<NamedFormula> = hello.formulas.iter().map(named).collect();
    // Some names are roles, such as `safe`, which is a predicate on one sample.
    if let Some(first) = formulas.first() {
        let requirement = Formula::parse(&first.text).map_err(|error| error.to_string())?;
        Specification::from_formulas(&formulas, requirement).map_err(|error| error.to_string())?;
    }
    Ok(formulas)
}

fn control_loop(entry: &PolicyEntry, hello: &Hello) -> Result<ControlLoop, String> {
    let parts = |side: &str, entries: &[PartEntry]| {
        let mut known = BTreeSet::new();
        for part in entries {
            name("name of a part of the policy's interface", &part.name)?;
            if !known.insert(&part.name) {
                return Err(format!("two parts `{}` of the {side}", part.name));
            }
        }
        for PartEntry { name, range, .. } in entries {
            if range.is_some_and(|[low, high]| low.partial_cmp(&high) != Some(Ordering::Less)) {
                return Err(format!("the range of `{name}`, whose first number must be below the second"));
            }
        }
        let size = entries.iter().fold(0_usize, |sum, part| sum.saturating_add(part.size));
        if entries.iter().any(|part| part.size == 0) || !(1..=MAX_COUNT).contains(&size) {
            return Err(format!(
                "a policy whose {side} has {size} numbers; each part needs one, and {MAX_COUNT} are possible"
            ));
        }
        let part = |part: &PartEntry| LoopPart {
            name: part.name.clone(),
            unit: part.unit.clone(),
            size: part.size,
            range: part.range,
        };
        Ok(entries.iter().map(part).collect::<Vec<LoopPart>>())
    };
    if entry.action_limit.is_nan() || entry.action_limit <= 0.0 {
        return Err(format!("an action limit of {}; it must be positive", entry.action_limit));
    }
    Ok(ControlLoop {
        observation: parts("observation", &entry.observation)?,
        action: parts("action", &entry.action)?,
        action_limit: entry.action_limit,
        control_dt: hello.control_dt,
        episode_steps: hello.steps,
    })
}
