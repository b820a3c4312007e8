//! `mishandle risk`: the probability that a controller fails under a distribution of scenarios.

use anyhow::Result;
use clap::Args;
use mishandle::Plan;
use mishandle::plan::{RiskPlan, Settings};
use mishandle::run::Device;
use mishandle::store::RunKind;

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run::{self, answers, question};

/// Estimate the probability that a simulation violates a formula
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle risk toy/hidden-corner
  mishandle risk ball-balancing --controller ppo --simulations 100000
  mishandle risk toy/sphere-2d -k risk.distributions.x=normal:0.3:0.05
  mishandle risk ball-balancing --controller ppo --action-noise 0.1 -k risk.method=sequence
  mishandle risk --resume runs/RUN.sqlite

Distributions: uniform, log-uniform, normal:MEAN:STD, triangular:MODE, and weights:W0:W1:... with a
weight for each value of a discrete axis. All are truncated to the bounds of the axis. The method
`sequence` is for tasks only. Exit code 1 means that a simulation violated the formula, 2 also that
too many have no verdict (max-without-verdict).")]
pub struct Arguments {
    #[command(flatten)]
    pub subject: flags::Subject,
    #[command(flatten)]
    pub simulator: flags::Simulator,
    /// Requirement: the name of a formula of the target, or the text of a formula [default: the
    /// target's first formula]
    #[arg(long, allow_hyphen_values = true, conflicts_with = "resume")]
    pub formula: Option<String>,
    /// Number of simulations [default: 50000]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    #[arg(value_parser = numbers::integer::<u64>(RiskPlan::SIMULATIONS), conflicts_with = "resume")]
    pub simulations: Option<u64>,
    #[command(flatten)]
    pub file: flags::OpenRun,
    #[command(flatten)]
    pub run: flags::Run,
    #[command(flatten)]
    pub verbose: flags::Verbose,
}

pub fn run(command: &Arguments, gpu: Option<&Device>) -> Result<ExitStatus> {
    run::set_threads(command.run.threads)?;
    let asked =
        question::ask(RunKind::Risk, &command.subject.keys.keys, &command.file, gpu, || plan(command))?;
    answers::show(asked, command.run.json, command.verbose.verbose)
}

fn plan(command: &Arguments) -> Result<(Plan, Settings)> {
    let mut planned =
        flags::planned("risk", &command.subject, &command.run)?.simulator(&command.simulator)?;
    planned.flag("--formula", "risk.formula", command.formula.clone())?;
    planned.number("--simulations", "risk.simulations", command.simulations)?;
    planned.question("risk")
}
