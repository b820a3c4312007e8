mod export;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use clap::{Args, Subcommand};
use mishandle::counterexample::{Counterexample, CounterexampleReplay};
use mishandle::inspect::{FailureMode, FailureModes};
use mishandle::store::{AxisRecord, RunHeader};
use mishandle_text::{decimal, plural};
use serde_json::{Value, json};

use crate::output::{self, number};
use crate::{ExitStatus, escape, run};

/// List the failure modes of a run, or export counterexamples as files of a regression suite
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
#[command(after_help = "Examples:
  mishandle counterexamples runs/RUN.sqlite
  mishandle counterexamples export runs/RUN.sqlite --out failure.json --minimize
  mishandle counterexamples export runs/RUN.sqlite --all --out failures

A failure mode is a group of failures with the same decisive predicate, similar scenarios and
similar times. Its representative is the failure nearest to the nominal scenario.")]
pub struct Arguments {
    #[command(subcommand)]
    pub command: Option<CounterexamplesCommand>,
    /// Run file of `mishandle evaluate` or `mishandle falsify`
    #[arg(value_name = "RUN", required = true)]
    pub file: Option<PathBuf>,
    /// Do not check the whole run file before reading it; a record is still checked when it is read
    #[arg(long)]
    pub skip_check: bool,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Subcommand)]
pub enum CounterexamplesCommand {
    /// Write counterexamples as JSON files, which `replay`, `explain` and `regress` run
    Export(export::Arguments),
}

/// Number of axes in the text that describes the region of a mode.
const REGION_AXES: usize = 4;

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    if let Some(CounterexamplesCommand::Export(command)) = &command.command {
        return export::run(command);
    }
    let path = command.file.as_deref().unwrap_or(Path::new(""));
    let file = run::read(path, command.skip_check)?;
    let (header, found) = (file.header(), mishandle::inspect::failure_modes(&file)?);
    if command.json {
        output::json(document(path, header, &found))?;
        return Ok(ExitStatus::Done);
    }
    output::line(&text(header, &found))?;
    if !found.modes.is_empty() {
        output::message(&format!(
            "Export one with: mishandle counterexamples export {} --mode 1 --out FILE.json",
            run::name(&file)
        ));
    }
    Ok(ExitStatus::Done)
}

/// Returns whether a path names an exported counterexample rather than a run file.
pub fn is_file(path: &Path) -> bool {
    path.extension().is_some_and(|found| found.eq_ignore_ascii_case("json"))
}

/// Checks that no flag selects a simulation of an exported counterexample, which holds one.
pub fn check_flags(trial: Option<u32>, simulation: Option<u32>) -> Result<()> {
    ensure!(
        trial.is_none() && simulation.is_none(),
        "the file is one counterexample: --trial and --simulation select a simulation of a run file"
    );
    Ok(())
}

/// Reads an exported counterexample, simulates it again, and warns if another build made it. `controller` is the present path of its controller.
pub fn replay(path: &Path, controller: Option<&str>) -> Result<(Counterexample, CounterexampleReplay)> {
    let counterexample = read(path)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let replayed = counterexample.replay(&counterexample.resolve(folder, controller)?)?;
    for difference in &replayed.build_differences {
        output::message(&format!("warning: another build made the counterexample: {difference}"));
    }
    Ok((counterexample, replayed))
}

/// Reads an exported counterexample. Errors name its path.
pub fn read(path: &Path) -> Result<Counterexample> {
    match Counterexample::read(path) {
        // Names the path itself.
        Err(error @ mishandle::MishandleError::File { .. }) => Err(error.into()),
        read => read.with_context(|| path.display().to_string()),
    }
}

/// Returns the modes as JSON.
pub fn mode_documents(header: &RunHeader, found: &FailureModes) -> Vec<Value> {
    let time = |sample: usize| sample as f64 * header.control_dt;
    let named = |values: Vec<Value>| -> Value {
        header.axes.iter().map(|axis| axis.name.clone()).zip(values).collect()
    };
    let mode = |(index, mode): (usize, &FailureMode)| {
        let failure = mode.representative();
        let (first, last) = mode.samples;
        json!({
            "mode": index + 1,
            "failures": mode.failures.len(),
            "predicate": failure.predicate,
            "samples": [first, last],
            "times": [time(first), time(last)],
            "axes": mode.axes.iter().filter_map(|index| header.axes.get(*index)).map(|axis| axis.name.clone()).collect::<Vec<_>>(),
            "region": named(mode.region.iter().map(|range| json!(range.map(<[f64; 2]>::from))).collect()),
            "trial": failure.trial,
            "simulation": failure.number,
            "seed": failure.seed.to_string(),
            "scenario": named(failure.scenario.iter().map(|value| json!(value)).collect()),
            "robustness": number(failure.robustness),
            "distance_from_nominal": failure.distance_from_nominal,
        })
    };
    found.modes.iter().enumerate().map(mode).collect()
}

fn document(path: &Path, header: &RunHeader, found: &FailureModes) -> Value {
    json!({
        "run": path.to_string_lossy(),
        "target": header.target.name,
        "formula": header.formula,
        "failures": found.failures,
        "not_grouped": found.not_grouped,
        "modes": mode_documents(header, found),
    })
}

fn text(header: &RunHeader, found: &FailureModes) -> String {
    let (target, formula) = (escape::name(&header.target.name), escape::name(&header.formula));
    format!("{target}\nformula {formula}\n{}", modes_text(header, found))
}

/// Describes the modes: their number, a table, and their regions.
pub fn modes_text(header: &RunHeader, found: &FailureModes) -> String {
    let FailureModes { modes, failures, not_grouped } = found;
    let mut parts =
        vec![format!("{} in {}", plural(*failures, "failure"), plural(modes.len(), "failure mode"))];
    if !modes.is_empty() {
        parts.push(output::table(&table(header, modes)));
        let lines =
            modes.iter().zip(1..).map(|(mode, index)| format!("mode {index}: {}", region(header, mode)));
        parts.push(lines.collect::<Vec<_>>().join("\n"));
    }
    if *not_grouped > 0 {
        parts.push(format!(
            "{} in no mode: without a recorded trace, or above the limit of grouped failures",
            plural(*not_grouped, "failure")
        ));
    }
    parts.join("\n\n")
}

fn table(header: &RunHeader, modes: &[FailureMode]) -> Vec<Vec<String>> {
    let columns = [
        "mode",
        "failures",
        "decisive predicate",
        "final at",
        "representative",
        "robustness",
        "distance from nominal",
    ];
    let time = |sample: usize| mishandle_text::instant(sample, header.control_dt);
    let row = |(index, mode): (usize, &FailureMode)| {
        let failure = mode.representative();
        let (first, last) = mode.samples;
        let times = if first == last { time(first) } else { format!("{} to {}", time(first), time(last)) };
        let predicate = if failure.predicate.is_empty() { "none" } else { &failure.predicate };
        vec![
            (index + 1).to_string(),
            mode.failures.len().to_string(),
            predicate.to_string(),
            times,
            format!("trial {}, simulation {}", failure.trial, failure.number),
            decimal(failure.robustness, 4),
            format!("{:.0} % of the widths", 100.0 * failure.distance_from_nominal),
        ]
    };
    let rows = modes.iter().enumerate().map(row);
    std::iter::once(columns.map(String::from).to_vec()).chain(rows).collect()
}

/// Describes the ranges of a mode on the axes that matter, the narrowest first.
fn region(header: &RunHeader, mode: &FailureMode) -> String {
    if mode.axes.is_empty() {
        return "no axis distinguishes these failures from the other simulations".to_string();
    }
    let range = |index: &usize| {
        let range = mode.region.get(*index).copied().flatten()?;
        Some((header.axes.get(*index)?, range.into()))
    };
    let mut ranges: Vec<(&AxisRecord, [f64; 2])> = mode.axes.iter().filter_map(range).collect();
    let width = |(axis, [low, high]): &(&AxisRecord, [f64; 2])| (high - low) / (axis.high - axis.low);
    // Stable, so axes of equal width stay in the order of the space.
    ranges.sort_by(|a, b| width(a).total_cmp(&width(b)));
    let more = ranges.len().saturating_sub(REGION_AXES);
    let shown = ranges.iter().take(REGION_AXES).map(|(axis, [low, high])| {
        let recorded = mishandle::run::recorded_axis(axis);
        let value = |value: &f64| run::value_text(&recorded, Some(*value));
        let range = if low == high { value(low) } else { format!("{} to {}", value(low), value(high)) };
        run::axis_value(&escape::name(&axis.name), &range, &escape::name(&axis.unit))
    });
    let rest = if more > 0 { format!(", and {more} more") } else { String::new() };
    shown.collect::<Vec<_>>().join(", ") + &rest
}
