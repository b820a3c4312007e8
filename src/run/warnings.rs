//! The warnings of the checks before the first simulation, without those that the simulations of
//! the run contradict.

use std::collections::HashMap;

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
    let idle = idle_axes(run)?;
    let is_axis = claims(run);
    let is_kept = |warning: &String| !is_axis.contains(warning) || idle.contains(warning);
    Ok(run.header().preflight.iter().filter(|warning| is_kept(warning)).cloned().collect())
}

/// Returns the warnings about axes that change no trace, each of which is a sentence.
///
/// # Errors
/// If the run cannot be read.
pub(crate) fn idle_axes(run: &RunFile) -> Result<Vec<String>, MishandleError> {
    let preflight = &run.header().preflight;
    let is_claimed = |(_, claim): &(usize, &String)| preflight.contains(claim);
    let claims = claims(run);
    let claimed: Vec<(usize, &String)> = claims.iter().enumerate().filter(is_claimed).collect();
    if claimed.is_empty() {
        return Ok(Vec::new());
    }
    let mut idle = Vec::new();
    let effective = axes_of_causes(run)?;
    for (index, claim) in claimed {
        if !effective.contains(&run.header().axes[index].name) && !changes_traces(run, index)? {
            idle.push(claim.clone());
        }
    }
    Ok(idle)
}

/// Returns the warning that each axis would have if it changed no trace.
fn claims(run: &RunFile) -> Vec<String> {
    run.header().axes.iter().map(|axis| without_effect(&recorded_axis(axis))).collect()
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
