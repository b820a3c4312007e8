//! `mishandle risk`: the probability that a controller fails under a distribution of scenarios.

use anyhow::{Result, ensure};
use clap::Args;
use mishandle::Plan;
use mishandle::plan::RiskPlan;
use mishandle::results::Risk;
use mishandle::run::Device;
use mishandle::store::RunKind;

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run::{self, question};
use crate::show::{output, risk};

/// Estimate the probability that a simulation violates a formula
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle risk toy/hidden-corner
  mishandle risk ball-balancing --controller ppo --simulations 100000
  mishandle risk ball-balancing --controller ppo --distribution ball_x=normal:0.35:0.05
  mishandle risk ball-balancing --controller ppo --action-noise 0.1 --space noise --method sequence
  mishandle risk --resume runs/RUN.sqlite

Distributions: uniform, log-uniform, normal:MEAN:STD, triangular:MODE, and weights:W0:W1:... with a
weight for each value of a discrete axis. All are truncated to the bounds of the axis. Exit code 1
means that a simulation violated the formula.")]
pub struct Arguments {
    #[command(flatten)]
    pub subject: flags::Subject,
    /// Requirement: the name of a formula of the target, or the text of a formula [default: the
    /// target's first formula]
    #[arg(long, allow_hyphen_values = true, conflicts_with = "resume")]
    pub formula: Option<String>,
    /// Distribution of an axis, for instance friction_scale=normal:1:0.1; repeat the flag for
    /// several axes [default: the distribution that the axis declares, mostly uniform]
    #[arg(long, value_name = "NAME=DISTRIBUTION", allow_hyphen_values = true, value_parser = distribution, conflicts_with = "resume")]
    pub distribution: Vec<(String, String)>,
    /// Number of simulations [default: 50000]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    #[arg(value_parser = numbers::integer::<u64>(RiskPlan::SIMULATIONS), conflicts_with = "resume")]
    pub simulations: Option<u64>,
    /// Parts of the estimation besides Monte Carlo: auto (all), monte-carlo (none), importance,
    /// splitting, or sequence, which chooses disturbances of actions from the state while a
    /// simulation runs, for 37 axes and more [default: auto]
    #[arg(long, value_name = "METHOD", conflicts_with = "resume")]
    pub method: Option<String>,
    #[command(flatten)]
    pub screening: flags::Screening,
    #[command(flatten)]
    pub file: flags::OpenRun,
    #[command(flatten)]
    pub run: flags::Run,
}

/// Parses `NAME=DISTRIBUTION`.
fn distribution(text: &str) -> Result<(String, String), String> {
    let (name, distribution) = text
        .split_once('=')
        .ok_or("expected the name of an axis and a distribution, such as friction_scale=normal:1:0.1")?;
    Ok((name.to_string(), distribution.to_string()))
}

pub fn run(command: &Arguments, gpu: Option<&Device>) -> Result<ExitStatus> {
    run::set_threads(command.run.threads)?;
    let (answer, asked) =
        question::ask(RunKind::Risk, &command.subject, &command.file, gpu, || plan(command))?;
    for warning in mishandle::run::risk_scenarios(&asked.resolved)?.warnings() {
        output::message(&format!("warning: {warning}"));
    }
    let found: Risk = answer.try_into()?;
    if command.run.json {
        output::json(&found)?;
    } else if found.screening.is_none() || found.simulations > 0 {
        output::line(&risk::text(&found))?;
    }
    let tested = match &found.screening {
        Some(counts) => {
            asked.report_screening(counts);
            counts.flagged + counts.audit_sample
        }
        None => found.monte_carlo.simulations,
    };
    if let Some(failure) = found.failures.first() {
        output::message(&format!(
            "Failure: mishandle replay {} --simulation {}",
            asked.name, failure.simulation
        ));
    }
    if let Some(status) = asked.report_file(found.is_complete) {
        return Ok(status);
    }
    ensure!(
        found.monte_carlo.without_verdict + found.monte_carlo.invalid_starts < tested,
        "no simulation of Monte Carlo has a verdict, so the controller was not tested"
    );
    Ok(if found.failures.is_empty() { ExitStatus::Done } else { ExitStatus::Violated })
}

fn plan(command: &Arguments) -> Result<Plan> {
    let mut plan = flags::plan(&command.subject, &command.run)?;
    let mut risk = plan.risk.take().unwrap_or_default();
    risk.formula = command.formula.clone().or(risk.formula);
    risk.simulations = command.simulations.unwrap_or(risk.simulations);
    risk.method = command.method.clone().unwrap_or(risk.method);
    risk.batch = command.subject.batch.unwrap_or(risk.batch);
    for (index, (name, distribution)) in command.distribution.iter().enumerate() {
        let earlier = command.distribution[..index].iter().any(|(other, _)| other == name);
        ensure!(!earlier, "the axis {name} has two distributions; give --distribution {name}=... once");
        risk.distributions.insert(name.clone(), distribution.clone());
    }
    plan.risk = Some(risk);
    plan.screening = command.screening.plan(plan.screening.take())?;
    Ok(plan.only(RunKind::Risk))
}
