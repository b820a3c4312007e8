//! The command line of the zoo.

use std::path::PathBuf;

use clap::{Args, Subcommand, value_parser};

/// Maintain the shipped controllers: train, measure, import, write tables and charts
#[derive(Debug, Args)]
#[command(arg_required_else_help = true)]
#[command(after_help = "Examples:
  studies zoo list                       what is done, what is not, and why
  studies zoo train                      do everything that `list` shows as needed
  studies zoo train --only ball-pushing/sac --jobs 2
  studies zoo import runs                add training runs from another machine

Ctrl-C saves checkpoints, and the same command continues. controllers/README.md explains the plan
and the measurements.")]
pub struct Arguments {
    #[command(subcommand)]
    pub command: ZooCommand,
}

#[derive(Debug, Subcommand)]
pub enum ZooCommand {
    /// List the training runs of the plan with their states
    #[command(after_help = "Examples:
  studies zoo list
  studies zoo list --only ball-pushing
  studies zoo list --json

A controller is done if it was trained with the present settings, on the present task, in the
present file format, and measured with the present formulas.")]
    List {
        #[command(flatten)]
        part: Part,
        /// Print one JSON document to stdout
        #[arg(long)]
        json: bool,
    },
    /// Train and measure what is missing, then write the tables and the charts
    #[command(after_help = "Examples:
  studies zoo train
  studies zoo train --only peg-in-hole --jobs 2

Each training run takes one thread. It saves a checkpoint in target/controllers every minute.
A training run that fails does not end the others.")]
    Train {
        #[command(flatten)]
        part: Part,
        #[command(flatten)]
        jobs: Jobs,
    },
    /// Measure controllers without training, then write the tables and the charts
    #[command(after_help = "Examples:
  studies zoo measure                            what is missing
  studies zoo measure --only cloth-placing/ppo --again

A measurement is an evaluation of 1000 episodes (300 in cloth-placing) without noise, one with
action noise 0.5, and for PPO a falsification of 10 trials by random search.
Only missing parts are measured, unless --again is given.")]
    Measure {
        #[command(flatten)]
        part: Part,
        #[command(flatten)]
        jobs: Jobs,
        /// Repeat all selected measurements
        #[arg(long)]
        again: bool,
        /// Print one JSON document to stdout
        #[arg(long)]
        json: bool,
    },
    /// Add training runs from another machine: check, measure, and write the tables and the charts
    #[command(after_help = "Examples:
  mishandle train peg-in-hole --algorithm sac --threads 1 \\
      --out runs/peg-in-hole-sac.safetensors --csv runs/peg-in-hole-sac.csv
  studies zoo import runs

FOLDER holds two files for each training run: TASK-ALGORITHM.safetensors and .csv. A run is
refused if it has not ended, or differs from the plan in its seed, its settings or its task.")]
    Import {
        /// Folder with controllers and curves
        folder: PathBuf,
        #[command(flatten)]
        part: Part,
    },
    /// Write the tables and the charts again, from the records and the curves alone
    #[command(after_help = "Examples:
  studies zoo tables

Writes the tables of docs/reference/tasks.md and controllers/README.md, and the charts
controllers/curves/TASK.svg.")]
    Tables,
}

/// A part of the plan.
#[derive(Debug, Args)]
pub struct Part {
    /// Only this task, or this controller of it
    #[arg(long, value_name = "TASK[/CONTROLLER]")]
    pub only: Option<String>,
    /// Treat controllers as trained on the present task if nothing but their task differs
    #[arg(long)]
    pub adopt: bool,
}

/// Number of parallel jobs.
#[derive(Debug, Args)]
pub struct Jobs {
    /// Number of parallel jobs, one thread each [default: all cores]
    #[arg(long, value_name = "N", value_parser = value_parser!(u16).range(1..=1024))]
    pub jobs: Option<u16>,
}
