use std::path::PathBuf;

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use mishandle::ResolvedPlan;
use mishandle::inspect::Simulated;
use mishandle::rollout::{Axis, AxisValues, Scenario, Seed, Space};
use mishandle::stl::is_violated;
use mishandle_text::plural;

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run;
use crate::show::progress::Bar;
use crate::show::{output, reasons, scenario, simulation};

/// Simulate one chosen scenario, once or repeatedly with other random seeds
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle simulate ball-balancing --controller ppo --at 0.2,-0.14
  mishandle simulate ball-balancing --controller ppo --at 0.2,-0.14 --action-noise 0.5 --repeat 1000
  mishandle simulate ball-balancing --controller ppo --space starts+delay --at action_delay=2

Exit code 1 means that a simulation violated the formula.")]
pub struct Arguments {
    #[command(flatten)]
    pub subject: flags::Subject,
    #[command(flatten)]
    pub simulator: flags::Simulator,
    /// Scenario: one value per axis of the space, or NAME=VALUE for some axes; the others are
    /// nominal [default: the nominal scenario]
    #[arg(long, value_name = "X,Y,...", value_delimiter = ',', allow_hyphen_values = true)]
    pub at: Vec<String>,
    /// Number of simulations with different seeds; reports the failure rate of the scenario and
    /// quantiles of the robustness, and the share of its variance that comes from the scenario
    /// (`simulate.scenarios`)
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u32>(flags::REPEATS))]
    pub repeat: Option<u32>,
    /// Requirement: the name of a formula of the target, or the text of a formula [default: the
    /// target's first formula]
    #[arg(long, allow_hyphen_values = true)]
    pub formula: Option<String>,
    /// Write the trace to this CSV file; `-k trace.columns=full` adds joint positions and
    /// velocities, actions and contact forces of tasks and target files
    #[arg(long, value_name = "FILE", conflicts_with = "repeat")]
    pub trace: Option<PathBuf>,
    #[command(flatten)]
    pub run: flags::Run,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    run::set_threads(command.run.threads)?;
    let mut planned =
        flags::planned("simulate", &command.subject, &command.run)?.simulator(&command.simulator)?;
    planned.flag("--formula", "falsify.formula", command.formula.clone())?;
    let (plan, settings) = planned.question("falsify")?;
    let is_full = flags::is_full_trace(&settings.trace, command.trace.as_deref())?;
    let resolved = ResolvedPlan::new(&plan)?;
    output::warn_about(&resolved.specification.requirement);
    // Its errors say more than the end of a simulation that could not start.
    mishandle::resolve::contract_warnings(&resolved.plan)?;
    let given = scenario(&resolved.space, &resolved.target.spaces, &command.at)?;
    resolved.space.check(&given)?;
    let scenario = resolved.space.canonical(given.clone());
    for axis in resolved.space.inactive(&given) {
        let value = given.get(axis);
        let axis = &resolved.space.axes()[axis];
        // The value of a fixed axis is the nominal one.
        if value != axis.nominal || resolved.plan.axes.contains_key(&axis.name) {
            let needed: Vec<&str> = axis.conditions.iter().map(|needed| needed.axis.as_str()).collect();
            let name = &axis.name;
            let needed = needed.join(", ");
            output::message(&format!("warning: {name} has no effect with these values of {needed}"));
        }
    }
    for (axis, value) in resolved.space.axes().iter().zip(scenario.values()) {
        if let Some(value) = value.filter(|value| !(axis.low..=axis.high).contains(value)) {
            let Axis { name, low, high, .. } = axis;
            output::message(&format!("warning: {name} = {value} is outside of the space: [{low}, {high}]"));
        }
    }
    match command.repeat {
        Some(repeat) => repeated(command, &resolved, &scenario, repeat, settings.simulate.scenarios),
        None => once(command, &resolved, &scenario, is_full),
    }
}

/// Returns the scenario with the values of `--at`: those of all axes without a fixed value in
/// order, or some by name. `spaces` are those of the target.
fn scenario(space: &Space, spaces: &[Space], words: &[String]) -> Result<Scenario> {
    let axes = space.axes();
    let mut values = space.nominal().values().to_vec();
    let by_name = words.iter().filter(|word| word.contains('=')).count();
    if by_name == 0 && !words.is_empty() {
        let free: Vec<usize> = (0..axes.len()).filter(|index| !axes[*index].is_fixed()).collect();
        let names: Vec<&str> = free.iter().map(|index| axes[*index].name.as_str()).collect();
        ensure!(
            words.len() == free.len(),
            "--at has {} and the space {} {}: {}; give one value for each, or some as NAME=VALUE",
            plural(words.len(), "value"),
            space.name(),
            scenario::axes(free.len()),
            names.join(", ")
        );
        for (index, word) in free.into_iter().zip(words) {
            values[index] = Some(axis_value(&axes[index], word)?);
        }
        return Ok(Scenario::new(values));
    }
    ensure!(
        by_name == words.len(),
        "--at mixes values with NAME=VALUE; use one of the two forms, and decimal points"
    );
    let mut given = vec![false; axes.len()];
    for word in words {
        let (name, text) = word.split_once('=').unwrap_or_default();
        let Some(index) = axes.iter().position(|axis| axis.name == name.trim()) else {
            let name = name.trim().to_string();
            let has_axis = |other: &&Space| other.axes().iter().any(|axis| axis.name == name);
            if let Some(other) = spaces.iter().find(has_axis) {
                let own = space.name();
                let other = other.name();
                bail!("the axis {name} is not in the space {own} but in {other}; give --space {own}+{other}");
            }
            let known = axes.iter().map(|axis| axis.name.clone()).collect();
            return Err(mishandle::MishandleError::UnknownName { kind: "axis", name, known }.into());
        };
        ensure!(!std::mem::replace(&mut given[index], true), "--at sets {} twice", axes[index].name);
        values[index] = Some(axis_value(&axes[index], text)?);
    }
    Ok(Scenario::new(values))
}

/// Parses the value of an axis: a number, or the name of a category.
fn axis_value(axis: &Axis, text: &str) -> Result<f64> {
    let text = text.trim();
    if let AxisValues::Categorical(names) = &axis.values
        && let Some(index) = names.iter().position(|name| name == text)
    {
        // The first name is that of the lower bound.
        return Ok(axis.low + index as f64);
    }
    let expected = || format!("--at {}: expected a number in {}, found `{text}`", axis.name, unit(axis));
    match text.parse::<f64>().with_context(expected)? {
        value if value.is_finite() => Ok(value),
        _ => bail!(expected()),
    }
}

fn unit(axis: &Axis) -> &str {
    if axis.unit.is_empty() { "the unit of the axis" } else { &axis.unit }
}

/// Simulates the scenario once, with the seed of the command, and explains the result.
fn once(
    command: &Arguments,
    resolved: &ResolvedPlan,
    scenario: &Scenario,
    is_full: bool,
) -> Result<ExitStatus> {
    let mut simulated = mishandle::inspect::simulate(resolved, scenario, [Seed(resolved.plan.seed)])?;
    let Simulated { header, episode, result } = simulated.pop().context("the target returned no episode")?;
    let Some(robustness) = episode.robustness() else {
        let reason = reasons::of_one(result.reason.as_deref());
        bail!("the simulation has no verdict: {}{reason}", result.end.unwrap_or_default());
    };
    if let Some(path) = &command.trace {
        let more = if is_full { mishandle::picture::full_trace(resolved, &episode)? } else { Vec::new() };
        simulation::write_trace(path, &header, &episode.trace, &more)?;
    }
    if command.run.json {
        output::json(&result)?;
    } else {
        output::line(&simulation::text(&result))?;
    }
    Ok(if is_violated(robustness) { ExitStatus::Violated } else { ExitStatus::Done })
}

/// Simulates the scenario repeatedly, and random scenarios to measure the noise.
fn repeated(
    command: &Arguments,
    resolved: &ResolvedPlan,
    scenario: &Scenario,
    repeat: u32,
    scenarios: u32,
) -> Result<ExitStatus> {
    if !mishandle::resolve::depends_on_seed(resolved, scenario) {
        output::message("nothing is random in this target and plan, so the scenario is simulated once");
    }
    let bar = Bar::new(0, "simulations");
    run::stop_on_signals(&bar)?;
    let found = mishandle::run::repeat_scenario(
        resolved,
        scenario,
        Some(u64::from(repeat)),
        Some(u64::from(scenarios)),
        |done, total| {
            bar.set_length(total);
            bar.set_position(done);
            run::control_flow()
        },
    )?;
    bar.clear();
    if command.run.json {
        output::json(&found.result)?;
    } else {
        output::line(&simulation::text(&found.result))?;
    }
    let (repeats, total) = found.planned;
    let report = found.result.repeats.unwrap_or_default();
    if found.simulations < total {
        let kept = match report.simulations {
            n if n < repeats => {
                format!("the result is that of {n} of {}", plural(repeats, "repeat"))
            }
            _ => "all repeats are done".to_string(),
        };
        let lost = if total > repeats { ", the noise was not measured" } else { "" };
        run::report_loss(found.simulations, &format!("{kept}{lost}"));
        return Ok(ExitStatus::Interrupted);
    }
    ensure!(
        report.failure_rate.value.is_some(),
        "no simulation has a verdict, so the scenario was not tested"
    );
    Ok(if report.failures > 0 { ExitStatus::Violated } else { ExitStatus::Done })
}
