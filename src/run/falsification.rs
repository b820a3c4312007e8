use std::ops::ControlFlow;
use std::rc::Rc;

use mishandle_falsification::{
    Falsification, FalsificationOutcome, FalsificationSettings, KeepGoing, Trial, TrialEnd, TrialOutcome,
    isolate, isolation_budget,
};
use mishandle_results as results;
use mishandle_results::Answer;
use mishandle_rollout::{Episode, Request, Seed};
use mishandle_search::SearchEnd;
use mishandle_stl::Trace;
use mishandle_store::{MAX_TRIALS, RunFile, TrialRecord, TrialStatus, TrialSummary};

use crate::error::{Compared, MishandleError, RunError};
use crate::plan::{FalsifyPlan, Plan, ScreeningPlan};
use crate::resolve::search::new_search;
use crate::resolve::{self, ResolvedPlan};
use crate::run::ask::{Found, Progress, Watch};
use crate::run::facts::Facts;
use crate::run::journal::{Journal, Numbering};
use crate::run::result::falsification_result;
use crate::run::violation::violation_of;
use crate::run::{has_random_rows, rows, unfinished};

/// Searches for counterexamples. The recorded simulations are not repeated: the searches get their
/// results. `watch` gets the progress after each batch.
pub(super) fn ask(journal: &Journal<'_>, watch: Watch<'_>) -> Result<Found, MishandleError> {
    let resolved = journal.resolved();
    let ResolvedPlan { plan, space, search_space, .. } = resolved;
    let falsify = plan.falsify.as_ref().ok_or(MishandleError::MissingPlanTable { table: "falsify" })?;
    if let Some(screening) = &plan.screening {
        return screened(journal, falsify, screening, watch);
    }
    let FalsifyPlan { trials, budget, .. } = *falsify;
    let mut campaign = Falsification::new(settings(plan, falsify), space, new_search(falsify, search_space))?;
    if let Some(settings) = keep_going(resolved) {
        campaign = campaign.keep_going(settings);
    }
    let mut progress =
        Progress { max_simulations: u64::from(trials) * u64::from(budget), ..Progress::default() };
    journal.rows(None, |episode| {
        progress.simulations += 1;
        Ok(campaign.replay(episode)?)
    })?;
    let recorded = journal.read(RunFile::trials)?;
    if journal.is_read_only() {
        // A search can end without another simulation.
        for trial in recorded.iter().filter(|trial| trial.trial.status != TrialStatus::Running) {
            campaign.settle(trial.trial.number)?;
        }
    }
    let mut outcome = campaign.outcome();
    for TrialSummary { trial, counts, .. } in &recorded {
        check_trial(resolved, trial, &outcome, journal.is_read_only())?;
        if trial.status != TrialStatus::Running {
            progress.ended += 1;
            progress.max_simulations -= u64::from(budget).saturating_sub(counts.simulations);
        }
        progress.falsified += u32::from(trial.status == TrialStatus::Falsified);
    }
    if !journal.is_read_only() {
        let found = campaign.run(&mut journal.deferred(), |batch| {
            journal.keep(batch.episodes, &ended(batch.ended))?;
            progress.ended += batch.ended.len() as u32;
            progress.falsified += batch.ended.iter().filter(|trial| trial.falsified()).count() as u32;
            progress.simulations += batch.episodes.len() as u64;
            progress.max_simulations -= batch.unspent(budget);
            Ok::<_, MishandleError>(watch(&progress))
        });
        outcome = journal.result(found)?;
        // A search can end without another simulation, and a run can be killed between the last
        // simulation of a trial and the record of its end.
        let mut ended = ended(&outcome.trials);
        ended.retain(|(trial, _)| journal.is_started(*trial));
        journal.set_ended(&ended)?;
    }
    let planned = outcome.trials.iter().filter(|trial| trial.end.is_some()).count() == trials as usize;
    outcome.is_interrupted = !planned;
    let mut derived = Vec::new();
    if falsify.isolate == Some(true) && planned {
        let (ended, is_complete) = isolate_counterexamples(journal, &outcome, &mut |done| {
            watch(&Progress { simulations: progress.simulations + done, ..progress })
        })?;
        derived = ended;
        outcome.is_interrupted = !is_complete;
    }
    let answer = results::Falsification {
        failure_rate_bound: failure_rate_bound(resolved, &outcome),
        ..falsification_result(&Facts::of(resolved), &outcome, None, &journal.path())
    };
    Ok(Found { answer: Answer::Falsification(Box::new(answer)), ended: derived, is_checked: true })
}

/// Moves the counterexample of each trial toward nominal. The simulations are trials of their own:
/// see [`MAX_TRIALS`]. Returns those that came to their end, and whether all of them did.
fn isolate_counterexamples(
    journal: &Journal<'_>,
    outcome: &FalsificationOutcome,
    watch: &mut dyn FnMut(u64) -> ControlFlow<()>,
) -> Result<(Vec<(u32, TrialStatus)>, bool), MishandleError> {
    let mut ended = Vec::new();
    let mut done = 0;
    for trial in outcome.trials.iter().filter(|trial| trial.falsified()) {
        let failure = journal.read(|run| first_failure(journal.resolved(), run, trial.trial))?;
        let Some(failure) = failure else { continue };
        let mut own = 0;
        let found = isolate_failure(journal, &failure, |count| {
            own = count;
            watch(done + count)
        });
        // The answer of an interrupted run.
        if journal.is_missing() || !journal.result(found)? {
            return Ok((ended, false));
        }
        done += own;
        ended.push((trial.trial + MAX_TRIALS, TrialStatus::BudgetSpent));
    }
    Ok((ended, true))
}

/// Returns the first recorded failure of a trial.
fn first_failure(
    resolved: &ResolvedPlan,
    run: &RunFile,
    trial: u32,
) -> Result<Option<Episode>, MishandleError> {
    for simulation in run.trial_simulations(trial) {
        let simulation = simulation?;
        if simulation.is_violated() {
            return rows::episode(&simulation, resolved).map(Some);
        }
    }
    Ok(None)
}

fn isolate_failure(
    journal: &Journal<'_>,
    failure: &Episode,
    watch: impl FnMut(u64) -> ControlFlow<()>,
) -> Result<bool, MishandleError> {
    let resolved = journal.resolved();
    let trial = failure.request.trial + MAX_TRIALS;
    let budget = isolation_budget(resolved.plan.falsify.as_ref().map_or(0, |falsify| falsify.budget));
    let is_random = resolve::space_depends_on_seed(resolved);
    let mut system = journal.system(Some(Numbering { trial, last: 0 }));
    Ok(isolate(&mut system, failure, budget, is_random, watch)?)
}

/// Returns the request of a simulation that moves a counterexample toward nominal; `None` if the
/// plan has no such simulation.
pub(crate) fn derived_request(
    resolved: &ResolvedPlan,
    run: &RunFile,
    trial: u32,
    number: u32,
) -> Result<Option<Request>, MishandleError> {
    let Some(failure) = first_failure(resolved, run, trial - MAX_TRIALS)? else { return Ok(None) };
    let journal = Journal::until(resolved, run, (trial, number));
    let end = isolate_failure(&journal, &failure, |_| ControlFlow::Continue(()));
    match (journal.found(), end) {
        (Some(request), _) => Ok(Some(request)),
        (None, Err(error @ MishandleError::Run(RunError::OtherRequest { .. }))) => Err(error),
        _ => Ok(None),
    }
}

/// Searches for counterexamples by screening: see [`Falsification::run_screened`]. Counterexamples
/// are from the target's own system.
fn screened(
    journal: &Journal<'_>,
    falsify: &FalsifyPlan,
    screening: &ScreeningPlan,
    watch: Watch<'_>,
) -> Result<Found, MishandleError> {
    let resolved = journal.resolved();
    let ResolvedPlan { plan, space, search_space, .. } = resolved;
    let max_simulations = u64::from(falsify.trials) * u64::from(falsify.budget);
    let mut campaign = Falsification::new(settings(plan, falsify), space, new_search(falsify, search_space))?;
    let mut watch = |outcome: &FalsificationOutcome| {
        watch(&Progress {
            simulations: outcome.simulations,
            max_simulations,
            ended: outcome.trials.iter().filter(|trial| trial.end.is_some()).count() as u32,
            falsified: outcome.falsified_trials,
        })
    };
    let mut screen = journal.screening();
    let found = campaign.run_screened(&mut screen, &mut journal.system(None), screening.confirm, &mut watch);
    let (outcome, counts) = journal.result(found)?;
    let answer = falsification_result(&Facts::of(resolved), &outcome, Some(&counts), &journal.path());
    let answer = Answer::Falsification(Box::new(answer));
    Ok(Found { answer, ended: ended(&outcome.trials), is_checked: false })
}

/// Returns the answer of a recorded falsification without screening, from its file alone. No row is
/// compared with what the searches propose, and the recorded statuses say how trials ended.
pub(super) fn recorded(run: &RunFile, facts: &Facts) -> Result<Answer, MishandleError> {
    let falsify = facts.plan.falsify.clone().unwrap_or_default();
    let mut trials: Vec<TrialOutcome> = Vec::new();
    let mut statuses = Vec::new();
    for TrialSummary { trial, .. } in run.trials()? {
        trials.push(TrialOutcome::new(trial.number, Seed(trial.seed)));
        statuses.push(trial.status);
    }
    for row in run.simulations() {
        let row = row?;
        if let Ok(place) = trials.binary_search_by_key(&row.trial, |trial| trial.trial) {
            trials[place].add(&rows::recorded_episode(&row));
        }
    }
    for (trial, status) in trials.iter_mut().zip(statuses) {
        trial.end = recorded_end(trial, status, &falsify);
    }
    let mut outcome = FalsificationOutcome::new(trials, falsify.budget);
    outcome.is_interrupted = unfinished(run)?.is_some();
    let is_random = has_random_rows(run.header()) && falsify.fixed_seed.is_none();
    let answer = results::Falsification {
        failure_rate_bound: outcome.failure_rate_bound().filter(|_| is_random),
        ..falsification_result(facts, &outcome, None, run.path())
    };
    Ok(Answer::Falsification(Box::new(answer)))
}

/// Returns how a recorded trial ended, as far as its status says. A trial that keeps going and
/// found a violation can also have ended with its search.
fn recorded_end(trial: &TrialOutcome, status: TrialStatus, falsify: &FalsifyPlan) -> Option<TrialEnd> {
    match status {
        TrialStatus::Running => None,
        TrialStatus::Converged => Some(TrialEnd::SearchEnded(SearchEnd::Converged)),
        TrialStatus::Falsified if !falsify.keep_going => Some(TrialEnd::Falsified),
        _ if trial.simulations < falsify.budget => Some(TrialEnd::ModesDriedUp),
        _ => Some(TrialEnd::BudgetSpent),
    }
}

fn settings(plan: &Plan, falsify: &FalsifyPlan) -> FalsificationSettings {
    let FalsifyPlan { trials, budget, batch, fixed_seed, early_stopping, .. } = *falsify;
    FalsificationSettings {
        trials,
        budget,
        seed: Seed(plan.seed),
        batch: batch as usize,
        fixed_seed: fixed_seed.map(Seed),
        early_stopping,
    }
}

/// Checks seed and status of a recorded trial against the recorded simulations, after which the
/// searches that end without another one have ended if the outcome `is_settled`.
fn check_trial(
    resolved: &ResolvedPlan,
    trial: &TrialRecord,
    recorded: &FalsificationOutcome,
    is_settled: bool,
) -> Result<(), MishandleError> {
    let mut differences: Vec<String> = seed_difference(resolved, trial).into_iter().collect();
    let outcome = recorded.trials.iter().find(|outcome| outcome.trial == trial.number);
    let expected = outcome.map_or(TrialStatus::Running, status);
    // The process can have been killed before it recorded the end, and a search can end without
    // another simulation.
    let ended_between = |status: TrialStatus| match status {
        TrialStatus::Converged => !is_settled,
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
    if differences.is_empty() { Ok(()) } else { Err(MishandleError::differs(Compared::Plan, differences)) }
}

/// Describes the difference between the recorded seed of a trial and the seed that the plan gives
/// it.
pub(crate) fn seed_difference(resolved: &ResolvedPlan, trial: &TrialRecord) -> Option<String> {
    let TrialRecord { number, seed, .. } = *trial;
    if number == 0 {
        return Some("trial 0: trials are numbered from 1".to_string());
    }
    let expected = resolved.trial_seed(number);
    (seed != expected).then(|| format!("seed of trial {number}: recorded {seed}, expected {expected}"))
}

/// Returns trial `number` of the plan before its first simulation; `None` if the plan has no such
/// trial.
pub(crate) fn new_trial(
    resolved: &ResolvedPlan,
    number: u32,
) -> Result<Option<Trial<'static>>, MishandleError> {
    let ResolvedPlan { plan, space, search_space, .. } = resolved;
    let Some(falsify) = plan.falsify.as_ref().filter(|falsify| (1..=falsify.trials).contains(&number)) else {
        return Ok(None);
    };
    let make = Rc::new(new_search(falsify, search_space));
    let trial = Trial::new(number, &settings(plan, falsify), space.clone(), make)?;
    Ok(Some(match keep_going(resolved) {
        Some(settings) => trial.keep_going(settings),
        None => trial,
    }))
}

/// Returns the settings of trials that continue after a violation; `None` if they do not.
fn keep_going(resolved: &ResolvedPlan) -> Option<KeepGoing<'static>> {
    let falsify = resolved.plan.falsify.as_ref().filter(|falsify| falsify.keep_going)?;
    let formula = resolved.specification.requirement.clone();
    let control_dt = resolved.target.control_dt;
    let signature =
        move |trace: &Trace| violation_of(&formula, trace, control_dt).map(|violation| violation.signature);
    Some(KeepGoing {
        signature: Rc::new(signature),
        episode_steps: resolved.target.episode_steps,
        new_mode_rate: falsify.new_mode_rate,
    })
}

/// Returns an upper bound of the failure rate in the space if no simulation fails, with 95 %
/// confidence: see [`FalsificationOutcome::failure_rate_bound`]. `None` unless the search draws
/// independent uniform samples, because the points of other searches are not a random sample, or if
/// a random target has the same seed in all of them.
fn failure_rate_bound(resolved: &ResolvedPlan, outcome: &FalsificationOutcome) -> Option<f64> {
    let falsify = resolved.plan.falsify.as_ref()?;
    let search = new_search(falsify, &resolved.search_space)(0).ok()?;
    let is_one_draw = falsify.fixed_seed.is_some() && resolve::space_depends_on_seed(resolved);
    outcome.failure_rate_bound().filter(|_| search.samples_uniformly() && !is_one_draw)
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

/// Returns the trials that have ended, with their statuses.
fn ended(trials: &[TrialOutcome]) -> Vec<(u32, TrialStatus)> {
    let ended = trials.iter().filter(|trial| trial.end.is_some());
    ended.map(|trial| (trial.trial, status(trial))).collect()
}
