use anyhow::{Result, ensure};
use clap::Args;
use mishandle::plan::FalsifyPlan;
use mishandle::results::{Answer, Falsification};
use mishandle::run::Device;
use mishandle::store::RunKind;
use mishandle::{Plan, ResolvedPlan};
use mishandle_text::plural;

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run::{self, question};
use crate::show::progress::Bar;
use crate::show::{falsification, mode_survey, output};

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
    /// Requirement to violate: the name of a formula of the target (such as success or strict), or
    /// the text of a formula [default: the target's first formula, which is success for a task]
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
    /// Simulate every scenario with this one random seed, so that robustness has no noise [default
    /// without a number: the seed of the run; without the flag: a seed for each simulation]
    #[arg(long, value_name = "N", num_args = 0..=1, require_equals = true, allow_negative_numbers = true)]
    #[arg(value_parser = numbers::integer::<u64>(flags::SEEDS), conflicts_with = "resume")]
    pub fixed_seed: Option<Option<u64>>,
    /// End simulations as soon as the search does not need the rest. The scenarios and violations
    /// are the same, but a trial without a violation can have a lower bound as lowest robustness
    #[arg(long, conflicts_with = "resume")]
    pub early_stopping: bool,
    /// Continue each trial after its first counterexample, to find other failure modes
    #[arg(long, conflicts_with = "resume")]
    pub keep_going: bool,
    /// With --keep-going, end a trial when less than this fraction of its simulations finds a new
    /// failure mode; 0 spends the whole budget [default: 0.01]
    #[arg(long, value_name = "RATE", allow_negative_numbers = true, conflicts_with = "resume")]
    pub new_mode_rate: Option<f64>,
    /// Do not move the counterexample of each trial toward nominal to find the axes that cause it
    /// (at most 30 simulations, or a tenth of a larger budget, and some more if it is on a bound)
    /// [default with --keep-going]
    #[arg(long, conflicts_with_all = ["resume", "isolate"])]
    pub no_isolate: bool,
    /// With --keep-going, move the first counterexample of each trial toward nominal
    #[arg(long, conflicts_with = "resume")]
    pub isolate: bool,
    /// If the target is random: number of simulations of each counterexample with other seeds,
    /// which measure how often it fails; at most as many in total as the run has; 0 skips this
    /// [default: 100]
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

pub fn run(command: &Arguments, gpu: Option<&Device>) -> Result<ExitStatus> {
    run::set_threads(command.run.threads)?;
    let (mut answer, asked) =
        question::ask(RunKind::Falsify, &command.subject, &command.file, gpu, || plan(command))?;
    add_repeats(&mut answer, &asked.resolved, command.repeats)?;
    let found: Falsification = answer.try_into()?;
    falsification::report_unevaluated(&found);
    if command.run.json {
        output::json(&found)?;
    } else if found.is_complete || (found.screening.is_some() && found.simulations > 0) {
        output::line(&falsification::text(&found))?;
        if let Some(survey) = &found.modes {
            output::line(&mode_survey::text(&found.subject, survey))?;
        }
    }
    if let Some(counts) = &found.screening {
        asked.report_screening(counts);
    }
    if found.is_complete && found.surplus > 0 {
        output::message(&format!(
            "discarded {} that ran in the same batch after the end of a trial or of its search",
            plural(found.surplus, "simulation")
        ));
    }
    if let Some(status) = asked.report_file(found.is_complete) {
        return Ok(status);
    }
    // Exit status 0 would say that the search found no violation.
    // Where one requirement is undefined, another one can be violated.
    let is_violated = found.requirements.iter().flatten().any(|requirement| requirement.violated > 0);
    ensure!(
        is_violated || found.trials.iter().any(|trial| trial.minimum_robustness.is_some()),
        "no simulation has a verdict, so the controller was not tested; the run file contains the end of each simulation"
    );
    if found.falsified_trials == 0 {
        return Ok(if is_violated { ExitStatus::Violated } else { ExitStatus::Done });
    }
    output::message(&format!("Replay the first counterexample: mishandle replay {}", asked.name));
    Ok(ExitStatus::Violated)
}

/// Adds the repeats of the counterexamples to an answer, with a progress bar.
fn add_repeats(answer: &mut Answer, resolved: &ResolvedPlan, repeats: Option<u32>) -> Result<()> {
    let bar = Bar::new(0, "repeats");
    mishandle::inspect::further(resolved, answer, repeats.map(u64::from), |done, all| {
        bar.set_length(all);
        bar.set_position(done);
        run::control_flow()
    })?;
    bar.clear();
    Ok(())
}

fn plan(command: &Arguments) -> Result<Plan> {
    let mut plan = flags::plan(&command.subject, &command.run)?;
    let mut falsify: FalsifyPlan = plan.falsify.take().unwrap_or_default();
    falsify.search = command.search.clone().unwrap_or(falsify.search);
    for (index, (name, value)) in command.search_options.iter().enumerate() {
        let earlier = &command.search_options[..index];
        ensure!(
            earlier.iter().all(|(other, _)| other != name),
            "--search-option {name} is given twice; give it once"
        );
        let value = mishandle::plan::search_option_value(&falsify.search, name, value);
        falsify.options.set(name, value);
    }
    falsify.formula = command.formula.clone().or(falsify.formula);
    falsify.trials = command.trials.unwrap_or(falsify.trials);
    falsify.budget = command.budget.unwrap_or(falsify.budget);
    plan.screening = command.screening.plan(plan.screening.take())?;
    falsify.batch = command.subject.batch.unwrap_or(match &plan.screening {
        Some(screening) => screening.rows.min(*Plan::BATCH.end() as u32),
        None => falsify.batch,
    });
    falsify.fixed_seed = command.fixed_seed.map(|seed| seed.unwrap_or(plan.seed)).or(falsify.fixed_seed);
    falsify.early_stopping |= command.early_stopping;
    falsify.keep_going |= command.keep_going;
    ensure!(
        falsify.keep_going || command.new_mode_rate.is_none(),
        "--new-mode-rate has no effect without --keep-going; give both"
    );
    falsify.new_mode_rate = command.new_mode_rate.unwrap_or(falsify.new_mode_rate);
    if command.isolate || command.no_isolate {
        falsify.isolate = Some(command.isolate);
    }
    falsify.isolate_by_default();
    plan.falsify = Some(falsify);
    Ok(plan.only(RunKind::Falsify))
}
