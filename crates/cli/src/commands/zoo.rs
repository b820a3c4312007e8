//! The controllers that come with the repository.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use anyhow::{Chain, Context, Result, bail};
use clap::{Args, Subcommand};
use mishandle::MishandleError;
use mishandle::training::TrainingProgress;
use mishandle_zoo::{
    LocalRunner, PlanEntry, Selection, TrainingState, Zoo, ZooError, ZooFolder, ZooObserver,
};
use serde_json::{Value, json};

use crate::output::{self, number};
use crate::train_reporter::with_causes;
use crate::{ExitStatus, args, interrupt, numbers};

/// Maintain the shipped controllers: train, measure, import, write tables and charts
#[derive(Debug, Args)]
#[command(arg_required_else_help = true)]
#[command(after_help = "Examples:
  mishandle zoo list                               what is done, what is not, and why
  mishandle zoo train                              do everything that `list` shows as needed
  mishandle zoo train --only ball-pushing/sac --jobs 2
  mishandle zoo import runs                        add training runs from another machine

It works in a clone of the repository: the one that contains the program, or the folder in
MISHANDLE_HOME. Ctrl-C saves checkpoints, and the same command continues. controllers/README.md
explains the plan and the measurements.")]
pub struct Arguments {
    #[command(subcommand)]
    pub command: ZooCommand,
}

#[derive(Debug, Subcommand)]
pub enum ZooCommand {
    /// List the training runs of the plan with their states
    #[command(after_help = "Examples:
  mishandle zoo list
  mishandle zoo list --only ball-pushing --seeds 0
  mishandle zoo list --json

A controller is done if it was trained with the present settings, on the present task, in the
present file format, and measured with the present formulas.")]
    List {
        #[command(flatten)]
        selection: ZooSelection,
        /// Print one JSON document to stdout
        #[arg(long)]
        json: bool,
    },
    /// Train and measure what is missing or out of date, then write the tables and the charts
    #[command(after_help = "Examples:
  mishandle zoo train
  mishandle zoo train --only peg-in-hole/ppo --seeds 1 2 --jobs 2

Each training run takes one thread. It saves a checkpoint in target/controllers every minute.
A training run that fails does not end the others.")]
    Train {
        #[command(flatten)]
        selection: ZooSelection,
        #[command(flatten)]
        jobs: ZooJobs,
    },
    /// Measure controllers without training, then write the tables and the charts
    #[command(after_help = "Examples:
  mishandle zoo measure                            what is missing or out of date
  mishandle zoo measure --only cloth-placing/ppo --again

A measurement is an evaluation of 1000 episodes without noise, one with action noise 0.5, and for
the shipped PPO controllers a falsification of 10 trials by random search. Only missing parts are
measured, unless --again is given.")]
    Measure {
        #[command(flatten)]
        selection: ZooSelection,
        #[command(flatten)]
        jobs: ZooJobs,
        /// Repeat all selected measurements
        #[arg(long)]
        again: bool,
        /// Print one JSON document to stdout
        #[arg(long)]
        json: bool,
    },
    /// Add training runs from another machine: check, measure, and write the tables and the charts
    #[command(after_help = "Examples:
  mishandle train peg-in-hole --algorithm sac --seed 2 --threads 1 \\
      --out runs/peg-in-hole-sac-s2.safetensors --csv runs/peg-in-hole-sac-s2.csv
  mishandle zoo import runs

FOLDER holds two files for each training run: TASK-ALGORITHM-sSEED.safetensors and .csv. A run is
refused if it has not ended, or differs from the plan in its seed, its settings or its task.")]
    Import {
        /// Folder with controllers and curves
        folder: PathBuf,
        #[command(flatten)]
        selection: ZooSelection,
    },
    /// Write the tables and the charts again, from the records and the curves alone
    #[command(after_help = "Examples:
  mishandle zoo tables

Writes the tables of README.md, docs/tasks.md and controllers/README.md, and the charts
controllers/curves/TASK.svg.")]
    Tables,
}

/// A part of the plan.
#[derive(Debug, Args)]
pub struct ZooSelection {
    /// Only this task, or this controller of it
    #[arg(long, value_name = "TASK[/CONTROLLER]")]
    pub only: Option<String>,
    /// Only these random seeds; seed 0 is shipped
    #[arg(long, value_name = "N", num_args = 1.., allow_negative_numbers = true, value_parser = numbers::integer::<u64>(args::SEEDS))]
    pub seeds: Vec<u64>,
    /// Treat controllers as trained on the present task if nothing but their task differs
    #[arg(long)]
    pub adopt: bool,
}

/// Number of parallel jobs.
#[derive(Debug, Args)]
pub struct ZooJobs {
    /// Number of parallel jobs, one thread each [default: all cores]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<usize>(args::THREADS))]
    pub jobs: Option<usize>,
}

/// A training run reports its progress this often.
const PROGRESS_PERIOD: Duration = Duration::from_secs(60);

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    let root = mishandle::home().context(
        "expected a clone of the repository around the program; name one in the environment variable MISHANDLE_HOME",
    )?;
    if !root.join("experiments/training").is_dir() || !root.join("controllers/README.md").is_file() {
        bail!("expected a clone of the repository at {}; set MISHANDLE_HOME to one", root.display());
    }
    let runner = LocalRunner::new()?;
    let reporter = Reporter::new();
    let zoo = Zoo::new(ZooFolder::new(&root), &runner, &reporter, &interrupt::requested);
    match &command.command {
        ZooCommand::List { selection, json } => list(&selected(zoo, selection), selection, *json),
        ZooCommand::Train { selection, jobs } => finish(with_jobs(selected(zoo, selection), jobs)?.train()),
        ZooCommand::Measure { selection, jobs, again, json } => {
            let zoo = with_jobs(selected(zoo, selection), jobs)?;
            let status = finish(zoo.measure(*again))?;
            if *json && status == ExitStatus::Done {
                output::json(Value::Array(
                    zoo.entries()?.iter().map(|entry| document(&zoo, entry)).collect(),
                ))?;
            }
            Ok(status)
        }
        ZooCommand::Import { folder, selection } => import(&selected(zoo, selection), folder),
        ZooCommand::Tables => finish(zoo.write_pages()),
    }
}

fn selected<'a>(zoo: Zoo<'a>, selection: &ZooSelection) -> Zoo<'a> {
    let ZooSelection { only, seeds, adopt } = selection;
    zoo.with_selection(Selection { only: only.clone(), seeds: seeds.clone() }).with_adoption(*adopt)
}

/// Sets the number of jobs, and makes signals end them after an iteration or a batch.
fn with_jobs<'a>(zoo: Zoo<'a>, jobs: &ZooJobs) -> Result<Zoo<'a>> {
    listen()?;
    let all_cores = || std::thread::available_parallelism().map_or(1, usize::from);
    Ok(zoo.with_workers(jobs.jobs.unwrap_or_else(all_cores)))
}

fn listen() -> Result<()> {
    interrupt::listen(|| output::message("saving checkpoints; press Ctrl-C again to end at once"), || {})
}

fn import(zoo: &Zoo<'_>, folder: &Path) -> Result<ExitStatus> {
    listen()?;
    finish(zoo.import(folder))
}

/// Turns an interruption into an exit status.
fn finish(result: Result<(), ZooError>) -> Result<ExitStatus> {
    match result {
        Ok(()) => Ok(ExitStatus::Done),
        Err(error @ (ZooError::Interrupted | ZooError::InterruptedWith { .. })) => {
            output::message(&error.to_string());
            Ok(ExitStatus::Interrupted)
        }
        // The hints of the program are for its own errors.
        Err(ZooError::Mishandle(error)) => Err((*error).into()),
        Err(error) => Err(error.into()),
    }
}

fn list(zoo: &Zoo<'_>, selection: &ZooSelection, as_json: bool) -> Result<ExitStatus> {
    let entries = zoo.entries()?;
    if let (true, Some(only)) = (entries.is_empty(), &selection.only) {
        bail!(
            "--only is {only}; an expert is not trained, so the list of training runs does not have it: `mishandle zoo \
             measure --only {only}` measures it"
        );
    }
    if as_json {
        output::json(Value::Array(entries.iter().map(|entry| document(zoo, entry)).collect()))?;
        return Ok(ExitStatus::Done);
    }
    for entry in &entries {
        output::line(&line(zoo, entry))?;
    }
    let done = entries.iter().filter(|entry| entry.state == TrainingState::Done).count();
    output::line(&format!("{done} of {} done", entries.len()))?;
    Ok(ExitStatus::Done)
}

fn line(zoo: &Zoo<'_>, entry: &PlanEntry) -> String {
    let is_trained = entry.state.is_trained();
    let is_adopted = entry.summary.as_ref().is_some_and(|summary| summary.adopted);
    let adopted = if is_trained && is_adopted { ", adopted" } else { "" };
    let curve = if is_trained && !zoo.has_curve(entry) { ", no learning curve" } else { "" };
    let missed = zoo.missed_thresholds(entry);
    let below =
        if missed.is_empty() { String::new() } else { format!(", below threshold: {}", missed.join(", ")) };
    format!("{:<28} {}{adopted}{curve}{below}", entry.training.name(), entry.state)
}

fn document(zoo: &Zoo<'_>, entry: &PlanEntry) -> Value {
    let training = &entry.training;
    let rate = |noise: usize| {
        let evaluation = entry.record.as_ref()?.evaluation(noise)?;
        evaluation.success_rate.value.map(number)
    };
    let steps = match entry.state {
        TrainingState::Interrupted { steps, .. } => steps,
        _ => None,
    };
    json!({
        "task": training.task,
        "algorithm": training.algorithm,
        "seed": training.seed.to_string(),
        "controller": training.controller(),
        "state": entry.state.name(),
        "reason": entry.state.reason(),
        "checkpoint_environment_steps": steps,
        "adopted": entry.summary.as_ref().is_some_and(|summary| summary.adopted),
        "has_curve": zoo.has_curve(entry),
        "success_rate": rate(0),
        "success_rate_with_noise": rate(1),
        "missed_thresholds": zoo.missed_thresholds(entry),
    })
}

/// Reports jobs on stderr, a line each with the seconds since the start.
struct Reporter {
    started: Instant,
    /// When each training run last reported its progress.
    reported: Mutex<BTreeMap<String, Instant>>,
}

impl Reporter {
    fn new() -> Reporter {
        Reporter { started: Instant::now(), reported: Mutex::default() }
    }

    fn say(&self, name: &str, words: &str) {
        output::message(&format!("{:>6.0} s  {name}: {words}", self.started.elapsed().as_secs_f64()));
    }

    fn is_due(&self, name: &str) -> bool {
        let now = Instant::now();
        let mut reported = self.reported.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let is_due = reported.get(name).is_none_or(|last| now - *last >= PROGRESS_PERIOD);
        if is_due {
            reported.insert(name.to_string(), now);
        }
        is_due
    }
}

impl ZooObserver for Reporter {
    fn begins(&self, jobs: usize, workers: usize) {
        output::message(&format!("jobs: {jobs}, in parallel: {workers}"));
    }

    fn started(&self, name: &str, reason: &str) {
        self.say(name, reason);
    }

    fn progress(&self, name: &str, progress: &TrainingProgress) {
        if self.is_due(name) {
            self.say(name, &progress.to_string());
        }
    }

    fn warning(&self, name: &str, failure: &MishandleError) {
        self.say(name, &format!("warning: {}; training continues and tries again", with_causes(failure)));
    }

    fn note(&self, name: &str, words: &str) {
        output::message(&format!("{name}: {words}"));
    }

    fn ended(&self, name: &str, result: &Result<(), ZooError>) {
        match result {
            Ok(()) => self.say(name, "done"),
            Err(error) => self.say(name, &format!("failed: {}", output::with_causes(Chain::new(error)))),
        }
    }
}
