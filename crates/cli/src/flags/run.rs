//! Seed, threads and run file of a command that runs simulations.

use std::path::PathBuf;

use clap::Args;

use super::numbers::integer;
use super::{SEEDS, THREADS};

/// Flags of all commands that run simulations.
#[derive(Debug, Args)]
pub struct Run {
    /// Random seed, from 0 to 2^64 - 1 [default: 0, or the seed of the plan]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<u64>(SEEDS))]
    pub seed: Option<u64>,
    /// Number of threads; does not affect the results [default: number of cores]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<usize>(THREADS))]
    pub threads: Option<usize>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

/// How much of an answer a command prints.
#[derive(Debug, Args)]
pub struct Verbose {
    /// Print all tables and values, too, not only what the answer means
    #[arg(long, conflicts_with = "json")]
    pub verbose: bool,
}

/// Flags that create or open the run file of a command that runs simulations.
#[derive(Debug, Args)]
pub struct OpenRun {
    /// Run file to create (SQLite) [default: a new file in runs/]
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Resume a stopped run with its own plan
    #[arg(long, value_name = "RUN", conflicts_with_all = PLANNED)]
    pub resume: Option<PathBuf>,
}

/// Arguments of all commands that a resumed run takes from its own plan.
const PLANNED: [&str; 11] = [
    "target",
    "command",
    "controller",
    "space",
    "axis",
    "requirement",
    "action_noise",
    "guard",
    "plan",
    "out",
    "seed",
];
