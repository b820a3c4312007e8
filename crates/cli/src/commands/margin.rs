//! `mishandle margin`: the smallest disturbance that makes a controller fail.

use std::path::PathBuf;

use anyhow::{Result, ensure};
use clap::Args;
use mishandle::evaluation::RepeatReport;
use mishandle::rollout::{Axis, AxisKind, Seed};
use mishandle::{
    Counterexample, FalsifyPlan, Level, Margin, Plan, ResolvedPlan, Witness, decimal, plural, shell_quote,
};
use serde_json::{Value, json};

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run::{self, counterexample};
use crate::show::output::{self, number};
use crate::show::progress::Bar;
use crate::show::{repeats, scenario, subject};

/// Search for the smallest disturbance that violates a formula
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle margin ball-balancing --controller ppo
  mishandle margin ball-balancing --controller ppo --space starts+disturbance --out smallest.json
  mishandle margin toy/car-following --space dynamics+events

An amplitude of 1 is the largest disturbance of the space: each axis at a bound. The initial state,
if it is in the space, varies in its whole box. The result is an upper bound with a witness: smaller
disturbances that violate the formula may exist. Exit code 1 means that a violation was found.")]
pub struct Arguments {
    #[command(flatten)]
    pub subject: flags::Subject,
    /// Requirement: the name of a formula of the target, or the text of a formula [default: the target's first formula]
    #[arg(long, allow_hyphen_values = true)]
    pub formula: Option<String>,
    /// Largest number of simulations [default: 3000]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u64>(Plan::BUDGET))]
    pub budget: Option<u64>,
    /// Write the witness to this .json file, which `mishandle replay` runs again
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Overwrite FILE if it exists
    #[arg(long)]
    pub force: bool,
    #[command(flatten)]
    pub run: flags::Run,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    run::set_threads(command.run.threads)?;
    let budget = command.budget.unwrap_or(Margin::BUDGET);
    let bar = Bar::new(budget, "simulations");
    run::stop_on_signals(&bar)?;
    let resolved = ResolvedPlan::new(&plan(command)?)?;
    output::warn_of_chained_comparisons(&resolved.specification.requirement);
    counterexample::check_out(command.out.as_deref(), &resolved, command.force)?;
    let mut system = resolved.system()?;
    let seed = Seed(resolved.plan.seed);
    let found = mishandle::margin(&mut *system, seed, budget, |done| {
        bar.set_position(done);
        run::control_flow()
    })?;
    let repeats = match &found.witness {
        Some(witness) if found.is_complete => {
            mishandle::witness_repeats(&resolved, witness, |_| run::control_flow())?
        }
        _ => None,
    };
    bar.clear();
    if let (Some(out), Some(witness)) = (&command.out, &found.witness) {
        let counterexample = Counterexample::from_episode(&resolved, &witness.episode)?;
        output::write_atomically(out, command.force, counterexample.to_json().as_bytes())?;
    }
    match command.run.json {
        true => output::json(document(&resolved, &found, repeats.as_ref()))?,
        false => output::line(&text(&resolved, &found, repeats.as_ref()))?,
    }
    match (&command.out, &found.witness) {
        (Some(out), Some(_)) => {
            output::message(&format!("Witness: mishandle replay {}", shell_quote(&out.to_string_lossy())));
        }
        (Some(_), None) => output::message("there is no witness to write"),
        (None, _) => {}
    }
    if !found.is_complete || repeats.is_some_and(|repeats| repeats.simulations < Margin::REPEATS) {
        run::report_loss(found.simulations, kept_and_lost(&found));
        return Ok(ExitStatus::Interrupted);
    }
    ensure!(found.has_verdict(), "no simulation has a verdict, so the controller was not tested");
    Ok(if found.witness.is_some() { ExitStatus::Violated } else { ExitStatus::Done })
}

fn plan(command: &Arguments) -> Result<Plan> {
    let mut plan = flags::plan(&command.subject, &command.run)?;
    if command.subject.space.is_none() && command.subject.plan.is_none() {
        plan.space = Margin::SPACE.to_string();
    }
    let mut falsify: FalsifyPlan = plan.falsify.take().unwrap_or_default();
    falsify.formula = command.formula.clone().or(falsify.formula);
    Ok(Plan { falsify: Some(falsify), evaluate: None, risk: None, ..plan })
}

/// Describes what is left of an interrupted search.
fn kept_and_lost(found: &Margin) -> &'static str {
    match (&found.witness, found.is_complete) {
        (Some(_), true) => "the witness is kept, its repeats with other seeds are incomplete",
        (Some(_), false) => "the witness so far is kept, the search for a smaller disturbance is lost",
        (None, _) => "no violation was found so far, the search is lost",
    }
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
        subject::heading(resolved),
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
            scenario::axes(axes),
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
    if axes.is_empty() { "the nominal scenario".to_string() } else { scenario::text(&axes, &values) }
}

fn document(resolved: &ResolvedPlan, found: &Margin, repeats: Option<&RepeatReport>) -> Value {
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
            "scenario": scenario::document(resolved.space.axes(), episode.request.scenario.values()),
            "seed": episode.request.seed.0.to_string(),
            "robustness": episode.robustness().map(number),
            "repeats": repeats.map(repeats::document),
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
    output::joined(subject::document_without_run(resolved), own)
}
