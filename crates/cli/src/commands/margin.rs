//! `mishandle margin`: the smallest disturbance that makes a controller fail.

use anyhow::Result;
use clap::Args;
use mishandle::Plan;
use mishandle::plan::Settings;
use mishandle::store::RunKind;

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run::{self, answers, question};

/// Search for the smallest disturbance that violates a formula
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle margin ball-balancing --controller ppo
  mishandle margin ball-balancing --controller ppo --space starts+disturbance
  mishandle margin toy/car-following --space dynamics+events
  mishandle margin --resume runs/RUN.sqlite

An amplitude of 1 is the largest disturbance of the space: each axis at a bound. The initial state,
if it is in the space, varies in its whole box. The result is an upper bound with a witness: smaller
disturbances that violate the formula may exist. Exit code 1 means that a violation was found, 2
also that too many simulations have no verdict (max-without-verdict).")]
pub struct Arguments {
    #[command(flatten)]
    pub subject: flags::Subject,
    #[command(flatten)]
    pub simulator: flags::Simulator,
    /// Requirement: the name of a formula of the target, or the text of a formula [default: the
    /// target's first formula]
    #[arg(long, allow_hyphen_values = true, conflicts_with = "resume")]
    pub formula: Option<String>,
    /// Largest number of simulations [default: 3000]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u64>(Plan::BUDGET))]
    #[arg(conflicts_with = "resume")]
    pub budget: Option<u64>,
    #[command(flatten)]
    pub file: flags::OpenRun,
    #[command(flatten)]
    pub run: flags::Run,
    #[command(flatten)]
    pub verbose: flags::Verbose,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    run::set_threads(command.run.threads)?;
    let asked =
        question::ask(RunKind::Margin, &command.subject.keys.keys, &command.file, None, || plan(command))?;
    answers::show(asked, command.run.json, command.verbose.verbose)
}

fn plan(command: &Arguments) -> Result<(Plan, Settings)> {
    let mut planned =
        flags::planned("margin", &command.subject, &command.run)?.simulator(&command.simulator)?;
    planned.flag("--formula", "margin.formula", command.formula.clone())?;
    planned.number("--budget", "margin.budget", command.budget)?;
    planned.question("margin")
}
