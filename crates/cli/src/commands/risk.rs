//! `mishandle risk`: the probability that a controller fails under a distribution of scenarios.

use anyhow::{Result, bail, ensure};
use clap::Args;
use mishandle::plan::RiskPlan;
use mishandle::risk::{Failure, Report, Scenarios, ScreenedReport};
use mishandle::rollout::Axis;
use mishandle::run::{Answer, Device};
use mishandle::store::RunKind;
use mishandle::{Plan, ResolvedPlan};
use serde_json::{Value, json};

use crate::output::{self, number};
use crate::{ExitStatus, args, numbers, question, risk_text, run, screened_text};

/// Estimate the probability that a simulation violates a formula
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle risk toy/hidden-corner
  mishandle risk ball-balancing --controller ppo --simulations 100000
  mishandle risk ball-balancing --controller ppo --distribution ball_x=normal:0.35:0.05
  mishandle risk --resume runs/RUN.sqlite

Distributions: uniform, log-uniform, normal:MEAN:STD, triangular:MODE, and weights:W0:W1:... with a
weight for each value of a discrete axis. All are truncated to the bounds of the axis. Exit code 1
means that a simulation violated the formula.")]
pub struct Arguments {
    #[command(flatten)]
    pub subject: args::Subject,
    /// Requirement: the name of a formula of the target, or the text of a formula [default: the target's first formula]
    #[arg(long, allow_hyphen_values = true, conflicts_with = "resume")]
    pub formula: Option<String>,
    /// Distribution of an axis, for instance friction_scale=normal:1:0.1; repeat the flag for several axes [default: the
    /// distribution that the axis declares, mostly uniform]
    #[arg(long, value_name = "NAME=DISTRIBUTION", allow_hyphen_values = true, value_parser = distribution, conflicts_with = "resume")]
    pub distribution: Vec<(String, String)>,
    /// Number of simulations [default: 50000]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    #[arg(value_parser = numbers::integer::<u64>(RiskPlan::SIMULATIONS), conflicts_with = "resume")]
    pub simulations: Option<u64>,
    /// Parts of the estimation besides Monte Carlo: auto (all), monte-carlo (none), importance or splitting
    /// [default: auto]
    #[arg(long, value_name = "METHOD", conflicts_with = "resume")]
    pub method: Option<String>,
    #[command(flatten)]
    pub screen: args::Screen,
    #[command(flatten)]
    pub file: args::OpenRun,
    #[command(flatten)]
    pub run: args::Run,
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
    let asked = question::ask(RunKind::Risk, &command.subject, &command.file, gpu, || plan(command))?;
    let resolved = &asked.resolved;
    let scenarios = mishandle::run::risk_scenarios(resolved)?;
    for warning in scenarios.warnings() {
        output::message(&format!("warning: {warning}"));
    }
    let (failures, without_verdict, tested) = match &asked.answer {
        Answer::Risk(report) => {
            match command.run.json {
                true => output::json(document(resolved, &scenarios, report, &asked.path))?,
                false => output::line(&risk_text::text(resolved, &scenarios, report))?,
            }
            (&report.failures, report.monte_carlo.without_verdict, report.monte_carlo.simulations)
        }
        Answer::ScreenedRisk(report) => {
            if command.run.json {
                output::json(screened_document(resolved, &scenarios, report, &asked.path))?;
            } else if report.counts.trials > 0 {
                output::line(&risk_text::screened_text(resolved, &scenarios, report))?;
            }
            asked.report_screening(report.counts.trials, report.confirmed());
            (&report.failures, report.without_verdict, report.confirmed())
        }
        _ => bail!("the answer is that of another question"),
    };
    if let Some(failure) = failures.first() {
        output::message(&format!("Failure: mishandle replay {} --simulation {}", asked.name, failure.number));
    }
    if let Some(status) = asked.report_file() {
        return Ok(status);
    }
    ensure!(
        without_verdict < tested,
        "no simulation of Monte Carlo has a verdict, so the controller was not tested"
    );
    Ok(if failures.is_empty() { ExitStatus::Done } else { ExitStatus::Violated })
}

fn plan(command: &Arguments) -> Result<Plan> {
    let mut plan = run::plan(&command.subject, &command.run)?;
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
    plan.screening = command.screen.plan(plan.screening.take())?;
    Ok(plan.only(RunKind::Risk))
}

/// Returns the JSON document of the run.
pub fn document(resolved: &ResolvedPlan, scenarios: &Scenarios, report: &Report, path: &str) -> Value {
    let Report { answer, monte_carlo, importance, splitting, .. } = report;
    let own = json!({
        "formula": resolved.specification.requirement.to_string(),
        "method": resolved.plan.risk.as_ref().map(|risk| &risk.method),
        "distribution": distributions(scenarios),
        "simulations": report.simulations,
        "is_complete": report.is_complete,
        "probability": answer.source.map(|source| json!({
            "value": answer.estimate.value,
            "low": answer.estimate.low,
            "high": answer.estimate.high,
            "source": source.name(),
            "assumption": mishandle::run::risk_assumption(report),
        })),
        "bounds": answer.bounds,
        "refusals": mishandle::run::risk_refusals(report),
        "monte_carlo": {
            "simulations": monte_carlo.simulations,
            "failures": monte_carlo.failures,
            "without_verdict": monte_carlo.without_verdict,
            "bound_with_undecided": monte_carlo.bound_with_undecided().map(number),
            "failure_rate": output::estimate(&monte_carlo.estimate()),
        },
        "exploration": { "simulations": report.exploration },
        "importance": importance.as_ref().map(|importance| json!({
            "fitting_simulations": importance.fitting,
            "simulations": importance.simulations,
            "failures": importance.failures,
            "effective_failures": importance.effective_failures,
            "components": importance.components,
            "regions": output::estimate(&importance.regions),
            "outside": importance.outside,
            "monte_carlo_inside": importance.monte_carlo_inside,
            "monte_carlo_outside": importance.monte_carlo_outside,
        })),
        "splitting": splitting.as_ref().map(|splitting| json!({
            "simulations": splitting.simulations,
            "population": splitting.population,
            "estimate": splitting.estimate().ok().map(|estimate| output::estimate(&estimate)),
            "chains": splitting.chains.iter().map(|chain| json!({
                "probability": chain.probability,
                "level": number(chain.level),
                "is_complete": chain.is_complete,
                "levels": chain.levels,
                "acceptance": chain.acceptance,
            })).collect::<Vec<_>>(),
        })),
        "failures": failures(resolved, scenarios, &report.failures),
    });
    output::joined(run::document(resolved, path), own)
}

/// Returns the distribution of each axis.
fn distributions(scenarios: &Scenarios) -> Vec<Value> {
    let distribution = |(axis, marginal): (&Axis, &mishandle::risk::Marginal)| {
        let text = if axis.is_fixed() { "fixed".to_string() } else { marginal.to_string() };
        json!({ "axis": axis.name, "distribution": text, "low": axis.low, "high": axis.high, "unit": axis.unit })
    };
    scenarios.axes().map(distribution).collect()
}

fn failures(resolved: &ResolvedPlan, scenarios: &Scenarios, failures: &[Failure]) -> Vec<Value> {
    let failure = |failure: &Failure| {
        let scenario = scenarios.scenario(&failure.draw.latent);
        json!({
            "scenario": run::scenario(resolved.space.axes(), scenario.values()),
            "simulation": failure.number,
            "seed": failure.draw.seed.0.to_string(),
            "robustness": number(failure.robustness),
        })
    };
    failures.iter().map(failure).collect()
}

/// Returns the JSON document of a screened run.
pub fn screened_document(
    resolved: &ResolvedPlan,
    scenarios: &Scenarios,
    report: &ScreenedReport,
    path: &str,
) -> Value {
    let counts = report.counts;
    let own = json!({
        "formula": resolved.specification.requirement.to_string(),
        "backend": "gpu",
        "distribution": distributions(scenarios),
        "is_complete": report.is_complete,
        "failure_rate": output::estimate(&report.estimate()),
        "screening": screened_text::screening(&counts, report.screened_without_verdict, report.overflows),
        "confirmation": {
            "flagged_failures": counts.flagged_events,
            "sampled": counts.sampled,
            "sampled_failures": counts.sampled_events,
            "without_verdict": report.without_verdict,
        },
        "failures": failures(resolved, scenarios, &report.failures),
    });
    output::joined(run::document(resolved, path), own)
}
