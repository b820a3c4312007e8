//! Derives seed and scenario of a recorded simulation from the seed of its run, and the status of
//! its trial from its rows.

use mishandle_falsification::{FalsificationError, Trial};
use mishandle_rollout::Request;
use mishandle_store::{MAX_TRIALS, RunFile, RunKind, Simulation, TrialRecord, TrialStatus};

use crate::error::MishandleError;
use crate::resolve::ResolvedPlan;
use crate::run::journal::with_needed_trace;
use crate::run::{asked, evaluation, falsification, rows};

/// Lists the differences between the rows of the simulation's trial and those that the plan
/// implies.
///
/// For a falsification, the search proposes the points of the trial again and observes the recorded
/// results.
pub(super) fn differences(
    run: &RunFile,
    recorded: &Simulation,
    resolved: &ResolvedPlan,
) -> Result<Vec<String>, MishandleError> {
    let trial = run.trial(recorded.trial)?;
    let plan = &resolved.plan;
    match plan.kind() {
        RunKind::Falsify if plan.screening.is_none() => of_falsification(run, &trial, recorded, resolved),
        RunKind::Evaluate if plan.screening.is_none() => of_evaluation(run, recorded, resolved),
        _ => of_question(run, recorded, &trial, resolved),
    }
}

/// Asks the question again, with the recorded answers, up to the simulation.
fn of_question(
    run: &RunFile,
    recorded: &Simulation,
    trial: &TrialRecord,
    resolved: &ResolvedPlan,
) -> Result<Vec<String>, MishandleError> {
    let Simulation { trial: trial_number, number, .. } = *recorded;
    let mut found = Vec::new();
    let expected = resolved.trial_seed(trial_number);
    if trial.seed != expected {
        found.push(format!("seed of trial {trial_number}: recorded {}, expected {expected}", trial.seed));
    }
    match asked(resolved, run, (trial_number, number)) {
        Ok(Some(expected)) => found.extend(request_differences(recorded, &expected)),
        Ok(None) => {
            found.push(format!(
                "simulation {number} of trial {trial_number}: the plan has no such simulation"
            ));
        }
        Err(error) => found.push(error.to_string()),
    }
    Ok(found)
}

fn of_evaluation(
    run: &RunFile,
    recorded: &Simulation,
    resolved: &ResolvedPlan,
) -> Result<Vec<String>, MishandleError> {
    let mut found = evaluation::trial_differences(resolved, run)?;
    let Simulation { trial, number, .. } = *recorded;
    match evaluation::evaluation_request(resolved, trial, number)? {
        Some(expected) => found.extend(request_differences(recorded, &expected)),
        None => found.push(format!("simulation {number} of trial {trial}: the plan has no such simulation")),
    }
    Ok(found)
}

fn of_falsification(
    run: &RunFile,
    recorded: &TrialRecord,
    simulation: &Simulation,
    resolved: &ResolvedPlan,
) -> Result<Vec<String>, MishandleError> {
    let number = recorded.number;
    if number > MAX_TRIALS {
        let expected = falsification::derived_request(resolved, run, number, simulation.number)?;
        return Ok(match expected {
            Some(expected) => request_differences(simulation, &expected),
            None => vec![format!(
                "simulation {} of trial {number}: the plan has no such simulation",
                simulation.number
            )],
        });
    }
    let plan = resolved.plan.falsify.clone().unwrap_or_default();
    let Some(mut trial) = falsification::new_trial(resolved, number)? else {
        return Ok(vec![format!("trial {number}: the plan has no trial of this number")]);
    };
    let mut found = Vec::new();
    // A forged run can have a trial that the plan does not have.
    let planned = plan.trials;
    let foreign = run.trials()?.into_iter().map(|summary| summary.trial.number);
    found.extend(
        foreign
            .filter(|number| !(1..=planned).contains(number))
            .map(|number| format!("trial {number}: the plan has no trial of this number")),
    );
    found.extend(falsification::seed_difference(resolved, recorded));
    for simulation in run.trial_simulations(number) {
        let simulation = simulation?;
        let Some(expected) = trial.ask(1)?.pop() else {
            found.push(format!(
                "simulation {} of trial {number}: the trial ended before it",
                simulation.number
            ));
            return Ok(found);
        };
        let differences = request_differences(&simulation, &expected);
        if !differences.is_empty() {
            // The search would now propose other points.
            found.extend(differences);
            return Ok(found);
        }
        let simulation = with_needed_trace(run, simulation, plan.keep_going)?;
        let episode = match rows::episode(&simulation, resolved) {
            Ok(episode) => episode,
            Err(error) => {
                found.push(error.to_string());
                return Ok(found);
            }
        };
        if let Err(error) = trial.tell(&episode) {
            found.push(format!("simulation {} of trial {number}: {error}", simulation.number));
            return Ok(found);
        }
    }
    found.extend(status_difference(&mut trial, recorded)?);
    Ok(found)
}

/// Compares the status of a trial with its rows. A trial can have been killed before its end was
/// recorded.
fn status_difference(
    trial: &mut Trial<'_>,
    recorded: &TrialRecord,
) -> Result<Option<String>, FalsificationError> {
    if trial.outcome().end.is_none() {
        // A search that has ended proposes no point.
        trial.ask(1)?;
    }
    let expected = falsification::status(trial.outcome());
    let is_same = recorded.status == expected || recorded.status == TrialStatus::Running;
    Ok((!is_same).then(|| {
        format!("status of trial {}: recorded {:?}, expected {expected:?}", recorded.number, recorded.status)
    }))
}

/// Compares the numbers that identify a simulation with those of the expected request.
fn request_differences(recorded: &Simulation, expected: &Request) -> Vec<String> {
    let Simulation { trial, number, .. } = *recorded;
    let recorded = rows::request(recorded, expected.needs_parts);
    if (trial, number) != (expected.trial, expected.number) {
        let Request { trial: expected_trial, number: expected_number, .. } = expected;
        return vec![format!(
            "simulation {number} of trial {trial}: expected simulation {expected_number} of trial {expected_trial}; rows \
             are missing"
        )];
    }
    // The text of a float has all digits and the sign of a zero.
    let threshold = |request: &Request| {
        request.stop_threshold.map_or("none".to_string(), |threshold| format!("{threshold:?}"))
    };
    let parts = [
        ("seed", recorded.seed.0.to_string(), expected.seed.0.to_string()),
        ("stop threshold", threshold(&recorded), threshold(expected)),
        ("unit point", format!("{:?}", recorded.unit_point), format!("{:?}", expected.unit_point)),
        (
            "scenario",
            format!("{:?}", recorded.scenario.values()),
            format!("{:?}", expected.scenario.values()),
        ),
    ];
    parts
        .into_iter()
        .filter(|(_, recorded, expected)| recorded != expected)
        .map(|(part, recorded, expected)| {
            format!(
                "{part} of simulation {number} of trial {trial}: recorded {recorded}, expected {expected}"
            )
        })
        .collect()
}
