//! Names that plans can contain, as results: tasks, targets and searches.

use mishandle_results as results;
use mishandle_results::{InitialAxis, SearchOption};
use mishandle_rollout::{Axis, Space, Target};
use mishandle_search::{OptionSpec, SearchEntry};
use mishandle_tasks::{MANNER, Note, Preset, Task, notes};

use crate::error::MishandleError;
use crate::resolve::axis_facts;
use crate::shipped::shipped_controllers;

/// Describes a task with the initial box and the formulas of a preset.
///
/// # Errors
/// If the notes on the task are malformed.
pub fn task_result(task: &dyn Task, preset: Preset) -> Result<results::Task, MishandleError> {
    let definition = task.definition();
    let formulas = definition.formulas(preset);
    let axes = definition.initial_box.iter().map(|axis| {
        let [low, high] = axis.bounds(preset);
        InitialAxis { name: axis.name.to_string(), unit: axis.unit.to_string(), low, high }
    });
    Ok(results::Task {
        name: definition.name.to_string(),
        variant_of: definition.variant_of.map(str::to_string),
        success: formulas.success.to_string(),
        strict: formulas.strict.to_string(),
        careful: formulas.careful(),
        safe: formulas.safe.to_string(),
        completion: formulas.completion.to_string(),
        signals: definition.signals.iter().chain(MANNER).map(|signal| signal.name.to_string()).collect(),
        initial_box: axes.collect(),
        controllers: shipped_controllers(definition),
        notes: notes(task)?.iter().map(note).collect(),
    })
}

fn note(note: &Note) -> results::Note {
    let cell = |name: &str| {
        let cell = note.cells.iter().find(|(known, _)| *known == name);
        cell.map(|(_, text)| (*text).to_string())
    };
    results::Note {
        topic: note.topic.name().to_string(),
        every_task: note.is_shared,
        subject: note.subject.to_string(),
        paper: cell("paper"),
        here: cell("here"),
        why: cell("why"),
        fact: cell("fact"),
        measured: cell("measured"),
    }
}

/// Describes a target.
pub fn target_result(target: &Target) -> results::Target {
    let axis = |axis: &Axis| results::Axis {
        facts: axis_facts(axis),
        distribution: axis.distribution.name().to_string(),
        meaning: axis.meaning.clone(),
    };
    let space = |space: &Space| results::Space {
        name: space.name().to_string(),
        axes: space.axes().iter().map(axis).collect(),
    };
    let formulas = target.formulas.iter();
    let signals = target.all_signals();
    results::Target {
        name: target.identity.name.clone(),
        kind: target.identity.kind.clone(),
        deterministic: target.is_deterministic,
        control_dt: target.control_dt,
        episode_steps: target.episode_steps as u64,
        formulas: formulas
            .map(|formula| results::Formula { name: formula.name.clone(), text: formula.text.clone() })
            .collect(),
        signals: signals
            .map(|signal| results::Signal { name: signal.name.clone(), unit: signal.unit.clone() })
            .collect(),
        spaces: target.spaces.iter().map(space).collect(),
    }
}

/// Describes a search.
pub fn search_result(entry: &SearchEntry) -> results::Search {
    let option = |option: &OptionSpec| SearchOption {
        name: option.name.clone(),
        kind: option.kind.name().to_string(),
        default: option.default.clone(),
        range: option.range.to_string(),
        meaning: option.meaning.clone(),
    };
    results::Search {
        name: entry.name.to_string(),
        summary: entry.summary.to_string(),
        reference: entry.reference.to_string(),
        options: (entry.options)().iter().map(option).collect(),
    }
}
