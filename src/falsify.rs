use std::ops::{ControlFlow, RangeInclusive};
use std::rc::Rc;

use mishandle_falsification::{
    Campaign, CampaignOutcome, CampaignSettings, KeepGoing, ScreenedCounts, Trial, TrialEnd, TrialOutcome,
};
use mishandle_rollout::{Axis, AxisValues, Screening, Seed, Space};
use mishandle_search::{
    Coordinate, SEARCHES, Search, SearchEntry, SearchError, SearchOptions, by_name, find_search,
};
use mishandle_stl::Trace;
use mishandle_store::{RunFile, RunWriter, Simulation, TrialRecord, TrialStatus};

use crate::explanation::violation_of;
use crate::record;
use crate::replay::header;
use crate::{FalsifyPlan, MishandleError, Plan, ResolvedPlan};

/// Searches for counterexamples and stores every simulation in `run`.
///
/// `run` is an open run file of the same plan. The simulations that it already contains are not repeated: the searches
/// get their recorded results. `watch` gets the progress after each batch and can stop the campaign.
///
/// # Errors
/// If the plan has no table `[falsify]`, `run` contains other simulations than the plan, or a simulation cannot be run
/// or stored.
pub fn falsify(
    resolved: &ResolvedPlan,
    mut run: RunWriter,
    mut watch: impl FnMut(&FalsifyProgress) -> ControlFlow<()>,
) -> Result<CampaignOutcome, MishandleError> {
    let ResolvedPlan { plan, space, .. } = resolved;
    let falsify = plan.falsify.as_ref().ok_or(MishandleError::MissingPlanTable { table: "falsify" })?;
    header::check(run.file().header(), resolved)?;
    let settings = settings(plan, falsify);
    let FalsifyPlan { trials, budget, .. } = *falsify;
    let mut campaign = Campaign::new(settings, space, new_search(falsify, space))?;
    if let Some(settings) = keep_going(resolved) {
        campaign = campaign.keep_going(settings);
    }
    let mut progress = FalsifyProgress {
        max_simulations: u64::from(trials) * u64::from(budget),
        ..FalsifyProgress::default()
    };
    for simulation in run.file().simulations() {
        let simulation = with_needed_trace(run.file(), simulation?, falsify)?;
        campaign.replay(&record::episode(&simulation, &resolved.target)?)?;
        progress.simulations += 1;
    }
    let mut started = vec![false; trials as usize];
    let recorded = campaign.outcome();
    for trial in run.file().trials()? {
        check_trial(resolved, &trial.trial, &recorded)?;
        // `replay` has already rejected simulations of trials that the plan does not have.
        if let Some(started) = started.get_mut((trial.trial.number as usize).wrapping_sub(1)) {
            *started = true;
        }
        if trial.trial.status != TrialStatus::Running {
            progress.ended += 1;
            progress.max_simulations -= u64::from(budget).saturating_sub(trial.counts.simulations);
        }
        progress.falsified += u32::from(trial.trial.status == TrialStatus::Falsified);
    }
    let mut system = resolved.system()?;
    let outcome = campaign.run(&mut *system, |batch| {
        for episode in batch.episodes {
            let trial = episode.request.trial;
            if !std::mem::replace(&mut started[trial as usize - 1], true) {
                run.start_trial(trial, settings.trial_seed(trial).0)?;
            }
        }
        let record = |episode| record::record(episode, resolved.stored_subformulas);
        run.record(&batch.episodes.iter().map(record).collect::<Vec<_>>())?;
        for trial in batch.ended {
            run.end_trial(trial.trial, status(trial))?;
            progress.ended += 1;
            progress.falsified += u32::from(trial.falsified());
        }
        progress.simulations += batch.episodes.len() as u64;
        progress.max_simulations -= batch.unspent(budget);
        Ok::<_, MishandleError>(watch(&progress))
    })?;
    // A search can end without another simulation, and a run can be killed between the last simulation of a trial and
    // the record of its end.
    for trial in &outcome.trials {
        let must_end = trial.end.is_some() && started[trial.trial as usize - 1];
        if must_end && run.file().trial(trial.trial)?.status == TrialStatus::Running {
            run.end_trial(trial.trial, status(trial))?;
        }
    }
    run.close()?;
    Ok(outcome)
}

/// Searches for counterexamples on a backend, without a run file: see [`Campaign::run_screened`]. Counterexamples are from the
/// target's own system.
///
/// # Errors
/// If the plan has no table `[falsify]`, its trials keep going, or a simulation cannot be run.
pub fn falsify_on_backend(
    resolved: &ResolvedPlan,
    screening: &mut Screening,
    sample_rate: f64,
    watch: &mut (dyn FnMut(&CampaignOutcome) -> ControlFlow<()> + Send),
) -> Result<(CampaignOutcome, ScreenedCounts), MishandleError> {
    let ResolvedPlan { plan, space, .. } = resolved;
    let falsify = plan.falsify.as_ref().ok_or(MishandleError::MissingPlanTable { table: "falsify" })?;
    let mut campaign = Campaign::new(settings(plan, falsify), space, new_search(falsify, space))?;
    if let Some(settings) = keep_going(resolved) {
        campaign = campaign.keep_going(settings);
    }
    Ok(campaign.run_screened(screening, &mut *resolved.system()?, sample_rate, watch)?)
}

fn settings(plan: &Plan, falsify: &FalsifyPlan) -> CampaignSettings {
    let FalsifyPlan { trials, budget, batch, early_stopping, .. } = *falsify;
    CampaignSettings { trials, budget, seed: Seed(plan.seed), batch: batch as usize, early_stopping }
}

/// Progress of a falsification campaign.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FalsifyProgress {
    /// Number of finished simulations.
    pub simulations: u64,
    /// Total number of simulations if all running trials spend their budgets.
    pub max_simulations: u64,
    /// Number of finished trials.
    pub ended: u32,
    /// Number of trials that found a counterexample.
    pub falsified: u32,
}

/// Checks seed and status of a recorded trial against the recorded simulations.
fn check_trial(
    resolved: &ResolvedPlan,
    trial: &TrialRecord,
    recorded: &CampaignOutcome,
) -> Result<(), MishandleError> {
    let mut differences: Vec<String> = seed_difference(resolved, trial).into_iter().collect();
    let outcome = recorded.trials.iter().find(|outcome| outcome.trial == trial.number);
    let expected = outcome.map_or(TrialStatus::Running, status);
    // The process can have been killed before it recorded the end, and a search can end without another simulation.
    let ended_between = |status: TrialStatus| match status {
        TrialStatus::Converged => true,
        TrialStatus::Falsified => outcome.is_some_and(TrialOutcome::falsified),
        _ => false,
    };
    let is_consistent = match trial.status {
        TrialStatus::Running => true,
        recorded if expected == TrialStatus::Running => ended_between(recorded),
        recorded => recorded == expected,
    };
    if !is_consistent {
        differences.push(format!(
            "status of trial {}: recorded {:?}, expected {expected:?}",
            trial.number, trial.status
        ));
    }
    if differences.is_empty() { Ok(()) } else { Err(MishandleError::RunMismatch { differences }) }
}

/// Describes the difference between the recorded seed of a trial and the seed that the plan gives it.
pub(crate) fn seed_difference(resolved: &ResolvedPlan, trial: &TrialRecord) -> Option<String> {
    let TrialRecord { number, seed, .. } = *trial;
    let settings = CampaignSettings { seed: Seed(resolved.plan.seed), ..CampaignSettings::default() };
    let Some(expected) = (number > 0).then(|| settings.trial_seed(number).0) else {
        return Some("trial 0: trials are numbered from 1".to_string());
    };
    (seed != expected).then(|| format!("seed of trial {number}: recorded {seed}, expected {expected}"))
}

/// Returns trial `number` of the plan before its first simulation; `None` if the plan has no such trial.
pub(crate) fn new_trial(
    resolved: &ResolvedPlan,
    number: u32,
) -> Result<Option<Trial<'static>>, MishandleError> {
    let ResolvedPlan { plan, space, .. } = resolved;
    let Some(falsify) = plan.falsify.as_ref().filter(|falsify| (1..=falsify.trials).contains(&number)) else {
        return Ok(None);
    };
    let settings = CampaignSettings { seed: Seed(plan.seed), ..CampaignSettings::default() };
    let seed = settings.trial_seed(number);
    let make = Rc::new(new_search(falsify, space));
    let trial = Trial::new(number, seed, falsify.budget, space.clone(), make)?;
    let trial = trial.with_early_stopping(falsify.early_stopping);
    Ok(Some(match keep_going(resolved) {
        Some(settings) => trial.keep_going(settings),
        None => trial,
    }))
}

/// Returns the function that makes a search of the plan from its seed.
fn new_search(
    falsify: &FalsifyPlan,
    space: &Space,
) -> impl Fn(u64) -> Result<Box<dyn Search>, SearchError> + 'static {
    let (name, coordinates, options) = (falsify.search.clone(), coordinates(space), search_options(falsify));
    move |seed| by_name(&name, &coordinates, seed, &options)
}

/// Returns the settings of trials that continue after a violation; `None` if they do not.
fn keep_going(resolved: &ResolvedPlan) -> Option<KeepGoing<'static>> {
    let falsify = resolved.plan.falsify.as_ref().filter(|falsify| falsify.keep_going)?;
    let (formula, control_dt) = (resolved.specification.requirement.clone(), resolved.target.control_dt);
    let signature =
        move |trace: &Trace| violation_of(&formula, trace, control_dt).map(|violation| violation.signature);
    Some(KeepGoing {
        signature: Rc::new(signature),
        episode_steps: resolved.target.episode_steps,
        new_mode_rate: falsify.new_mode_rate,
    })
}

/// Returns a recorded simulation, with its trace if the failure mode matters to the search.
pub(crate) fn with_needed_trace(
    run: &RunFile,
    recorded: Simulation,
    falsify: &FalsifyPlan,
) -> Result<Simulation, MishandleError> {
    if falsify.keep_going && recorded.robustness.is_some_and(|rho| rho < 0.0) {
        return Ok(run.simulation(recorded.trial, recorded.number)?);
    }
    Ok(recorded)
}

/// Returns an upper bound of the failure rate in the space if no simulation fails, with 95 % confidence: see
/// [`CampaignOutcome::failure_rate_bound`]. `None` unless the search draws independent uniform samples, because the points of other
/// searches are no random sample.
pub fn failure_rate_bound(resolved: &ResolvedPlan, outcome: &CampaignOutcome) -> Option<f64> {
    let falsify = resolved.plan.falsify.as_ref()?;
    let search = by_name(&falsify.search, &coordinates(&resolved.space), 0, &search_options(falsify)).ok()?;
    outcome.failure_rate_bound().filter(|_| search.samples_uniformly())
}

/// Returns the recorded status of a trial.
pub(crate) fn status(trial: &TrialOutcome) -> TrialStatus {
    match trial.end {
        None => TrialStatus::Running,
        Some(_) if trial.falsified() => TrialStatus::Falsified,
        Some(TrialEnd::SearchEnded(_)) => TrialStatus::Converged,
        Some(_) => TrialStatus::BudgetSpent,
    }
}

/// Checks a batch size.
pub(crate) fn check_batch(batch: u32) -> Result<(), MishandleError> {
    if Plan::BATCH.contains(&batch.into()) {
        return Ok(());
    }
    let (what, expected) = ("the batch size", "from 1 to 65536");
    Err(MishandleError::InvalidValue { what, value: batch.to_string(), expected })
}

/// Checks the falsification settings of a plan against its space, and returns whether the search needs the minima of
/// sub-formulas.
///
/// # Errors
/// If a number is out of its range, or the search or one of its options is unknown or invalid.
pub fn check_falsify(falsify: &FalsifyPlan, space: &Space) -> Result<bool, MishandleError> {
    check_batch(falsify.batch)?;
    let numbers = [
        ("the number of trials", falsify.trials, Plan::TRIALS),
        ("the budget", falsify.budget, Plan::BUDGET),
    ];
    let is_outside = |(_, value, range): &(_, u32, RangeInclusive<u64>)| !range.contains(&(*value).into());
    if let Some((what, value, _)) = numbers.into_iter().find(is_outside) {
        let expected = "from 1 to 1000000";
        return Err(MishandleError::InvalidValue { what, value: value.to_string(), expected });
    }
    if !(0.0..1.0).contains(&falsify.new_mode_rate) {
        let (what, expected) = ("the rate of new failure modes", "from 0 to less than 1");
        return Err(MishandleError::InvalidValue {
            what,
            value: falsify.new_mode_rate.to_string(),
            expected,
        });
    }
    search_entry(&falsify.search)?;
    let search = by_name(&falsify.search, &coordinates(space), 0, &search_options(falsify))?;
    Ok(search.needs_subformulas())
}

/// Returns the search with the name `name` and its options.
///
/// # Errors
/// If the name is unknown; the message lists the known searches.
pub fn search_entry(name: &str) -> Result<&'static SearchEntry, MishandleError> {
    find_search(name).map_err(|_| MishandleError::UnknownName {
        kind: "search",
        name: name.to_string(),
        known: SEARCHES.iter().map(|entry| entry.name.to_string()).collect(),
    })
}

/// Returns the type of each coordinate of the search.
fn coordinates(space: &Space) -> Vec<Coordinate> {
    space.axes().iter().map(coordinate).collect()
}

/// Returns the type of the coordinate of an axis.
pub(crate) fn coordinate(axis: &Axis) -> Coordinate {
    match (&axis.values, axis.levels()) {
        _ if axis.is_fixed() => Coordinate::Integer { levels: 1 },
        (AxisValues::Categorical(_), Some(levels)) => Coordinate::Categorical { levels },
        (_, Some(levels)) => Coordinate::Integer { levels },
        (_, None) => Coordinate::Continuous,
    }
}

/// Returns the options of the plan, completed by the defaults that depend on the plan.
fn search_options(falsify: &FalsifyPlan) -> SearchOptions {
    let mut options = falsify.options.clone();
    let specs = find_search(&falsify.search).map(|entry| (entry.options)()).unwrap_or_default();
    // As in SciPy, a maximum number of evaluations is then the only limit.
    if specs.iter().any(|spec| spec.name == "max-evaluations") && options.get("max-evaluations").is_none() {
        options.set("max-evaluations", falsify.budget);
    }
    options
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane() -> Space {
        Space::new("starts", vec![Axis::start("x", "m", 0.0, 1.0), Axis::start("y", "m", 0.0, 1.0)]).unwrap()
    }

    #[test]
    fn the_budget_limits_evaluations_unless_the_plan_sets_a_limit() {
        let plan = |search: &str| FalsifyPlan { search: search.to_string(), ..FalsifyPlan::default() };
        assert_eq!(search_options(&plan("nelder-mead")), SearchOptions::new().with("max-evaluations", 300));
        let own = SearchOptions::new().with("max-evaluations", 7);
        assert_eq!(search_options(&FalsifyPlan { options: own.clone(), ..plan("nelder-mead") }), own);
        for search in ["random", "dual-annealing"] {
            assert!(search_options(&plan(search)).is_empty(), "{search}");
        }
    }

    #[test]
    fn an_option_of_another_search_is_an_error() {
        let options = SearchOptions::new().with("xatol", 1e-6);
        let plan = FalsifyPlan { search: "dual-annealing".to_string(), options, ..FalsifyPlan::default() };
        let error = check_falsify(&plan, &plane()).unwrap_err();
        assert!(error.to_string().contains("dual-annealing has no option `xatol`"), "{error}");
    }
}
