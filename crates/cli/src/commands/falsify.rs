mod screening;

use std::path::Path;

use anyhow::Result;
use clap::Args;
use mishandle::evaluation::{NotSmooth, SmoothRegion};
use mishandle::falsification::{CampaignOutcome, Minimum};
use mishandle::store::{RunFile, RunHeader, RunKind};
use mishandle::{FalsifyPlan, MishandleError, ModeSurvey, Plan, ResolvedPlan, plural};
use serde_json::Value;

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run;
use crate::show::output::{self};
use crate::show::progress::Bar;
use crate::show::{falsification, mode_survey};

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
    pub subject: flags::Subject,
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
    pub screening: flags::Screening,
    #[command(flatten)]
    pub file: flags::OpenRun,
    #[command(flatten)]
    pub run: flags::Run,
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

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    command.screening.check()?;
    run::set_threads(command.run.threads)?;
    let bar = Bar::new(0, "simulations");
    run::stop_on_signals(&bar)?;
    if command.screening.is_gpu() {
        return screening::run(command, &bar);
    }
    let moved = command.subject.controller.as_deref();
    let (resolved, file) = run::open(&command.file, RunKind::Falsify, moved, || plan(command))?;
    output::warn_of_chained_comparisons(&resolved.specification.requirement);
    let name = run::name(file.file());
    let path = file.file().path().to_path_buf();
    let found = mishandle::falsify(&resolved, file, |progress| {
        bar.set_length(progress.max_simulations);
        bar.set_position(progress.simulations);
        bar.set_note(format!(
            "{} finished, {} falsified",
            plural(progress.ended, "trial"),
            progress.falsified
        ));
        run::control_flow()
    })?;
    bar.clear();
    falsification::report_unevaluated(&resolved, &found);
    let keeps_going = resolved.plan.falsify.as_ref().is_some_and(|falsify| falsify.keep_going);
    let survey = if keeps_going { Some(survey(&path)?) } else { None };
    if !falsification::is_complete(&resolved, &found) {
        run::report_interruption(RunKind::Falsify, found.simulations, &name);
        if command.run.json {
            let document = falsification::document(
                &resolved,
                &found,
                &falsification::Repeats::new(),
                &path.to_string_lossy(),
            );
            output::json(with_modes(document, survey.as_ref()))?;
        }
        return Ok(ExitStatus::Interrupted);
    }
    let repeats = counterexample_repeats(&resolved, &found, command.repeats.unwrap_or(REPEATS))?;
    let region = smooth_region(&resolved, &found, &path)?;
    if command.run.json {
        let mut document = falsification::document(&resolved, &found, &repeats, &path.to_string_lossy());
        document["smooth_region"] = region.map_or(Value::Null, falsification::region_document);
        output::json(with_modes(document, survey.as_ref()))?;
    } else {
        output::line(
            &(falsification::text(&resolved, &found, &repeats)
                + &region.map_or(String::new(), falsification::region_text)),
        )?;
        if let Some((header, survey)) = &survey {
            output::line(&mode_survey::text(header, survey))?;
        }
    }
    if found.surplus > 0 {
        output::message(&format!(
            "discarded {} that ran in the same batch after the end of a trial or of its search",
            plural(found.surplus, "simulation")
        ));
    }
    output::message(&format!("Run file: {name}"));
    // Exit status 0 would say that the search found no violation.
    anyhow::ensure!(
        found.trials.iter().any(|trial| trial.minimum.is_some()),
        "no simulation has a verdict, so the controller was not tested; the run file contains the end of each simulation"
    );
    if found.falsified_trials == 0 {
        return Ok(ExitStatus::Done);
    }
    output::message(&format!("Replay the first counterexample: mishandle replay {name}"));
    Ok(ExitStatus::Violated)
}

/// Default number of repeated simulations of a counterexample.
const REPEATS: u32 = 100;

/// Fewest simulations of a counterexample with other seeds, unless fewer are requested. Fewer say little: of 20, none fails with a
/// probability of 36 % if 5 % do.
const FEWEST_REPEATS: u64 = 20;

/// Simulates each counterexample `repeats` times with other seeds; in total at most as often as the run has simulations, but each at
/// least [`FEWEST_REPEATS`] times.
/// Returns nothing for a target without randomness, whose counterexamples always fail.
fn counterexample_repeats(
    resolved: &ResolvedPlan,
    found: &CampaignOutcome,
    repeats: u32,
) -> Result<falsification::Repeats> {
    let counterexamples: Vec<(u32, &Minimum)> = found
        .trials
        .iter()
        .filter(|trial| trial.falsified())
        .filter_map(|trial| Some((trial.trial, trial.minimum.as_ref()?)))
        .filter(|(_, minimum)| mishandle::depends_on_seed(resolved, &minimum.scenario))
        .collect();
    let share = found.simulations / (counterexamples.len() as u64).max(1);
    let each = u64::from(repeats).min(share.max(FEWEST_REPEATS));
    if counterexamples.is_empty() || each == 0 {
        return Ok(falsification::Repeats::new());
    }
    let bar = Bar::new(each * counterexamples.len() as u64, "repeats");
    let mut system = resolved.system()?;
    let mut done = 0;
    let mut reports = falsification::Repeats::new();
    for (trial, minimum) in counterexamples {
        let seeds = mishandle::repeat_seeds(minimum.seed, each);
        let report = mishandle::repeat(&mut *system, &minimum.scenario, seeds, |_| {
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

/// Returns the region that cannot fail if the robustness is smooth: see [`mishandle::smooth_region_of`].
fn smooth_region(
    resolved: &ResolvedPlan,
    found: &CampaignOutcome,
    path: &Path,
) -> Result<Option<Result<SmoothRegion, NotSmooth>>> {
    let run = RunFile::open(path).map_err(MishandleError::from)?;
    Ok(mishandle::smooth_region_of(resolved, found, &run)?)
}

fn plan(command: &Arguments) -> Result<Plan> {
    let mut plan = flags::plan(&command.subject, &command.run)?;
    let mut falsify: FalsifyPlan = plan.falsify.take().unwrap_or_default();
    falsify.search = command.search.clone().unwrap_or(falsify.search);
    for (index, (name, value)) in command.search_options.iter().enumerate() {
        let earlier = &command.search_options[..index];
        anyhow::ensure!(
            earlier.iter().all(|(other, _)| other != name),
            "--search-option {name} is given twice; give it once"
        );
        let value = mishandle::search_option_value(&falsify.search, name, value);
        falsify.options.set(name, value);
    }
    falsify.formula = command.formula.clone().or(falsify.formula);
    falsify.trials = command.trials.unwrap_or(falsify.trials);
    falsify.budget = command.budget.unwrap_or(falsify.budget);
    falsify.batch = command.subject.batch.unwrap_or(match command.screening.is_gpu() {
        true => command.screening.rows().min(*Plan::BATCH.end() as u32),
        false => falsify.batch,
    });
    falsify.early_stopping |= command.early_stopping;
    falsify.keep_going |= command.keep_going;
    anyhow::ensure!(
        falsify.keep_going || command.new_mode_rate.is_none(),
        "--new-mode-rate has no effect without --keep-going; give both"
    );
    falsify.new_mode_rate = command.new_mode_rate.unwrap_or(falsify.new_mode_rate);
    (plan.evaluate, plan.risk) = (None, None);
    plan.falsify = Some(falsify);
    Ok(plan)
}

/// Surveys the failure modes of a run file. Returns its header, too.
fn survey(path: &Path) -> Result<(RunHeader, ModeSurvey)> {
    let run = RunFile::open_unchecked(path)?;
    Ok((run.header().clone(), mishandle::mode_survey(&run)?))
}

/// Adds what a survey of the failure modes found to the document of a run.
fn with_modes(document: Value, survey: Option<&(RunHeader, ModeSurvey)>) -> Value {
    match survey {
        Some((header, survey)) => output::joined(document, mode_survey::document(header, survey)),
        None => document,
    }
}
