use std::path::PathBuf;

use anyhow::Result;
use clap::Args;

use crate::exit_status::ExitStatus;
use crate::run;
use crate::show::{difference, output};

/// Show how two runs differ: plan, target, program, results, and simulations with another verdict
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle diff runs/evaluate-1.sqlite runs/evaluate-2.sqlite
  mishandle diff yesterday.sqlite today.sqlite --json

The runs may be of any question. Simulations at the same place (trial and number) are compared if
they have the same scenario and seed. `mishandle compare` tests whether two evaluations differ.

Exit code 0 means that all trials, simulations and traces are the same to the bit, also if the files
were written by different programs; 1 that they differ; 2 an error.")]
pub struct Arguments {
    /// Run file A
    #[arg(value_name = "A")]
    pub first: PathBuf,
    /// Run file B
    #[arg(value_name = "B")]
    pub second: PathBuf,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
    /// Do not check the whole run files before reading them; a record is still checked when it is
    /// read
    #[arg(long)]
    pub skip_check: bool,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    let first = run::read(&command.first, command.skip_check)?;
    let second = run::read(&command.second, command.skip_check)?;
    let found = mishandle::inspect::run_difference(&first, &second)?;
    if command.json {
        output::json(&found)?;
    } else {
        output::line(&difference::text(&found))?;
    }
    Ok(if found.same_records { ExitStatus::Done } else { ExitStatus::Violated })
}
