mod modes;
mod screened;

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Result, bail};
use clap::Args;
use mishandle::evaluation::{NotSmooth, RepeatReport, SmoothRegion};
use mishandle::falsification::{CampaignOutcome, Minimum, ScreenedCounts, TrialEnd, TrialOutcome};
use mishandle::inspect::ModeSurvey;
use mishandle::plan::FalsifyPlan;
use mishandle::run::{Answer, Device};
use mishandle::search::OptionValue;
use mishandle::store::{RunFile, RunHeader, RunKind};
use mishandle::{MishandleError, Plan, ResolvedPlan};
use mishandle_text::{decimal, plural};
use serde_json::{Value, json};

use super::simulate;
use crate::output::{self, number};
use crate::progress::Bar;
use crate::{ExitStatus, args, numbers, question, run};

/// Search for counterexamples: scenarios in which a target violates a formula
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle falsify ball-balancing --controller ppo --search random
  mishandle falsify ball-balancing --controller ppo --search dual-annealing --formula strict
  mishandle falsify ball-balancing --controller ppo --formula 'always[50:300](ball_speed <= 0.5)'
  mishandle falsify ball-balancing --controller ppo --space events
  mishandle falsify toy/car-following --space events+dynamics
  mishandle falsify ball-balancing --controller ppo --search nelder-mead --search-option xatol=1e-6
  mishandle falsify toy/pits --search portfolio --keep-going --trials 3 --budget 1000
  mishandle falsify --resume runs/RUN.sqlite

Exit code 1 means that a counterexample was found.")]
pub struct Arguments {
    #[command(flatten)]
    pub subject: args::Subject,
    /// Search algorithm, a name of `mishandle searches` [default: portfolio]
    #[arg(long, value_name = "S", conflicts_with = "resume")]
    pub search: Option<String>,
    /// Option of the search algorithm (repeatable); `mishandle searches SEARCH` lists them
    #[arg(long = "search-option", value_name = "NAME=VALUE", value_parser = name_and_value, conflicts_with = "resume")]
    pub search_options: Vec<(String, String)>,
    /// Requirement to violate: the name of a formula of the target (such as success or strict), or the text of a
    /// formula [default: the target's first formula, which is success for a task]
    #[arg(long, allow_hyphen_values = true, conflicts_with = "resume")]
    pub formula: Option<String>,
    /// Number of trials: independent searches, each with its own random seed [default: 30]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u32>(Plan::TRIALS))]
    #[arg(conflicts_with = "resume")]
    pub trials: Option<u32>,
    /// Largest number of simulations per trial [default: 300]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u32>(Plan::BUDGET))]
    #[arg(conflicts_with = "resume")]
    pub budget: Option<u32>,
    /// End simulations as soon as the search does not need the rest. The scenarios and violations are the same, but a trial
    /// without a violation can have a lower bound as lowest robustness
    #[arg(long, conflicts_with = "resume")]
    pub early_stopping: bool,
    /// Continue each trial after its first counterexample, to find other failure modes
    #[arg(long, conflicts_with = "resume")]
    pub keep_going: bool,
    /// With --keep-going, end a trial when less than this fraction of its simulations finds a new failure mode; 0 spends the
    /// whole budget [default: 0.01]
    #[arg(long, value_name = "RATE", allow_negative_numbers = true, conflicts_with = "resume")]
    pub new_mode_rate: Option<f64>,
    /// If the target is random: number of simulations of each counterexample with other seeds, which measure how often it
    /// fails; at most as many in total as the run has; 0 skips this [default: 100]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u32>(0..=10_000_000))]
    pub repeats: Option<u32>,
    #[command(flatten)]
    pub screen: args::Screen,
    #[command(flatten)]
    pub file: args::OpenRun,
    #[command(flatten)]
    pub run: args::Run,
}

/// Parses `NAME=VALUE`.
fn name_and_value(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, value)) if !name.trim().is_empty() => {
            Ok((name.trim().to_string(), value.trim().to_string()))
        }
        _ => Err("expected NAME=VALUE, such as xatol=1e-6".to_string()),
    }
}

pub fn run(command: &Arguments, gpu: Option<&Device>) -> Result<ExitStatus> {
    run::set_threads(command.run.threads)?;
    let asked = question::ask(RunKind::Falsify, &command.subject, &command.file, gpu, || plan(command))?;
    let resolved = &asked.resolved;
    let Answer::Falsification(found, screening) = &asked.answer else {
        bail!("the answer is that of another question");
    };
    report_unevaluated(resolved, found);
    let keeps_going = resolved.plan.falsify.as_ref().is_some_and(|falsify| falsify.keep_going);
    let path = Path::new(&asked.path);
    let survey = if keeps_going { Some(survey(path)?) } else { None };
    let is_complete = asked.answer.is_complete();
    let repeats = match is_complete {
        true => counterexample_repeats(resolved, found, command.repeats.unwrap_or(REPEATS))?,
        false => Repeats::new(),
    };
    let region =
        if is_complete && screening.is_none() { smooth_region(resolved, found, path)? } else { None };
    if command.run.json {
        let mut document = document(resolved, found, screening.as_ref(), &repeats, &asked.path);
        document["smooth_region"] = region.map_or(Value::Null, region_document);
        output::json(with_modes(document, survey.as_ref()))?;
    } else if is_complete || (screening.is_some() && found.simulations > 0) {
        let screened = screening.as_ref().map_or(String::new(), screened::text);
        let region = region.map_or(String::new(), region_text);
        output::line(&(text(resolved, found, &repeats) + &region + &screened))?;
        if let Some((header, survey)) = &survey {
            output::line(&modes::text(header, survey))?;
        }
    }
    if screening.is_some() {
        asked.report_screening(found.simulations, found.simulations - found.screened);
    }
    if is_complete && found.surplus > 0 {
        output::message(&format!(
            "discarded {} that ran in the same batch after the end of a trial or of its search",
            plural(found.surplus, "simulation")
        ));
    }
    if let Some(status) = asked.report_file() {
        return Ok(status);
    }
    // Exit status 0 would say that the search found no violation.
    anyhow::ensure!(
        found.trials.iter().any(|trial| trial.minimum.is_some()),
        "no simulation has a verdict, so the controller was not tested; the run file contains the end of each simulation"
    );
    if found.falsified_trials == 0 {
        return Ok(ExitStatus::Done);
    }
    output::message(&format!("Replay the first counterexample: mishandle replay {}", asked.name));
    Ok(ExitStatus::Violated)
}

/// Default number of repeated simulations of a counterexample.
const REPEATS: u32 = 100;

/// Fewest simulations of a counterexample with other seeds, unless fewer are requested. Fewer say little: of 20, none fails with a
/// probability of 36 % if 5 % do.
const FEWEST_REPEATS: u64 = 20;

/// Repeated simulations of counterexamples, by trial.
pub type Repeats = BTreeMap<u32, RepeatReport>;

/// Simulates each counterexample `repeats` times with other seeds; in total at most as often as the run has simulations, but each at
/// least [`FEWEST_REPEATS`] times.
/// Returns nothing for a target without randomness, whose counterexamples always fail.
fn counterexample_repeats(resolved: &ResolvedPlan, found: &CampaignOutcome, repeats: u32) -> Result<Repeats> {
    let counterexamples: Vec<(u32, &Minimum)> = found
        .trials
        .iter()
        .filter(|trial| trial.falsified())
        .filter_map(|trial| Some((trial.trial, trial.minimum.as_ref()?)))
        .filter(|(_, minimum)| mishandle::resolve::depends_on_seed(resolved, &minimum.scenario))
        .collect();
    let share = found.simulations / (counterexamples.len() as u64).max(1);
    let each = u64::from(repeats).min(share.max(FEWEST_REPEATS));
    if counterexamples.is_empty() || each == 0 {
        return Ok(Repeats::new());
    }
    let bar = Bar::new(each * counterexamples.len() as u64, "repeats");
    let mut system = resolved.system()?;
    let mut done = 0;
    let mut reports = Repeats::new();
    for (trial, minimum) in counterexamples {
        let seeds = mishandle::run::repeat_seeds(minimum.seed, each);
        let report = mishandle::run::repeat(&mut *system, &minimum.scenario, seeds, |_| {
            done += 1;
            bar.set_position(done);
            run::control_flow()
        })?;
        reports.insert(trial, report);
        if run::control_flow().is_break() {
            break;
        }
    }
    bar.clear();
    Ok(reports)
}

/// Returns the region that cannot fail if the robustness is smooth: see [`mishandle::inspect::smooth_region_of`].
fn smooth_region(
    resolved: &ResolvedPlan,
    found: &CampaignOutcome,
    path: &Path,
) -> Result<Option<Result<SmoothRegion, NotSmooth>>> {
    let run = RunFile::open(path).map_err(MishandleError::from)?;
    Ok(mishandle::inspect::smooth_region_of(resolved, found, &run)?)
}

fn region_text(region: Result<SmoothRegion, NotSmooth>) -> String {
    match region {
        Ok(SmoothRegion { covered, .. }) if covered < 0.01 => {
            "\nno statement about the space between the samples: they are too far apart for such steep changes of the robustness".into()
        }
        Ok(SmoothRegion { slope, covered, .. }) => format!(
            "\nif the samples missed no cliff, the robustness changes by at most {} per width of the space (estimate, 95 % confidence); then \
             no scenario in {:.0} % of the space fails",
            decimal(slope, 4),
            // A share that was measured at random points is never 100 %.
            (100.0 * covered).floor().min(99.0)
        ),
        Err(reason) => format!("\nno statement about the space between the samples: {reason}"),
    }
}

fn region_document(region: Result<SmoothRegion, NotSmooth>) -> Value {
    match region {
        Ok(SmoothRegion { slope, largest_slope, covered }) => {
            json!({ "slope": slope, "largest_slope": largest_slope, "covered": covered, "refusal": Value::Null })
        }
        Err(reason) => {
            json!({ "slope": Value::Null, "largest_slope": Value::Null, "covered": Value::Null, "refusal": reason.to_string() })
        }
    }
}

/// Returns whether all trials of the plan have ended.
pub fn is_complete(resolved: &ResolvedPlan, found: &CampaignOutcome) -> bool {
    let trials = resolved.plan.falsify.as_ref().map_or(0, |falsify| falsify.trials);
    found.trials.iter().filter(|trial| trial.end.is_some()).count() == trials as usize
}

fn plan(command: &Arguments) -> Result<Plan> {
    let mut plan = run::plan(&command.subject, &command.run)?;
    let mut falsify: FalsifyPlan = plan.falsify.take().unwrap_or_default();
    falsify.search = command.search.clone().unwrap_or(falsify.search);
    for (index, (name, value)) in command.search_options.iter().enumerate() {
        let earlier = &command.search_options[..index];
        anyhow::ensure!(
            earlier.iter().all(|(other, _)| other != name),
            "--search-option {name} is given twice; give it once"
        );
        let value = mishandle::plan::search_option_value(&falsify.search, name, value);
        falsify.options.set(name, value);
    }
    falsify.formula = command.formula.clone().or(falsify.formula);
    falsify.trials = command.trials.unwrap_or(falsify.trials);
    falsify.budget = command.budget.unwrap_or(falsify.budget);
    plan.screening = command.screen.plan(plan.screening.take())?;
    falsify.batch = command.subject.batch.unwrap_or(match &plan.screening {
        Some(screening) => screening.rows.min(*Plan::BATCH.end() as u32),
        None => falsify.batch,
    });
    falsify.early_stopping |= command.early_stopping;
    falsify.keep_going |= command.keep_going;
    anyhow::ensure!(
        falsify.keep_going || command.new_mode_rate.is_none(),
        "--new-mode-rate has no effect without --keep-going; give both"
    );
    falsify.new_mode_rate = command.new_mode_rate.unwrap_or(falsify.new_mode_rate);
    plan.falsify = Some(falsify);
    Ok(plan.only(RunKind::Falsify))
}

/// Returns the JSON document of the run.
pub fn document(
    resolved: &ResolvedPlan,
    found: &CampaignOutcome,
    screening: Option<&ScreenedCounts>,
    repeats: &Repeats,
    path: &str,
) -> Value {
    let document = output::joined(run::document(resolved, path), results(resolved, found, repeats));
    match screening {
        Some(counts) => output::joined(document, screened::document(found, counts)),
        None => document,
    }
}

fn results(resolved: &ResolvedPlan, found: &CampaignOutcome, repeats: &Repeats) -> Value {
    let falsify = resolved.plan.falsify.clone().unwrap_or_default();
    let trials: Vec<Value> = found
        .trials
        .iter()
        .map(|trial| {
            let repeated = repeats.get(&trial.trial).map(simulate::repeats_document);
            output::joined(trial_document(resolved, trial), json!({ "repeats": repeated }))
        })
        .collect();
    json!({
        "is_complete": is_complete(resolved, found),
        "search": falsify.search,
        "search_options": search_options(&falsify),
        "formula": resolved.specification.requirement.to_string(),
        "budget": falsify.budget,
        "batch": falsify.batch,
        "early_stopping": falsify.early_stopping,
        "control_steps": found.control_steps,
        "falsified_trials": found.falsified_trials,
        "falsification_rate": output::estimate(&found.falsification_rate),
        "mean_simulations": found.mean_simulations,
        "median_simulations": found.median_simulations,
        "restricted_mean_simulations": found.restricted_mean_simulations,
        "smooth_region": Value::Null,
        "failure_rate_bound": mishandle::run::failure_rate_bound(resolved, found),
        "trials": trials,
    })
}

/// Surveys the failure modes of a run file. Returns its header, too.
fn survey(path: &Path) -> Result<(RunHeader, ModeSurvey)> {
    let run = RunFile::open_unchecked(path)?;
    Ok((run.header().clone(), mishandle::inspect::mode_survey(&run)?))
}

/// Adds what a survey of the failure modes found to the document of a run.
fn with_modes(document: Value, survey: Option<&(RunHeader, ModeSurvey)>) -> Value {
    match survey {
        Some((header, survey)) => output::joined(document, modes::document(header, survey)),
        None => document,
    }
}

fn trial_document(resolved: &ResolvedPlan, trial: &TrialOutcome) -> Value {
    let minimum = trial.minimum.as_ref();
    json!({
        "trial": trial.trial,
        "falsified": trial.falsified(),
        "simulations": trial.simulations,
        "first_violation": trial.first_violation,
        "minimum_robustness": minimum.map_or(Value::Null, |minimum| number(minimum.robustness)),
        "initial_configuration": minimum.map(|minimum| minimum.scenario.values()),
        "scenario": minimum.map(|minimum| run::scenario(resolved.space.axes(), minimum.scenario.values())),
        "simulation": minimum.map(|minimum| minimum.number),
        "seed": minimum.map(|minimum| minimum.seed.0.to_string()),
        "end": trial.end.map(end),
        "diverged": trial.diverged,
        "invalid": trial.invalid,
        "failed": trial.failed,
        "undecided": trial.undecided,
    })
}

/// Returns the options that the plan sets, as JSON.
fn search_options(falsify: &FalsifyPlan) -> Value {
    let value = |value: &OptionValue| match value {
        OptionValue::Float(value) => number(*value),
        OptionValue::Integer(value) => json!(value),
        OptionValue::Boolean(value) => json!(value),
        OptionValue::Text(value) => json!(value),
        OptionValue::Point(value) => json!(value),
        OptionValue::Points(value) => json!(value),
    };
    falsify.options.iter().map(|(name, option)| (name.to_string(), value(option))).collect()
}

/// Returns the options that the plan sets, in parentheses.
fn options_text(falsify: &FalsifyPlan) -> String {
    let options: Vec<String> =
        falsify.options.iter().map(|(name, value)| format!("{name} = {value}")).collect();
    if options.is_empty() { String::new() } else { format!(" ({})", options.join(", ")) }
}

/// Warns about simulations that have no verdict because a value is not finite: the first one of up to `SHOWN` trials.
fn report_unevaluated(resolved: &ResolvedPlan, found: &CampaignOutcome) {
    const SHOWN: usize = 3;
    let first =
        found.trials.iter().filter_map(|trial| Some((trial.trial, trial.first_unevaluated.as_ref()?)));
    let mut shown = 0;
    for (trial, first) in first.take(SHOWN) {
        shown += 1;
        output::message(&format!(
            "warning: simulation {} of trial {trial} ({}, seed {}) has no verdict: {}",
            first.number,
            run::scenario_summary(resolved.space.axes(), first.scenario.values()),
            first.seed.0,
            run::end_text(first.end, &resolved.target.signals),
        ));
    }
    let affected = found.undefined + found.invalid + found.failed;
    if affected > shown {
        let more = plural(affected - shown, "more simulation");
        output::message(&format!("warning: no verdict either: {more}"));
    }
}

/// Returns the name of a trial's end.
fn end(end: TrialEnd) -> &'static str {
    match end {
        TrialEnd::Falsified => "falsified",
        TrialEnd::BudgetSpent => "budget spent",
        TrialEnd::ModesDriedUp => "modes dried up",
        TrialEnd::SearchEnded(_) => "search ended",
    }
}

fn text(resolved: &ResolvedPlan, found: &CampaignOutcome, repeats: &Repeats) -> String {
    let falsify = resolved.plan.falsify.clone().unwrap_or_default();
    let at = |minimum: &Minimum| run::scenario_summary(resolved.space.axes(), minimum.scenario.values());
    let mut header = vec!["trial", "result", "simulations", "min robustness", "scenario"];
    if !repeats.is_empty() {
        header.insert(4, "fails in repeats");
    }
    let mut rows = vec![header.into_iter().map(String::from).collect::<Vec<_>>()];
    for trial in &found.trials {
        let minimum = trial.minimum.as_ref();
        let mut row = vec![
            trial.trial.to_string(),
            trial.end.map_or("interrupted", end).to_string(),
            trial.simulations.to_string(),
            minimum.map_or("-".to_string(), |minimum| decimal(minimum.robustness, 4)),
            minimum.map_or(String::new(), at),
        ];
        if !repeats.is_empty() {
            let repeated = repeats.get(&trial.trial);
            row.insert(
                4,
                repeated.map_or("-".to_string(), |report| {
                    format!("{} of {}", report.failures, report.failure_rate.n)
                }),
            );
        }
        rows.push(row);
    }
    let mut text = format!(
        "{}\nsearch {}{}, at most {} per trial, seed {}\nformula {}\n\n{}\n\n{}",
        run::heading(resolved),
        falsify.search,
        options_text(&falsify),
        plural(falsify.budget, "simulation"),
        resolved.plan.seed,
        resolved.specification.requirement,
        output::table(&rows),
        summary(found),
    );
    if falsify.early_stopping && found.simulations > 0 && found.screened == 0 {
        let whole = found.simulations * resolved.target.episode_steps as u64;
        text.push_str(&format!(
            "\nearly stopping: {:.0} % of {whole} control steps saved; robustness values of simulations that ended early are lower bounds",
            100.0 * (1.0 - found.control_steps as f64 / whole as f64)
        ));
    }
    if let Some(bound) = mishandle::run::failure_rate_bound(resolved, found) {
        text.push_str(&format!(
            "\nno violation in {} of the space: failure rate below {} (95 % confidence)",
            plural(found.simulations, "uniform random sample"),
            percent(bound)
        ));
    }
    let first = found.trials.iter().filter(|trial| trial.falsified());
    if let Some((trial, first)) =
        first.filter_map(|trial| Some((trial.trial, trial.minimum.as_ref()?))).next()
    {
        text.push_str(&format!(
            "\ncounterexample: {}, seed {} (trial {trial}, simulation {}): robustness {}",
            run::scenario_text(resolved.space.axes(), first.scenario.values()),
            first.seed.0,
            first.number,
            decimal(first.robustness, 4)
        ));
    }
    if !repeats.is_empty() {
        let sum = |of: fn(&RepeatReport) -> u64| repeats.values().map(of).sum::<u64>();
        let (failures, n) = (sum(|report| report.failures), sum(|report| report.failure_rate.n));
        text.push_str(&format!(
            "\nwith other seeds, the counterexamples fail in {failures} of {}",
            plural(n, "repeat")
        ));
    }
    if let Some(counts) = run::without_verdict(found.diverged, found.invalid, found.failed, found.undecided) {
        text.push_str(&format!("\n{counts}; they do not count as counterexamples"));
    }
    text
}

/// Formats a small rate in percent, rounded up to two digits.
fn percent(rate: f64) -> String {
    let percent = 100.0 * rate;
    let decimals = (1.0 - percent.log10().floor()).clamp(0.0, 12.0) as usize;
    let scale = 10_f64.powi(decimals as i32);
    format!("{:.decimals$} %", (percent * scale).ceil() / scale)
}

/// Returns the number of falsified trials, and the simulations up to the counterexample.
fn summary(found: &CampaignOutcome) -> String {
    let ended = found.falsification_rate.n;
    let mut text = format!("falsified {} of {}", found.falsified_trials, plural(ended, "trial"));
    if let Some(mean) = found.mean_simulations {
        text.push_str(&format!("; simulations to a counterexample: mean {mean:.1} over falsified trials"));
    }
    match found.median_simulations {
        Some(median) => text.push_str(&format!(", median {median} over all trials")),
        None if found.falsified_trials > 0 && found.trials.iter().all(|trial| trial.end.is_some()) => {
            text.push_str(", median over all trials not reached within the budget");
        }
        None => {}
    }
    text
}
