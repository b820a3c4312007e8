//! Parts of a plan run again, without a run file.

use std::ops::RangeInclusive;

use mishandle_rollout::Request;
use mishandle_store::{Simulation, TrialRecord};

use crate::error::MishandleError;
use crate::plan::Plan;
use crate::resolve::ResolvedPlan;
use crate::run::evaluation::with_requests;
use crate::run::falsification::{new_trial, status};
use crate::run::{rows, system_of};

/// Runs a trial of a falsification from its seed to its end. Returns its record and its
/// simulations, as a run file stores them;
/// `None` if the plan has no such trial.
///
/// # Errors
/// If the search or a simulation fails.
pub fn run_trial(
    resolved: &ResolvedPlan,
    number: u32,
) -> Result<Option<(TrialRecord, Vec<Simulation>)>, MishandleError> {
    let Some(mut trial) = new_trial(resolved, number)? else { return Ok(None) };
    let mut system = resolved.system()?;
    let mut simulations = Vec::new();
    while trial.outcome().end.is_none() {
        // A search that has ended proposes nothing.
        let requests = trial.ask(batch(&resolved.plan))?;
        for episode in system.rollout(&requests)? {
            trial.tell(&episode)?;
            simulations.push(rows::row(&episode, resolved));
            // The other simulations of the batch are surplus, which a run drops.
            if trial.outcome().end.is_some() {
                break;
            }
        }
    }
    let record = TrialRecord { number, seed: resolved.trial_seed(number), status: status(trial.outcome()) };
    Ok(Some((record, simulations)))
}

/// Runs simulations of an evaluation, and returns them as a run file stores them. Numbers that the
/// plan does not have are left out.
///
/// # Errors
/// If the plan has no table `[evaluate]`, or a simulation cannot be run.
pub fn run_simulations(
    resolved: &ResolvedPlan,
    trial: u32,
    numbers: RangeInclusive<u32>,
) -> Result<Vec<Simulation>, MishandleError> {
    let requests: Vec<Request> = with_requests(resolved, |requests| {
        numbers.map_while(|number| requests.request(trial, number).transpose()).collect()
    })?;
    let (mut system, _) = system_of(resolved, trial)?;
    let mut simulations = Vec::with_capacity(requests.len());
    for batch in requests.chunks(batch(&resolved.plan)) {
        simulations.extend(system.rollout(batch)?.iter().map(|episode| rows::row(episode, resolved)));
    }
    Ok(simulations)
}

/// Returns the batch size of the plan. It does not affect the simulations.
fn batch(plan: &Plan) -> usize {
    let falsify = plan.falsify.as_ref().map(|falsify| falsify.batch);
    let evaluate = plan.evaluate.as_ref().map(|evaluate| evaluate.batch);
    falsify.or(evaluate).map_or(1, |batch| batch.max(1) as usize)
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;

    use mishandle_store::{RunFile, TrialStatus};

    use super::*;
    use crate::plan::{EvaluatePlan, FalsifyPlan};
    use crate::run::{Engine, ask, create_run};

    /// Runs a plan with a run file, and returns its trials with their simulations.
    fn recorded(resolved: &ResolvedPlan) -> Vec<(TrialRecord, Vec<Simulation>)> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.sqlite");
        let run = create_run(resolved, Some(&path)).unwrap();
        ask(resolved, run, Engine::Direct, &mut |_| ControlFlow::Continue(())).unwrap();
        let run = RunFile::open(&path).unwrap();
        let simulations = |trial: TrialRecord| {
            let found = run.trial_simulations(trial.number).collect::<Result<_, _>>().unwrap();
            (trial, found)
        };
        run.trials().unwrap().into_iter().map(|summary| simulations(summary.trial)).collect()
    }

    /// A list of recorded simulations has no traces.
    fn without_traces(mut simulations: Vec<Simulation>) -> Vec<Simulation> {
        simulations.iter_mut().for_each(|simulation| simulation.trace = None);
        simulations
    }

    #[test]
    fn a_trial_is_that_of_the_run_file() {
        let mut found = Vec::new();
        for (search, formula) in [
            ("random", "always(distance >= 0.1)"),
            ("nelder-mead", "always(distance >= 0.02)"),
            ("nelder-mead", "always(distance >= -1)"),
        ] {
            let plan = FalsifyPlan {
                search: search.to_string(),
                formula: Some(formula.to_string()),
                trials: 3,
                budget: 150,
                batch: 7,
                ..FalsifyPlan::default()
            };
            let plan = Plan { falsify: Some(plan), seed: 5, ..Plan::new("toy/sphere-2d", "") };
            let resolved = ResolvedPlan::new(&plan).unwrap();
            let recorded = recorded(&resolved);
            assert_eq!(recorded.len(), 3);
            for (trial, simulations) in recorded {
                let again = run_trial(&resolved, trial.number).unwrap().unwrap();
                found.push(trial.status);
                assert_eq!((again.0, without_traces(again.1)), (trial, simulations), "{search} {formula}");
            }
            assert_eq!(run_trial(&resolved, 4).unwrap(), None);
        }
        let all = [TrialStatus::Falsified, TrialStatus::BudgetSpent, TrialStatus::Converged];
        assert!(all.iter().all(|status| found.contains(status)), "{found:?}");
    }

    #[test]
    fn simulations_of_an_evaluation_are_those_of_the_run_file() {
        let evaluate = EvaluatePlan { episodes: 12, batch: 5, ..EvaluatePlan::default() };
        let plan = Plan { evaluate: Some(evaluate), seed: 3, ..Plan::new("toy/noisy", "") };
        let resolved = ResolvedPlan::new(&plan).unwrap();
        let recorded = recorded(&resolved);
        assert_eq!(recorded.len(), 2);
        for (trial, expected) in recorded {
            let again = |numbers| without_traces(run_simulations(&resolved, trial.number, numbers).unwrap());
            assert_eq!(again(4..=9), expected[3..9], "trial {}", trial.number);
            assert_eq!(again(11..=u32::MAX), expected[10..]);
        }
    }
}
