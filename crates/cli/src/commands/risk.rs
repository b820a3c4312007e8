//! `mishandle risk`: the probability that a controller fails under a distribution of scenarios.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Result, ensure};
use clap::Args;
use mishandle::risk::{Failure, Report, Scenarios, ScreenedReport};
use mishandle::rollout::Axis;
use mishandle::{Plan, ResolvedPlan, RiskPlan, plural, shell_quote};
use serde_json::{Value, json};

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run::{self, counterexample};
use crate::show::output::{self, number};
use crate::show::progress::Bar;
use crate::show::{risk, scenario, screening, subject};

/// Estimate the probability that a simulation violates a formula
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle risk toy/hidden-corner
  mishandle risk ball-balancing --controller ppo --simulations 100000
  mishandle risk ball-balancing --controller ppo --distribution ball_x=normal:0.35:0.05

Distributions: uniform, log-uniform, normal:MEAN:STD, triangular:MODE, and weights:W0:W1:... with a
weight for each value of a discrete axis. All are truncated to the bounds of the axis. Exit code 1
means that a simulation violated the formula.")]
pub struct Arguments {
    #[command(flatten)]
    pub subject: flags::Subject,
    /// Requirement: the name of a formula of the target, or the text of a formula [default: the target's first formula]
    #[arg(long, allow_hyphen_values = true)]
    pub formula: Option<String>,
    /// Distribution of an axis, for instance friction_scale=normal:1:0.1; repeat the flag for several axes [default: the
    /// distribution that the axis declares, mostly uniform]
    #[arg(long, value_name = "NAME=DISTRIBUTION", allow_hyphen_values = true, value_parser = distribution)]
    pub distribution: Vec<(String, String)>,
    /// Number of simulations [default: 50000]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    #[arg(value_parser = numbers::integer::<u64>(RiskPlan::SIMULATIONS))]
    pub simulations: Option<u64>,
    /// Parts of the estimation besides Monte Carlo: auto (all), monte-carlo (none), importance or splitting
    /// [default: auto]
    #[arg(long, value_name = "METHOD")]
    pub method: Option<String>,
    #[command(flatten)]
    pub screening: flags::Screening,
    /// Write the first of the shown failures to this .json file, which `mishandle replay` runs again
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Overwrite FILE if it exists
    #[arg(long)]
    pub force: bool,
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

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    command.screening.check()?;
    run::set_threads(command.run.threads)?;
    let bar = Bar::new(0, "simulations");
    run::stop_on_signals(&bar)?;
    let resolved = ResolvedPlan::new(&plan(command)?)?;
    output::warn_of_chained_comparisons(&resolved.specification.requirement);
    counterexample::check_out(command.out.as_deref(), &resolved, command.force)?;
    let scenarios = mishandle::risk_scenarios(&resolved)?;
    for warning in scenarios.warnings() {
        output::message(&format!("warning: {warning}"));
    }
    let planned = resolved.plan.risk.as_ref().map_or(0, |risk| risk.simulations);
    bar.set_length(planned);
    if command.screening.is_gpu() {
        return screened(command, &resolved, &scenarios, &bar);
    }
    let report = mishandle::risk(&resolved, |done| {
        bar.set_position(done);
        run::control_flow()
    })?;
    bar.clear();
    match command.run.json {
        true => output::json(document(&resolved, &scenarios, &report))?,
        false => output::line(&risk::text(&resolved, &scenarios, &report))?,
    }
    write_failure(command, &resolved, &scenarios, report.failures.first())?;
    if !report.is_complete {
        let n = plural(report.monte_carlo.simulations, "simulation");
        let answer = format!("the answer is that of {n} of Monte Carlo and of the finished parts");
        run::report_loss(report.simulations, &format!("{answer}; it cannot be resumed"));
        return Ok(ExitStatus::Interrupted);
    }
    let undecided = report.monte_carlo.without_verdict;
    ensure!(
        undecided < report.monte_carlo.simulations,
        "no simulation of Monte Carlo has a verdict, so the controller was not tested"
    );
    Ok(if report.failures.is_empty() { ExitStatus::Done } else { ExitStatus::Violated })
}

/// Writes the first failure to the file of `--out`. The result is printed before, so that an error here does not lose it.
fn write_failure(
    command: &Arguments,
    resolved: &ResolvedPlan,
    scenarios: &Scenarios,
    failure: Option<&Failure>,
) -> Result<()> {
    let Some(out) = &command.out else { return Ok(()) };
    let Some(failure) = failure else {
        output::message("there is no failure to write");
        return Ok(());
    };
    let counterexample = mishandle::risk_counterexample(resolved, scenarios, failure)?;
    output::write_atomically(out, command.force, counterexample.to_json().as_bytes())?;
    output::message(&format!("Failure: mishandle replay {}", shell_quote(&out.to_string_lossy())));
    Ok(())
}

/// Estimates the probability by screening on the GPU.
fn screened(
    command: &Arguments,
    resolved: &ResolvedPlan,
    scenarios: &Scenarios,
    bar: &Bar,
) -> Result<ExitStatus> {
    let method = resolved.plan.risk.as_ref().map_or("auto", |risk| &risk.method);
    ensure!(
        matches!(method, "auto" | "monte-carlo"),
        "--screening gpu runs Monte Carlo; it cannot run --method {method}"
    );
    let gpu = mishandle::gpu_backend()?;
    let mut screening = mishandle::screening(resolved, &*gpu, command.screening.rows() as usize)?;
    let start = Instant::now();
    let report = mishandle::risk_on_backend(
        resolved,
        scenarios,
        &mut screening,
        command.screening.confirm(),
        &mut |progress| {
            bar.set_position(progress.screened);
            run::control_flow()
        },
    )?;
    bar.clear();
    let seconds = start.elapsed().as_secs_f64();
    match command.run.json {
        true => output::json(screened_document(resolved, scenarios, &report))?,
        // Interrupted in the first chunk, it has nothing to show.
        false if report.counts.trials == 0 => (),
        false => output::line(&risk::screened_text(resolved, scenarios, &report))?,
    }
    // Failures of the interrupted chunk count for no estimate, but they are failures of MuJoCo C.
    write_failure(command, resolved, scenarios, report.failures.first())?;
    if report.counts.trials == 0 {
        return Ok(run::without_result());
    }
    let screened = plural(report.counts.trials, "simulation");
    output::message(&format!("{screened} screened in {seconds:.1} s, repetitions by MuJoCo C included"));
    if !report.is_complete {
        run::report_loss(report.counts.trials, "the answer is that of these; it cannot be resumed");
        return Ok(ExitStatus::Interrupted);
    }
    ensure!(
        report.without_verdict < report.confirmed(),
        "no simulation of MuJoCo C has a verdict, so the controller was not tested"
    );
    Ok(if report.failures.is_empty() { ExitStatus::Done } else { ExitStatus::Violated })
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
    Ok(Plan { risk: Some(risk), evaluate: None, falsify: None, ..plan })
}

fn document(resolved: &ResolvedPlan, scenarios: &Scenarios, report: &Report) -> Value {
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
            "assumption": mishandle::risk_assumption(report),
        })),
        "bounds": answer.bounds,
        "refusals": mishandle::risk_refusals(report),
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
    output::joined(subject::document_without_run(resolved), own)
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
            "scenario": scenario::document(resolved.space.axes(), scenario.values()),
            "seed": failure.draw.seed.0.to_string(),
            "robustness": number(failure.robustness),
        })
    };
    failures.iter().map(failure).collect()
}

fn screened_document(resolved: &ResolvedPlan, scenarios: &Scenarios, report: &ScreenedReport) -> Value {
    let counts = report.counts;
    let own = json!({
        "formula": resolved.specification.requirement.to_string(),
        "distribution": distributions(scenarios),
        "is_complete": report.is_complete,
        "failure_rate": output::estimate(&report.estimate()),
        "screening": screening::screening(&counts, report.screened_without_verdict, report.overflows),
        "confirmation": {
            "flagged_failures": counts.flagged_events,
            "audit_sample": counts.sampled,
            "audit_sample_failures": counts.sampled_events,
            "without_verdict": report.without_verdict,
        },
        "failures": failures(resolved, scenarios, &report.failures),
    });
    output::joined(subject::document_without_run(resolved), own)
}
