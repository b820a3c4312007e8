//! `mishandle margin`: the smallest disturbance that makes a controller fail.

use anyhow::{Result, bail, ensure};
use clap::Args;
use mishandle::evaluation::RepeatReport;
use mishandle::rollout::{Axis, AxisKind};
use mishandle::run::{Answer, Level, Margin, MarginOutcome, Witness};
use mishandle::store::RunKind;
use mishandle::{Plan, ResolvedPlan};
use mishandle_text::{decimal, plural};
use serde_json::{Value, json};

use super::simulate;
use crate::output::{self, number};
use crate::{ExitStatus, args, numbers, question, run};

/// Search for the smallest disturbance that violates a formula
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle margin ball-balancing --controller ppo
  mishandle margin ball-balancing --controller ppo --space starts+disturbance
  mishandle margin toy/car-following --space dynamics+events
  mishandle margin --resume runs/RUN.sqlite

An amplitude of 1 is the largest disturbance of the space: each axis at a bound. The initial state,
if it is in the space, varies in its whole box. The result is an upper bound with a witness: smaller
disturbances that violate the formula may exist. Exit code 1 means that a violation was found.")]
pub struct Arguments {
    #[command(flatten)]
    pub subject: args::Subject,
    /// Requirement: the name of a formula of the target, or the text of a formula [default: the target's first formula]
    #[arg(long, allow_hyphen_values = true, conflicts_with = "resume")]
    pub formula: Option<String>,
    /// Largest number of simulations [default: 3000]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u64>(Plan::BUDGET))]
    #[arg(conflicts_with = "resume")]
    pub budget: Option<u64>,
    #[command(flatten)]
    pub file: args::OpenRun,
    #[command(flatten)]
    pub run: args::Run,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    run::set_threads(command.run.threads)?;
    let asked = question::ask(RunKind::Margin, &command.subject, &command.file, None, || plan(command))?;
    let Answer::Margin(MarginOutcome { margin: found, repeats, .. }) = &asked.answer else {
        bail!("the answer is that of another question");
    };
    let resolved = &asked.resolved;
    match command.run.json {
        true => output::json(document(resolved, found, repeats.as_ref(), &asked.path))?,
        false => output::line(&text(resolved, found, repeats.as_ref()))?,
    }
    if let Some(witness) = &found.witness {
        let number = witness.episode.request.number;
        output::message(&format!("Witness: mishandle replay {} --simulation {number}", asked.name));
    }
    if let Some(status) = asked.report_file() {
        return Ok(status);
    }
    ensure!(found.has_verdict(), "no simulation has a verdict, so the controller was not tested");
    Ok(if found.witness.is_some() { ExitStatus::Violated } else { ExitStatus::Done })
}

fn plan(command: &Arguments) -> Result<Plan> {
    let mut plan = run::plan(&command.subject, &command.run)?;
    if command.subject.space.is_none() && command.subject.plan.is_none() {
        plan.space = Margin::SPACE.to_string();
    }
    let mut margin = plan.margin.take().unwrap_or_default();
    margin.formula = command.formula.clone().or(margin.formula);
    margin.budget = command.budget.unwrap_or(margin.budget);
    plan.margin = Some(margin);
    Ok(plan.only(RunKind::Margin))
}

fn text(resolved: &ResolvedPlan, found: &Margin, repeats: Option<&RepeatReport>) -> String {
    let header = ["amplitude", "simulations", "lowest robustness", "result"].map(String::from).to_vec();
    let row = |level: &Level| {
        vec![
            decimal(level.amplitude, 4),
            level.simulations.to_string(),
            level.robustness.map_or("-".to_string(), |rho| decimal(rho, 4)),
            result(level),
        ]
    };
    let rows: Vec<Vec<String>> = std::iter::once(header).chain(found.levels.iter().map(row)).collect();
    let conclusion = match (&found.witness, found.largest_without_violation()) {
        (Some(witness), _) => witness_text(resolved, found, witness, repeats),
        (None, Some(level)) => {
            format!("no violation in {}, up to the largest disturbance of the space", evidence(&level))
        }
        (None, None) if found.is_complete => "no violation, but most simulations have no verdict".to_string(),
        (None, None) => "no violation so far, but the search is not finished".to_string(),
    };
    format!(
        "{}\nformula {}\n\n{}\n\n{conclusion}",
        run::heading(resolved),
        resolved.specification.requirement,
        output::table(&rows)
    )
}

fn result(level: &Level) -> String {
    let result = match level {
        _ if level.is_violated() => "violated",
        Level { is_complete: false, .. } => "interrupted",
        Level { robustness: None, .. } => "no verdict",
        _ => "no violation",
    };
    match level.without_verdict {
        0 => result.to_string(),
        n => format!("{result}, {n} without a verdict"),
    }
}

/// Describes the simulations on which a claim that nothing fails rests.
fn evidence(level: &Level) -> String {
    let all = if level.is_exhaustive { ", which are all scenarios" } else { "" };
    format!("{}{all}", plural(level.verdicts(), "simulation"))
}

fn witness_text(
    resolved: &ResolvedPlan,
    found: &Margin,
    witness: &Witness,
    repeats: Option<&RepeatReport>,
) -> String {
    let (norms, request) = (&witness.norms, &witness.episode.request);
    let size = match witness.axes {
        0 => "the controller fails without a disturbance".to_string(),
        axes => format!(
            "smallest disturbance found: amplitude {} (L2 {}, L1 {}) on {}",
            decimal(norms.largest, 4),
            decimal(norms.euclidean, 4),
            decimal(norms.sum, 4),
            run::axes(axes),
        ),
    };
    let doubt = match repeats {
        Some(report) if !report.fails_in_most() => ", but not with most other seeds",
        _ => "",
    };
    let mut text = format!(
        "{size}{doubt}, after {}\nwitness: {}, seed {}: robustness {}",
        plural(found.simulations, "simulation"),
        witness_scenario(resolved.space.axes(), request.scenario.values()),
        request.seed.0,
        decimal(witness.episode.robustness().unwrap_or(f64::NAN), 4),
    );
    if let Some(report) = repeats {
        text.push_str(&format!(
            "\nwith other seeds, the witness fails in {} of {}",
            report.failures,
            plural(report.simulations, "repeat")
        ));
        if !report.fails_in_most() {
            text.push_str(": the failure is the luck of its seed");
        }
    }
    if let Some(level) = found.largest_without_violation() {
        text.push_str(&format!(
            "\nup to amplitude {}, no violation in {}",
            decimal(level.amplitude, 4),
            evidence(&level)
        ));
    }
    text
}

/// Formats the initial state and the disturbed axes.
fn witness_scenario(axes: &[Axis], values: &[Option<f64>]) -> String {
    let is_shown =
        |(axis, value): &(&Axis, &Option<f64>)| axis.kind == AxisKind::Start || **value != axis.nominal;
    let (axes, values): (Vec<Axis>, Vec<Option<f64>>) =
        axes.iter().zip(values).filter(is_shown).map(|(axis, value)| (axis.clone(), *value)).unzip();
    if axes.is_empty() { "the nominal scenario".to_string() } else { run::scenario_text(&axes, &values) }
}

/// Returns the JSON document of the run.
pub fn document(
    resolved: &ResolvedPlan,
    found: &Margin,
    repeats: Option<&RepeatReport>,
    path: &str,
) -> Value {
    let level = |level: &Level| {
        json!({
            "amplitude": level.amplitude,
            "simulations": level.simulations,
            "without_verdict": level.without_verdict,
            "minimum_robustness": level.robustness.map(number),
            "is_violated": level.is_violated(),
            "is_complete": level.is_complete,
            "is_exhaustive": level.is_exhaustive,
        })
    };
    let witness = found.witness.as_ref().map(|witness| {
        let Witness { episode, norms, axes } = witness;
        json!({
            "amplitude": norms.largest,
            "l2": norms.euclidean,
            "l1": norms.sum,
            "axes": axes,
            "simulation": episode.request.number,
            "scenario": run::scenario(resolved.space.axes(), episode.request.scenario.values()),
            "seed": episode.request.seed.0.to_string(),
            "robustness": episode.robustness().map(number),
            "repeats": repeats.map(simulate::repeats_document),
            "fails_in_most_repeats": repeats.map(RepeatReport::fails_in_most),
        })
    });
    let passed = found.largest_without_violation();
    let own = json!({
        "formula": resolved.specification.requirement.to_string(),
        "simulations": found.simulations,
        "is_complete": found.is_complete,
        "levels": found.levels.iter().map(level).collect::<Vec<_>>(),
        "no_violation_up_to": passed.map(|level| level.amplitude),
        "no_violation_simulations": passed.map(|level| level.verdicts()),
        "witness": witness,
    });
    output::joined(run::document(resolved, path), own)
}
