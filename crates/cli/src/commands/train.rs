use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::sync::LazyLock;

use anyhow::{Error, Result, anyhow};
use clap::Args;
use mishandle::MishandleError;
use mishandle::plan::{TrainPlan, Values};
use mishandle::results::{Choice, Key, Remedy, Training};
use mishandle::run::Device;
use mishandle::train::{TrainReport, default_out, default_reward};
use mishandle_text::{path_text, plural};

use crate::exit_status::ExitStatus;
use crate::flags::{self, Planned, numbers};
use crate::interrupt;
use crate::run;
use crate::show::output;
use crate::show::train_reporter::{TrainReporter, with_causes};
use crate::words;

/// Numbers of environment steps of a training run: those of the setting `run.total_steps`.
const STEPS: RangeInclusive<u64> = 1..=1_000_000_000_000;

/// Help text of `--algorithm`, from the list of algorithms.
static ALGORITHM_HELP: LazyLock<String> = LazyLock::new(|| {
    let names: Vec<&str> = mishandle::training::ALGORITHMS.iter().map(|entry| entry.name).collect();
    format!("Training algorithm: {} [default: that of --from, or ppo]", names.join(", "))
});

/// Train a controller
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle train point-reaching --algorithm ppo --out my_controller.safetensors
  mishandle train ball-balancing --algorithm ppo --settings my_settings.toml --seed 3
  mishandle train point-reaching --algorithm ppo --settings skrl-0.10
  mishandle train ball-balancing --algorithm ppo --out my_controller.safetensors --resume
  mishandle train ball-balancing --algorithm sac --csv curve.csv --tensorboard board
  mishandle train ball-balancing --algorithm sac --dry-run      check and print all settings
  mishandle train cube-stacking --algorithm ppo -k train.device=gpu   thousands of worlds on a GPU
  mishandle train ball-balancing --space delay+sensing --axis action_delay=0:2
  mishandle train ball-balancing --from ppo --space delay --steps 2e6   continue a controller
  mishandle train cartpole.toml --algorithm ppo --out c.safetensors     a robot of a file

The best controller by validation is written to --out, the last one beside it: FILE.safetensors and
FILE.last.safetensors. Training also writes a checkpoint there. --resume continues from the
checkpoint and continues the files of --csv and --tensorboard. On the CPU, the results are the same
as those of an uninterrupted run, bit for bit; with -k train.device=gpu they are not.
If a file cannot be written, as on a full disk, training warns, continues and tries again; it stops
if it cannot write the first checkpoint. The settings run.stop_success, run.stop_strict and
run.stop_validations enable early stopping.
Columns of the CSV file: docs/guide/training.md.
All settings: docs/reference/algorithms/settings.md.")]
pub struct Arguments {
    /// Name of a task, or target file of a robot (.toml)
    pub task: Option<String>,
    #[arg(long, value_name = "NAME", help = ALGORITHM_HELP.as_str())]
    pub algorithm: Option<String>,
    /// Start from this controller instead of random weights: a name or a file. Only the critic
    /// learns at first. Without --settings, training uses the settings that trained it
    #[arg(long, value_name = "CONTROLLER")]
    pub from: Option<String>,
    /// Total number of environment steps (control steps of all parallel environments), such as 1e6;
    /// rounded up to whole iterations [default: run.total_steps of the settings]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u64>(STEPS))]
    pub steps: Option<u64>,
    /// Scenario space of the training episodes, or several joined by +: delays, sensor errors,
    /// faults, changed models. Random starts always belong to it [default: scenarios.space of the
    /// settings]
    #[arg(long, value_name = "NAME")]
    pub space: Option<String>,
    #[command(flatten)]
    pub axes: flags::Axes,
    /// Guard under which the policy trains (TOML): the environment gets the actions that leave the
    /// guard (docs/guide/guard.md)
    #[arg(long, value_name = "FILE")]
    pub guard: Option<PathBuf>,
    /// File of the best controller [default: runs/TASK-ALGORITHM-sSEED.safetensors]
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Write the learning curve to this CSV file, one row per iteration
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
    /// Write TensorBoard event files to this folder
    #[arg(long, value_name = "DIR")]
    pub tensorboard: Option<PathBuf>,
    /// Settings file (TOML), or name of a settings base: skrl-0.10 or best
    /// [default: the shipped settings of the task, or the algorithm's defaults if none are shipped]
    #[arg(long, value_name = "FILE")]
    pub settings: Option<PathBuf>,
    /// Resume from the checkpoint beside --out
    #[arg(long)]
    pub resume: bool,
    /// Check settings and output files, print all settings, and exit without creating files
    #[arg(long)]
    pub dry_run: bool,
    #[command(flatten)]
    pub keys: flags::Keys,
    #[command(flatten)]
    pub run: flags::Run,
}

pub fn run(command: &Arguments, gpu: Option<&Device>) -> Result<ExitStatus> {
    run::set_threads(command.run.threads)?;
    let plan = plan(command)?;
    if mishandle::train::uses_default_settings(&plan)? {
        output::message(&format!(
            "note: no settings are shipped for {} with {}; using the defaults, which --dry-run prints",
            plan.task, plan.algorithm
        ));
    }
    if command.dry_run {
        return dry_run(&plan, gpu, command.run.json);
    }
    let mut reporter = TrainReporter::start(&plan)?;
    let report = mishandle::train::train(&plan, gpu, &mut reporter);
    reporter.finish();
    let report = report?;
    let result = &report.result;
    if interrupt::requested() && !report.is_finished() {
        return Ok(interrupted(&plan, &report));
    }
    if !report.write_failures.is_empty() {
        return Err(write_error(&plan, &report));
    }
    if let Some(steps) =
        plan.steps.filter(|steps| !report.stopped_early() && result.environment_steps > *steps)
    {
        output::message(&format!(
            "--steps {steps} was rounded up to {} (whole iterations)",
            result.environment_steps
        ));
    }
    if reporter.iterations == 0 {
        output::message("nothing left to do: the training was already finished");
    }
    let found = report.result(&plan);
    if command.run.json {
        output::json(&found)?;
        if found.training_time.is_none() {
            output::message(&training_time_line(&found, &plan));
        }
    } else {
        for line in lines(&found, &plan) {
            output::line(&line)?;
        }
    }
    say_outputs(&plan);
    Ok(ExitStatus::Done)
}

/// Reports how many steps an interrupted run completed and how to resume it. At least its first
/// checkpoint exists.
fn interrupted(plan: &TrainPlan, report: &TrainReport) -> ExitStatus {
    for error in &report.write_failures {
        output::message(&format!("error: {}", with_causes(error)));
    }
    let is_checkpoint = |error: &MishandleError| matches!(error, MishandleError::Training(_));
    let lost = if report.write_failures.iter().any(is_checkpoint) {
        "; the steps since the last checkpoint are lost"
    } else {
        ""
    };
    output::message(&format!(
        "interrupted after {}{lost}",
        plural(report.result.environment_steps, "environment step")
    ));
    output::message(&format!("Resume with: {}", plan.resume_command()));
    ExitStatus::Interrupted
}

/// Returns the error of a finished run that could not write all files, with the command that writes
/// them later.
fn write_error(plan: &TrainPlan, report: &TrainReport) -> Error {
    let errors: Vec<String> = report.write_failures.iter().map(with_causes).collect();
    let error = anyhow!(errors.join("; "));
    // Resuming writes the controllers again, but lost rows of the curve cannot be restored.
    if report.write_failures.iter().any(|error| matches!(error, MishandleError::Controller(_))) {
        anyhow!("{error}\nResume once the file can be written: {}", plan.resume_command())
    } else {
        error
    }
}

/// Prints the settings of the training run.
fn dry_run(plan: &TrainPlan, gpu: Option<&Device>, as_json: bool) -> Result<ExitStatus> {
    let facts = mishandle::train::training_facts(plan, gpu)?;
    let total_steps = facts.settings.run().total_steps;
    if !as_json {
        let TrainPlan { task, algorithm, reward, seed, .. } = plan;
        output::line(&format!("# task {task}, algorithm {algorithm}, reward {reward}, seed {seed}"))?;
        output::line(&format!("# {total_steps} environment steps, to {}", plan.out.display()))?;
        output::line(&format!("# {}\n", plan.full_command()))?;
        output::line(facts.settings.listing().trim_end())?;
        return Ok(ExitStatus::Done);
    }
    output::json(&facts.result(plan))?;
    Ok(ExitStatus::Done)
}

fn plan(command: &Arguments) -> Result<TrainPlan> {
    let mut planned = Planned::new(&command.keys)?;
    planned.flag("TASK", "target", command.task.clone())?;
    planned.guard(command.guard.as_deref())?;
    planned.flag("--space", "space", command.space.clone())?;
    planned.axes(&command.axes)?;
    planned.number("--seed", "seed", command.run.seed)?;
    planned.flag("--algorithm", "train.algorithm", command.algorithm.clone())?;
    planned.flag("--from", "train.from", command.from.clone())?;
    planned.number("--steps", "train.steps", command.steps)?;
    for (flag, key, path) in [
        ("--settings", "train.settings", &command.settings),
        ("--csv", "train.csv", &command.csv),
        ("--tensorboard", "train.tensorboard", &command.tensorboard),
    ] {
        planned.flag(flag, key, path.as_deref().map(path_text))?;
    }
    planned.assign(&command.keys.keys, "train", Values::One)?;
    let (plan, settings) = planned.no_question()?;
    let mut train = TrainPlan {
        space: Some(plan.space).filter(|space| !space.is_empty()),
        axes: plan.axes,
        guard: plan.guard,
        seed: plan.seed,
        task: plan.target,
        resume: command.resume,
        ..settings.train
    };
    if train.algorithm.is_empty() {
        train.algorithm = match &train.from {
            Some(from) => mishandle::train::algorithm_of(&train.task, from)?,
            None => "ppo".to_string(),
        };
    }
    if train.reward.is_empty() {
        train.reward = default_reward(&train.task).to_string();
    }
    let out = || default_out(&train.task, &train.algorithm, train.seed);
    train.out = command.out.clone().unwrap_or_else(out);
    Ok(train)
}

/// Returns the result as lines for the terminal.
fn lines(found: &Training, plan: &TrainPlan) -> Vec<String> {
    let secs = found.wall_clock_secs.0;
    let rate = found.environment_steps as f64 / secs;
    let steps = plural(found.environment_steps, "environment step");
    let mut lines = vec![format!("{steps} in {secs:.0} s, {rate:.0} steps/s")];
    lines.extend(found.stop_condition.iter().map(|condition| format!("stopped early: {condition}")));
    lines.push(training_time_line(found, plan));
    if let (Some(success), Some(strict)) = (found.success_rate, found.strict_success_rate) {
        lines.push(format!(
            "best on validation: success {:.1} %, strict {:.1} %, after {}",
            100.0 * success.0,
            100.0 * strict.0,
            plural(found.best_environment_steps, "step")
        ));
    }
    let scenarios = [("in the space", &found.space), ("at its corners", &found.corners)];
    lines.extend(scenarios.into_iter().filter_map(|(place, rates)| {
        let rates = rates.as_ref()?;
        let [success, strict] = [rates.success_rate, rates.strict_success_rate].map(|rate| 100.0 * rate.0);
        Some(format!("{place}: success {success:.1} %, strict {strict:.1} %"))
    }));
    lines
}

/// Returns a line about the time until the return converged, or why it has none.
fn training_time_line(found: &Training, plan: &TrainPlan) -> String {
    let Some(time) = &found.training_time else {
        let reason = format!("no training time: {}", found.no_training_time.as_deref().unwrap_or_default());
        let curve = plan.csv.is_none().then(|| Remedy::set(Key::CURVE, Choice::FILE));
        return words::described(&reason, curve.as_slice(), &words::Shell);
    };
    format!(
        "training time until the return converged: {}, {} per environment, {:.0} s",
        plural(time.environment_steps, "environment step"),
        plural(time.control_steps, "control step"),
        time.secs.0
    )
}

fn say_outputs(plan: &TrainPlan) {
    output::message(&format!(
        "The best controller is in {}, the last in {}",
        plan.out.display(),
        plan.last().display()
    ));
    if let Some(csv) = &plan.csv {
        output::message(&format!("The learning curve is in {}", csv.display()));
    }
    if let Some(folder) = &plan.tensorboard {
        let folder = mishandle_text::shell_quote(&folder.to_string_lossy());
        output::message(&format!("View it with: tensorboard --logdir {folder}"));
    }
    let out = mishandle_text::shell_quote(&plan.out.to_string_lossy());
    let target = mishandle_text::shell_quote(&plan.task);
    output::message(&format!("Evaluate it with: mishandle evaluate {target} --controller {out}"));
}
