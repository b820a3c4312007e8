//! The warnings of the checks before the first simulation, without those that the simulations of
//! the run contradict.

use std::collections::HashMap;

use mishandle_rollout::Axis;
use mishandle_store::{RunFile, RunKind, Simulation, SimulationEnd};

use crate::error::MishandleError;
use crate::run::cause::isolation;
use crate::run::preflight::without_effect;
use crate::run::recorded_axis;

/// Number of simulations of trials that are looked at.
const MAX_ROWS: usize = 100_000;

/// Returns the warnings of the checks before the first simulation of a run. That an axis changes no
/// trace is said of the probed points: it is left out if two simulations that differ in that axis
/// alone have different traces, or if the axis is part of a cause.
///
/// # Errors
/// If the run cannot be read.
pub fn warnings(run: &RunFile) -> Result<Vec<String>, MishandleError> {
    let header = run.header();
    let mut kept = header.preflight.clone();
    let axes: Vec<Axis> = header.axes.iter().map(recorded_axis).collect();
    let is_claimed = |index: &usize| header.preflight.contains(&without_effect(&axes[*index]));
    let claimed: Vec<usize> = (0..axes.len()).filter(is_claimed).collect();
    if claimed.is_empty() {
        return Ok(kept);
    }
    let mut effective = axes_of_causes(run)?;
    for index in claimed {
        if effective.contains(&axes[index].name) || changes_traces(run, index)? {
            effective.push(axes[index].name.clone());
            let claim = without_effect(&axes[index]);
            kept.retain(|warning| *warning != claim);
        }
    }
    Ok(kept)
}

/// Returns the names of the axes of the causes of counterexamples.
fn axes_of_causes(run: &RunFile) -> Result<Vec<String>, MishandleError> {
    let mut found = Vec::new();
    if run.header().kind == RunKind::Falsify {
        for trial in run.trials()? {
            if let Some(isolation) = isolation(run, trial.trial.number)? {
                found.extend(isolation.result_with(None).axes);
            }
        }
    }
    Ok(found)
}

/// Returns whether two simulations of a run that differ in one axis alone have different traces.
fn changes_traces(run: &RunFile, axis: usize) -> Result<bool, MishandleError> {
    let mut digests = HashMap::new();
    let derived =
        run.derived_trials()?.into_iter().flat_map(|trial| run.trial_simulations(trial.trial.number));
    for row in run.simulations().take(MAX_ROWS).chain(derived) {
        let row = row?;
        // A stop cuts a trace, at a threshold of its own.
        let (Some(digest), false) = (row.trace_digest, matches!(row.end, SimulationEnd::Stopped { .. }))
        else {
            continue;
        };
        if *digests.entry(others(&row, axis)).or_insert(digest) != digest {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Returns what two simulations that differ in one axis alone have in common: the seed, and the
/// bits of the other values.
fn others(row: &Simulation, axis: usize) -> (u64, Vec<Option<u64>>) {
    let others = row.scenario.iter().enumerate().filter(|(index, _)| *index != axis);
    (row.seed, others.map(|(_, value)| value.map(f64::to_bits)).collect())
}
