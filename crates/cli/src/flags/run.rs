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

/// Flags that create or open the run file of a command that runs simulations.
#[derive(Debug, Args)]
pub struct OpenRun {
    /// Run file to create (SQLite) [default: a new file in runs/]
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Resume a stopped run with its own plan; if its controller was moved, --controller is the new
    /// path
    #[arg(long, value_name = "RUN", conflicts_with_all = PLANNED)]
    pub resume: Option<PathBuf>,
    /// With --resume: new path of the run's target file (.toml), if it was moved
    #[arg(long = "target", value_name = "FILE", requires = "resume")]
    pub moved_target: Option<String>,
    /// Do not check the whole run file before reading it; a record is still checked when it is read
    #[arg(long, requires = "resume")]
    pub skip_check: bool,
    /// Resume a run that another build started: its rows and those of this build stand in one file,
    /// whose header then names both
    #[arg(long, requires = "resume")]
    pub any_build: bool,
    /// Wait after each batch until its records are on the disk. Without it, a power failure can
    /// lose the last simulations; a kill loses at most the running batch. Not stored: a resumed run
    /// needs the flag again
    #[arg(long)]
    pub durable: bool,
}

/// Arguments of all commands that a resumed run takes from its own plan. The path of the controller
/// is not among them.
const PLANNED: [&str; 11] = [
    "target",
    "command",
    "space",
    "axis",
    "requirement",
    "action_noise",
    "guard",
    "keys",
    "plan",
    "out",
    "seed",
];
