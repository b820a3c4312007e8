use std::ops::ControlFlow;

use mishandle_falsification::{Campaign, Outcome, Recorded, Settings, TrialEnd};
use mishandle_rollout::{Environment, Seed};
use mishandle_search::{SEARCHES, Search, SearchError, SearchOptions, by_name};
use mishandle_store::{RunWriter, TrialStatus};

use crate::record::{self, Place};
use crate::{FalsifyPlan, MishandleError, Plan, Subject};

/// Most trials of a campaign, and most simulations of a trial: each trial takes some memory from the start.
const MOST: u32 = 1_000_000;

/// Trials are counted from 1 on screen and in run files, from 0 in a campaign.
fn shown(trial: u32) -> u32 {
    trial + 1
}

/// Searches for counterexamples as `plan` says, and stores every simulation in `run`, an open run file of that plan:
/// those it holds already are not run again. `watch` is told how things stand after each batch, and may stop.
///
/// # Errors
/// If the plan has nothing to falsify, or a simulation cannot be run or stored.
pub fn falsify(
    plan: &Plan,
    subject: &Subject,
    mut run: RunWriter,
    mut watch: impl FnMut(&Progress) -> ControlFlow<()>,
) -> Result<Outcome, MishandleError> {
    let falsify = plan.falsify.as_ref().ok_or(MishandleError::OtherPlan { wanted: "falsify" })?;
    let settings = Settings { trials: falsify.trials, budget: falsify.budget, seed: Seed(plan.seed) };
    let initial_box = subject.environment.initial_box();
    let dimension = initial_box.dimension();
    let make = |seed| make(falsify, dimension, seed);
    let mut campaign = Campaign::new(settings, initial_box, make)?;
    let mut progress =
        Progress { most: u64::from(falsify.trials) * u64::from(falsify.budget), ..Progress::default() };
    for simulation in run.file().simulations() {
        let simulation = simulation?;
        campaign.replay(&Recorded {
            trial: simulation.trial.saturating_sub(1),
            number: simulation.number,
            unit_point: &simulation.unit_point,
            initial_configuration: &simulation.initial_configuration,
            seed: record::seed(&simulation),
            robustness: simulation.robustness,
            end: record::end(&simulation),
        })?;
        progress.simulations += 1;
    }
    let mut begun = vec![false; falsify.trials as usize];
    for trial in run.file().trials()? {
        // A number past the plan's trials cannot come this far: the campaign has refused its simulations.
        if let Some(begun) = begun.get_mut((trial.trial.number as usize).wrapping_sub(1)) {
            *begun = true;
        }
        if trial.trial.status != TrialStatus::Running {
            progress.ended += 1;
            progress.most -= u64::from(falsify.budget).saturating_sub(trial.counts.simulations);
        }
        progress.falsified += u32::from(trial.trial.status == TrialStatus::Falsified);
    }
    let mut system = subject.system()?;
    let outcome = campaign.run(&mut system, |simulations| {
        for simulation in simulations {
            if !std::mem::replace(&mut begun[simulation.trial as usize], true) {
                run.start_trial(shown(simulation.trial), simulation.trial_seed.0)?;
            }
        }
        let records: Vec<_> = simulations
            .iter()
            .map(|simulation| {
                let place = Place {
                    trial: shown(simulation.trial),
                    number: simulation.number,
                    unit_point: simulation.unit_point,
                };
                record::record(&place, simulation.episode)
            })
            .collect();
        run.record(&records)?;
        for simulation in simulations {
            if let Some(end) = simulation.trial_end {
                run.end_trial(shown(simulation.trial), status(end))?;
                progress.ended += 1;
                progress.most -= u64::from(falsify.budget - simulation.number);
                progress.falsified += u32::from(end == TrialEnd::Falsified);
            }
        }
        progress.simulations += simulations.len() as u64;
        Ok::<_, MishandleError>(watch(&progress))
    })?;
    // A search may end without another simulation, and a run may have been killed between its last simulation and the
    // end of its trial.
    for trial in &outcome.trials {
        let number = shown(trial.trial);
        let Some(end) = trial.end else { continue };
        if begun[trial.trial as usize] && run.file().trial(number)?.status == TrialStatus::Running {
            run.end_trial(number, status(end))?;
        }
    }
    run.close()?;
    Ok(outcome)
}

/// How a falsification stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Progress {
    /// Simulations so far.
    pub simulations: u64,
    /// Simulations there will be if no further trial ends before its budget is spent.
    pub most: u64,
    /// Trials that have ended.
    pub ended: u32,
    /// Trials that have found a counterexample.
    pub falsified: u32,
}

fn status(end: TrialEnd) -> TrialStatus {
    match end {
        TrialEnd::Falsified => TrialStatus::Falsified,
        TrialEnd::BudgetSpent => TrialStatus::BudgetSpent,
        TrialEnd::SearchEnded(_) => TrialStatus::Converged,
    }
}

/// Checks all that a falsification is asked to do, for a box with this number of axes.
pub(crate) fn check(falsify: &FalsifyPlan, dimension: usize) -> Result<(), MishandleError> {
    let numbers = [("the number of trials", falsify.trials), ("the budget", falsify.budget)];
    if let Some((what, value)) = numbers.into_iter().find(|(_, value)| !(1..=MOST).contains(value)) {
        return Err(MishandleError::Value { what, value: value.to_string(), wanted: "from 1 to 1000000" });
    }
    if !SEARCHES.iter().any(|entry| entry.name == falsify.search) {
        return Err(MishandleError::Name {
            kind: "search",
            name: falsify.search.clone(),
            known: SEARCHES.iter().map(|entry| entry.name.to_string()).collect(),
        });
    }
    make(falsify, dimension, 0)?;
    Ok(())
}

/// The search of a trial.
fn make(falsify: &FalsifyPlan, dimension: usize, seed: u64) -> Result<Box<dyn Search>, SearchError> {
    let mut options = SearchOptions::default();
    options.nelder_mead.initial_simplex.clone_from(&falsify.initial_simplex);
    // As SciPy does when it is told how many evaluations there are: they are the only limit.
    options.nelder_mead.max_evaluations = Some(falsify.budget as usize);
    by_name(&falsify.search, dimension, seed, &options)
}
