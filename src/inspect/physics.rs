//! The check of the physics of the counterexamples of a falsification.

use std::ops::ControlFlow;

use mishandle_falsification::PhysicsChecks;
use mishandle_results::{Falsification, PhysicsCheck};
use mishandle_rollout::{Request, Scenario, Seed};
use mishandle_store::{Finding, RunFile};

use crate::error::MishandleError;
use crate::resolve::ResolvedPlan;
use crate::run::{Isolation, isolation, physics_finding};

/// Checks the physics of the counterexample of each falsified trial and of the representative of
/// each failure mode, where the run has no check. The minimal failure of a trial goes back toward
/// its counterexample until it survives. Nothing happens for a target without changes to check.
/// Returns the new checks.
///
/// `watch` gets the number of finished simulations and the largest number of all, first before the
/// first of them. If it ends the checks, the rest is missing.
///
/// # Errors
/// If a simulation cannot be run, or the run file cannot be read.
pub(super) fn check_physics(
    resolved: &ResolvedPlan,
    found: &mut Falsification,
    run: &RunFile,
    watch: &mut dyn FnMut(u64, u64) -> ControlFlow<()>,
) -> Result<Vec<Finding>, MishandleError> {
    let mut findings = Vec::new();
    if found.falsified_trials == 0 || resolved.target.solver_variants.is_empty() {
        return Ok(findings);
    }
    let mut points: Vec<Point<'_>> = Vec::new();
    let mut causes: Vec<(usize, Isolation)> = Vec::new();
    for (index, trial) in found.trials.iter_mut().enumerate().filter(|(_, trial)| trial.falsified) {
        if trial.cause.is_some() {
            let isolation = isolation(run, trial.trial)?.filter(|isolation| !isolation.is_checked());
            causes.extend(isolation.map(|isolation| (index, isolation)));
        }
        let place = trial.simulation.map(|simulation| (trial.trial, simulation));
        let (Some(values), Some(seed), Some(place)) = (&trial.initial_configuration, trial.seed, place)
        else {
            continue;
        };
        points.push((request(values.clone(), seed.0, place), &mut trial.physics));
    }
    for mode in found.modes.iter_mut().flat_map(|modes| &mut modes.modes) {
        let mode = &mut mode.mode;
        let values = mode.scenario.values().copied().collect();
        points.push((request(values, mode.seed.0, (mode.trial, mode.simulation)), &mut mode.physics));
    }
    points.retain(|(_, check)| check.is_none());
    if points.is_empty() && causes.is_empty() {
        return Ok(findings);
    }
    let failures: Vec<Vec<Request>> = causes.iter().map(|(_, isolation)| isolation.failures()).collect();
    let to_go_back = failures.iter().map(|failures| PhysicsChecks::most_to_go_back(failures.len() as u64));
    let most = PhysicsChecks::most(points.len() as u64) + to_go_back.sum::<u64>();
    if watch(0, most).is_break() {
        return Ok(findings);
    }
    let mut checks = resolved.physics_checks()?;
    let mut watch = |done| watch(done, most);
    // Together with the minimal failures, most of which survive.
    let nearest = failures.iter().filter_map(|failures| failures.first());
    let requests: Vec<Request> = points.iter().map(|(request, _)| request).chain(nearest).cloned().collect();
    let Some(results) = checks.check(&requests, &mut watch)? else { return Ok(findings) };
    for ((request, place), check) in points.into_iter().zip(results) {
        findings.extend(physics_finding((request.trial, request.number), &check));
        *place = Some(check);
    }
    for ((index, isolation), failures) in causes.into_iter().zip(failures) {
        let Some(survivor) = checks.nearest_survivor(&failures, &mut watch)? else { return Ok(findings) };
        for (index, check) in &survivor.checked {
            let Request { trial, number, .. } = failures[*index];
            findings.extend(physics_finding((trial, number), check));
        }
        let isolation = isolation.checked(survivor);
        found.trials[index].cause = Some(isolation.result(run)?);
    }
    Ok(findings)
}

fn request(values: Vec<Option<f64>>, seed: u64, place: (u32, u32)) -> Request {
    Request { trial: place.0, number: place.1, ..Request::new(Scenario::new(values), Seed(seed)) }
}

/// A failure, and the place of its check.
type Point<'a> = (Request, &'a mut Option<PhysicsCheck>);
