//! How each training of the plan stands: what is done, what is to do, and why.

use std::fmt;
use std::fs;

use anyhow::Result;
use serde_json::{Value, json};

use super::curve::Curve;
use super::facts::{Difference, Facts, Wanted, file_hash};
use super::home::Home;
use super::measure::conditions;
use super::plan::Training;
use super::program::Program;
use super::record::Record;

/// How a training stands.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum State {
    /// There is nothing to do.
    Done,
    /// Its controller is as it would be trained now, but not measured as it would be now.
    Unmeasured,
    /// It has to be trained; this is why.
    Missing(String),
    /// It has to be trained, and was begun: so many environment steps are saved.
    Interrupted { why: String, steps: Option<u64> },
    /// There are no settings for it.
    NotPlanned,
}

impl fmt::Display for State {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            State::Done => write!(f, "done"),
            State::Unmeasured => write!(f, "trained, to be measured"),
            State::Missing(why) => write!(f, "to be trained: {why}"),
            State::Interrupted { why, steps: Some(steps) } => {
                write!(f, "to be trained: {why}; interrupted at {steps} steps")
            }
            State::Interrupted { why, steps: None } => write!(f, "to be trained: {why}; interrupted"),
            State::NotPlanned => write!(f, "not run: there are no settings"),
        }
    }
}

/// A training, what it would hang on now, and how it stands.
#[derive(Clone, Debug)]
pub struct Standing {
    pub training: Training,
    /// The group of the plan that it belongs to.
    pub group: usize,
    pub wanted: Wanted,
    pub state: State,
    /// How its controller was trained, if there is one.
    pub facts: Option<Facts>,
    pub record: Option<Record>,
}

/// What stands in the way of a training that has no controller at all.
const NEW: &str = "there is none";

/// Finds out how a training stands. A controller that differs in its task alone is taken to be right if `adopt` says so.
///
/// # Errors
/// If a file cannot be read.
pub fn standing(
    home: &Home,
    program: &Program,
    (task, training): (&Value, &Training),
    wanted: Wanted,
    adopt: bool,
) -> Result<Standing> {
    let mut record = Record::load(home, &training.task, &training.controller())?;
    let path = home.controller(training);
    let hash = if path.is_file() { Some(file_hash(&path)?) } else { None };
    let is_recorded = record.as_ref().is_some_and(|record| Some(record.file_hash()) == hash.as_deref());
    let mut facts = match &record {
        // Of further seeds the record is kept, not the controller.
        Some(record) if is_recorded || !training.is_shipped() => record.facts(),
        _ => None,
    };
    if facts.is_none() && training.is_shipped() && hash.is_some() {
        facts = Some(Facts::of_file(&path)?);
    }
    let mut why = vec![NEW.to_string()];
    if let (Some(facts), Some(_)) = (&mut facts, &wanted.settings) {
        why = differences(program, training, &wanted, facts, adopt).iter().map(ToString::to_string).collect();
    }
    let mut state = match &record {
        _ if wanted.settings.is_none() => State::NotPlanned,
        _ if !why.is_empty() => unfinished(home, training, &wanted, why.join("; ")),
        Some(record) if record.is_of(&conditions(task, &wanted.task_hash)) => State::Done,
        _ => State::Unmeasured,
    };
    if !is_recorded && state == State::Done && training.is_shipped() {
        state = State::Unmeasured;
    }
    if !is_recorded && state == State::Unmeasured && !training.is_shipped() {
        let why = "the measurement has changed, and its controller was not kept";
        state = unfinished(home, training, &wanted, why.to_string());
    }
    if let (State::Done, Some(record), Some(facts)) = (&state, &mut record, &facts)
        && record.facts().as_ref() != Some(facts)
    {
        record.adopt(facts);
        record.save(home)?;
    }
    Ok(Standing { training: training.clone(), group: 0, wanted, state, facts, record })
}

/// All that keeps a controller from being what the training would give now. Its settings are then told in full; if its
/// file does not say which task it was trained on, it is adopted where nothing else differs.
pub fn differences(
    program: &Program,
    training: &Training,
    wanted: &Wanted,
    facts: &mut Facts,
    adopt: bool,
) -> Vec<Difference> {
    if wanted.settings.as_deref() != Some(facts.text("settings"))
        && let Ok(settings) = program.in_full(training, facts.text("settings"))
    {
        facts.0["settings"] = settings.into();
    }
    let found = facts.differences(training, wanted);
    let is_right = match found.as_slice() {
        [] => !facts.knows_task(),
        found => adopt && found == [Difference::Task],
    };
    if is_right {
        facts.adopt(&wanted.task_hash);
        return vec![];
    }
    found
}

/// A training that has to be done, or carried on if it was begun under what is wanted now.
fn unfinished(home: &Home, training: &Training, wanted: &Wanted, why: String) -> State {
    let begun = fs::read_to_string(home.work(training, BEGUN)).is_ok_and(|text| text == mark(wanted));
    if !(begun && home.work(training, CHECKPOINT).is_file()) {
        return State::Missing(why);
    }
    let curve = Curve::read(&home.work(training, ".csv")).ok();
    let steps = curve.and_then(|curve| curve.rows.last().map(|row| row.environment_steps));
    State::Interrupted { why, steps }
}

/// Ending of the file that says under what a training was begun, and of its checkpoint.
pub const BEGUN: &str = ".begun.json";
pub const CHECKPOINT: &str = ".safetensors.checkpoint";

/// Under what a training is begun: a checkpoint of anything else is of no use.
pub fn mark(wanted: &Wanted) -> String {
    let Wanted { settings, task_hash, layout_hash, .. } = wanted;
    json!({ "settings": settings, "task_hash": task_hash, "layout_hash": layout_hash }).to_string()
}
