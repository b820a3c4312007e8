//! The violation of a requirement in a result: what it says follows from its run and its
//! counterexample, and what simulates it again.

use std::path::{Path, PathBuf};

use mishandle_files::{limits, read_bounded};
use mishandle_results::{Check, CheckCounterexample, CheckedRequirement, CheckedValue, Command, Key, Words};
use mishandle_stl::Formula;
use mishandle_store::{ComponentRecord, RunFile, RunHeader};

use super::row::Row;
use crate::counterexample::Counterexample;
use crate::error::MishandleError;
use crate::plan::Plan;
use crate::portable::BESIDE;
use crate::replay::replay_command;
use crate::resolve::is_python;
use crate::run::rows::REQUIREMENT;

/// Describes what is wrong with a violation; `None` if nothing is.
pub(super) fn problem<'r>(
    requirement: &CheckedRequirement,
    found: &CheckCounterexample,
    row: &Row,
    run: &impl Fn(&str) -> Option<&'r RunFile>,
    place: &impl Fn(&str) -> PathBuf,
) -> Option<String> {
    let worst = |file: &&RunFile| {
        let is_it = |(path, trial, number): &(PathBuf, u32, u32)| {
            (path.as_path(), *trial, *number) == (file.path(), found.trial, found.simulation)
        };
        row.worst.as_ref().is_some_and(is_it) && is_recorded(&requirement.name, found, file)
    };
    let Some(file) = run(&found.run).filter(worst) else {
        return Some(format!("its counterexample is not in {}", found.run));
    };
    let Some(name) = &found.file else {
        return found.physics.as_ref().map(|_| "the physics of no counterexample was checked".to_string());
    };
    match Counterexample::read(&place(name)) {
        Ok(counterexample) if is_of(&counterexample, requirement, found, file.header()) => None,
        Ok(_) => Some(format!("{name} is not its counterexample")),
        Err(error) => Some(format!("{name}: {}", error.with_causes())),
    }
}

/// Returns whether a violation of a requirement is a recorded simulation.
fn is_recorded(name: &str, violation: &CheckCounterexample, file: &RunFile) -> bool {
    let axes = &file.header().axes;
    let is_own = |verdict: &String| verdict.strip_prefix(REQUIREMENT) == Some(name);
    let column = file.header().verdicts.iter().position(is_own);
    file.simulation(violation.trial, violation.simulation).is_ok_and(|recorded| {
        let values = axes.iter().zip(&recorded.scenario);
        let robustness = column.and_then(|column| recorded.verdicts.get(column).copied().flatten());
        recorded.seed == violation.seed.0
            && robustness == Some(violation.robustness.0)
            && axes.len() == violation.scenario.len()
            && values.zip(&violation.scenario).all(|((axis, value), stated)| {
                (&axis.name, &axis.unit, *value, axis.nominal)
                    == (&stated.axis, &stated.unit, stated.value, stated.nominal)
            })
    })
}

/// Returns whether a counterexample is a violation of a requirement in a run.
fn is_of(
    counterexample: &Counterexample,
    requirement: &CheckedRequirement,
    found: &CheckCounterexample,
    header: &RunHeader,
) -> bool {
    let formula = counterexample.plan.falsify.as_ref().and_then(|falsify| falsify.formula.as_deref());
    let part = |part: &ComponentRecord| (part.role.clone(), part.hash.clone(), part.file_hash.clone());
    let value = |value: &crate::counterexample::AxisValue| CheckedValue {
        axis: value.axis.clone(),
        unit: value.unit.clone(),
        value: value.value,
        nominal: value.nominal,
    };
    counterexample.scenario.iter().map(value).eq(found.scenario.iter().cloned())
        && (counterexample.trial, counterexample.simulation) == (found.trial, found.simulation)
        && counterexample.seed == found.seed.0
        && counterexample.expected.robustness == found.robustness.0
        && counterexample.physics == found.physics
        && counterexample.target == header.target
        && counterexample.components.iter().map(part).eq(header.components.iter().map(part))
        && counterexample.plan.space == header.space
        && formula.is_some_and(|formula| normal(formula) == normal(requirement.formula_text()))
}

/// Returns a formula in its one spelling; `None` if it is none.
pub(super) fn normal(text: &str) -> Option<String> {
    Formula::parse(text).map(|formula| formula.to_string()).ok()
}

/// Names the command of each violation again, with the files beside its counterexample, or where
/// the run found them. `run` returns the file of a run.
///
/// # Errors
/// If a counterexample or the plan of a run cannot be read.
pub(super) fn name_replays<'r>(
    found: &mut Check,
    run: &dyn Fn(&str) -> Option<&'r RunFile>,
    words: Words,
) -> Result<(), MishandleError> {
    let kind = found.target_kind.clone();
    for violation in found.cells.iter_mut().filter_map(|cell| cell.counterexample.as_mut()) {
        let mut moved = Vec::new();
        if let (Some(file), Some(run)) = (&violation.file, run(&violation.run)) {
            let counterexample = Counterexample::read(Path::new(file))?;
            moved = moved_files(Path::new(file), &counterexample.plan, run.header())?;
        }
        violation.replay = words(&replay(&kind, violation, moved));
    }
    Ok(())
}

/// Returns what simulates a violation again. `moved` has the files that do not stand beside its
/// counterexample.
pub fn replay(target_kind: &str, found: &CheckCounterexample, moved: Vec<(Key, String)>) -> Command {
    match &found.file {
        Some(file) if !is_python(target_kind) => Command::ReplayFile { file: file.clone(), moved },
        _ => replay_command(target_kind, found.run.as_ref(), found.trial, found.simulation),
    }
}

/// Returns the files of the plan of a counterexample that do not stand beside it, with the paths
/// that its run recorded.
pub(super) fn moved_files(
    counterexample: &Path,
    plan: &Plan,
    header: &RunHeader,
) -> Result<Vec<(Key, String)>, MishandleError> {
    let recorded = Plan::from_toml(&header.plan)?;
    let folder = counterexample.parent().unwrap_or(Path::new(""));
    let files = [
        (Key::MOVED_CONTROLLER, &plan.controller, recorded.controller),
        (Key::MOVED_TARGET, &plan.target, recorded.target),
    ];
    let is_moved = |(_, name, original): &(Key, &String, String)| {
        name.strip_prefix(BESIDE).is_some_and(|name| !is_copy(&folder.join(name), Path::new(original)))
    };
    Ok(files.into_iter().filter(is_moved).map(|(key, _, original)| (key, original)).collect())
}

/// Returns whether a file is there, and not the one of another controller with the same name.
fn is_copy(copy: &Path, original: &Path) -> bool {
    let read = |path: &Path| read_bounded(path, limits::CONTROLLER).ok();
    copy.is_file() && (!original.is_file() || read(copy) == read(original))
}
