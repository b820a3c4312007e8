//! Answers of the simulations that follow a search, in its run file: whoever reads the run names
//! the same cause as the search itself.

use mishandle_falsification::{Survivor, nearest_survivor};
use mishandle_results::{Falsification, PhysicsCheck, Repeats};
use mishandle_store::{Finding, RunFile, Simulation, StoreError};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::error::MishandleError;

const PHYSICS: &str = "physics";
const REPEATS: &str = "repeats";

fn finding(place: (u32, u32), kind: &str, value: &impl Serialize) -> Option<Finding> {
    // A result has no keys that JSON refuses.
    let value = serde_json::to_string(value).ok()?;
    Some(Finding { trial: place.0, number: place.1, kind: kind.to_string(), value })
}

/// Returns the check of the physics of a failure as a finding.
pub(crate) fn physics_finding(place: (u32, u32), check: &PhysicsCheck) -> Option<Finding> {
    finding(place, PHYSICS, check)
}

/// Returns the repeats of a counterexample as a finding.
pub(crate) fn repeats_finding(place: (u32, u32), repeats: &Repeats) -> Option<Finding> {
    finding(place, REPEATS, repeats)
}

fn recorded<T: DeserializeOwned>(
    run: &RunFile,
    place: (u32, u32),
    kind: &str,
) -> Result<Option<T>, StoreError> {
    let (trial, number) = place;
    let Some(text) = run.finding(trial, number, kind)? else { return Ok(None) };
    serde_json::from_str(&text).map(Some).map_err(|error| {
        let what = format!("the {kind} of simulation {number} of trial {trial}: {error}");
        StoreError::damaged(run.path(), what)
    })
}

/// Returns the recorded check of the physics of a failure.
///
/// # Errors
/// If the run cannot be read.
pub(crate) fn recorded_physics(
    run: &RunFile,
    place: (u32, u32),
) -> Result<Option<PhysicsCheck>, MishandleError> {
    let found: Option<PhysicsCheck> = recorded(run, place, PHYSICS)?;
    Ok(found.map(|check| PhysicsCheck::new(check.simulations)))
}

/// Returns the recorded repeats of a counterexample.
///
/// # Errors
/// If the run cannot be read.
pub(crate) fn recorded_repeats(run: &RunFile, place: (u32, u32)) -> Result<Option<Repeats>, MishandleError> {
    Ok(recorded(run, place, REPEATS)?)
}

/// Returns the failure nearest to nominal that survives the recorded checks of the physics, of
/// failures in the order of [`nearest_survivor`]; `None` if a check that it needs was not recorded.
///
/// # Errors
/// If the run cannot be read.
pub(crate) fn recorded_survivor(
    run: &RunFile,
    failing: &[Simulation],
) -> Result<Option<Survivor>, MishandleError> {
    nearest_survivor(failing.len(), |index| {
        recorded_physics(run, (failing[index].trial, failing[index].number))
    })
}

/// Adds the recorded findings to the counterexamples of a search.
///
/// # Errors
/// If the run cannot be read.
pub(super) fn add_findings(found: &mut Falsification, run: &RunFile) -> Result<(), MishandleError> {
    for trial in found.trials.iter_mut().filter(|trial| trial.falsified) {
        let Some(simulation) = trial.simulation else { continue };
        let place = (trial.trial, simulation);
        trial.physics = recorded_physics(run, place)?;
        trial.repeats = recorded_repeats(run, place)?;
    }
    Ok(())
}
