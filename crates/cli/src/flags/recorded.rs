//! A recorded simulation: in a run file, or an exported counterexample.

use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};
use clap::Args;
use mishandle::plan::EngineSettings;

use super::NUMBERS;
use super::keys::{Assignment, assignment, settings};
use super::numbers::integer;

/// Flags that choose a simulation of a run file, or an exported counterexample.
#[derive(Debug, Args)]
pub struct Recorded {
    /// Run file, or a .json file of `mishandle counterexamples export`
    #[arg(value_name = "RUN|FILE.json")]
    pub file: PathBuf,
    /// Number of the trial, from 1 [default: 1 with --simulation, otherwise any]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<u32>(NUMBERS))]
    pub trial: Option<u32>,
    /// Number of the simulation within its trial, from 1 [default: the first counterexample,
    /// of a margin that with the smallest disturbance, otherwise the simulation with the minimum
    /// robustness]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = integer::<u32>(NUMBERS))]
    pub simulation: Option<u32>,
    /// Set a key; repeat the flag for several
    #[arg(short = 'k', value_name = "KEY=VALUE", allow_hyphen_values = true, value_parser = assignment)]
    #[arg(hide_possible_values = true)]
    pub keys: Vec<Assignment>,
}

impl Recorded {
    /// Returns how run files are opened.
    pub fn engine(&self, command: &str) -> Result<EngineSettings> {
        Ok(settings(&self.keys, command)?.engine)
    }
}

/// Flags of commands that write the trace of one simulation.
#[derive(Debug, Args)]
pub struct TraceFile {
    /// Write the trace to this CSV file
    #[arg(long, value_name = "FILE")]
    pub trace: Option<PathBuf>,
    /// Columns of the trace: signals; or full, which adds joint positions and velocities, actions
    /// and contact forces of tasks [default: signals]
    #[arg(long, value_name = "COLUMNS", requires = "trace", value_parser = ["signals", "full"])]
    pub record: Option<String>,
}

impl TraceFile {
    /// Returns whether the trace has more than the signals.
    pub fn is_full(&self) -> bool {
        self.record.as_deref() == Some("full")
    }
}

/// Returns whether a path names an exported counterexample rather than a run file.
pub fn is_file(path: &Path) -> bool {
    path.extension().is_some_and(|found| found.eq_ignore_ascii_case("json"))
}

/// Checks that no flag selects a simulation of an exported counterexample, which holds one.
pub fn check_flags(trial: Option<u32>, simulation: Option<u32>) -> Result<()> {
    ensure!(
        trial.is_none() && simulation.is_none(),
        "the file is one counterexample: --trial and --simulation select a simulation of a run file"
    );
    Ok(())
}
