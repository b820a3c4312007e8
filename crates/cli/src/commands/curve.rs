use std::ops::RangeInclusive;
use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use mishandle::train::Curve;
use mishandle_text::plural;

use crate::exit_status::ExitStatus;
use crate::flags::numbers;
use crate::show::output;
use crate::show::training_time;

/// Numbers of parallel environments: those of the setting `episodes.environments`.
const ENVIRONMENTS: RangeInclusive<u64> = 1..=1_000_000;

/// Show the training time of a curve written by `train --csv`: when the return converged
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle curve curve.csv
  mishandle curve curve.csv --environments 512     also control steps per environment")]
pub struct Arguments {
    /// CSV file of a learning curve
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// Number of parallel environments of the training run
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<usize>(ENVIRONMENTS))]
    pub environments: Option<usize>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    let curve = Curve::load(&command.file)?;
    if curve.is_truncated {
        let file = command.file.display();
        output::message(&format!("warning: the last line of {file} is incomplete and was ignored"));
    }
    let found = curve.result(command.environments);
    let time = training_time::line(found.training_time.as_ref(), found.no_training_time.as_deref());
    if command.json {
        output::json(&found)?;
        if found.training_time.is_none() {
            output::message(&time);
        }
        return Ok(ExitStatus::Done);
    }
    if let Some(last) = curve.rows.last() {
        let (count, secs) = (plural(curve.rows.len(), "iteration"), last.wall_clock_secs);
        let steps = plural(last.environment_steps, "environment step");
        output::line(&format!("{count}, {steps} in {secs:.0} s"))?;
    }
    output::line(&time)?;
    Ok(ExitStatus::Done)
}
