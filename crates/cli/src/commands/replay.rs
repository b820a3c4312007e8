use std::path::Path;

use anyhow::{Result, bail};
use clap::Args;
use mishandle::rollout::Signal;
use mishandle::store::{self, SignalRecord};
use mishandle::{AxisValue, CounterexampleReplay, plural};
use serde_json::{Value, json};

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run::{self, counterexample};
use crate::show::output::{self, number};
use crate::show::{escape, scenario, simulation};

/// Replay a recorded simulation and check that the result is bit-identical
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle replay runs/RUN.sqlite                      the first counterexample
  mishandle replay runs/RUN.sqlite --trial 2 --simulation 17 --trace trace.csv
  mishandle replay runs/RUN.sqlite --trace trace.csv --record full
  mishandle replay failure.json                         an exported counterexample

Exit code 0 means that everything recorded of the simulation agrees with the plan of the run and
with the replay, bit for bit; 2 that something differs.")]
pub struct Arguments {
    #[command(flatten)]
    pub recorded: flags::Recorded,
    #[command(flatten)]
    pub trace: flags::TraceFile,
    /// Number of threads; does not affect the result [default: number of cores]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<usize>(flags::THREADS))]
    pub threads: Option<usize>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    run::set_threads(command.threads)?;
    if flags::is_file(&command.recorded.file) {
        return counterexample(command);
    }
    let file = run::read(&command.recorded.file, command.recorded.skip_check)?;
    let Some((trial, simulation)) =
        mishandle::select_simulation(&file, command.recorded.trial, command.recorded.simulation)?
    else {
        let in_trial = command.recorded.trial.map_or(String::new(), |trial| format!(" in trial {trial}"));
        bail!(
            "{} has no decided simulation{in_trial}; choose one with --simulation",
            command.recorded.file.display()
        );
    };
    let replayed = mishandle::replay(&file, trial, simulation, command.recorded.controller.as_deref())?;
    run::report_build_differences("made", &replayed.build_differences);
    let header = file.header();
    if let Some(path) = &command.trace.trace {
        let more = match command.trace.is_full() {
            true => {
                let controller = command.recorded.controller.as_deref();
                mishandle::full_trace(&mishandle::recorded_plan(header, controller)?, &replayed.episode)?
            }
            false => Vec::new(),
        };
        simulation::write_trace(path, header, &replayed.episode.trace, &more)?;
    }
    let robustness = replayed.episode.verdict.robustness;
    let scenario = &replayed.recorded.scenario;
    let named = || header.axes.iter().zip(scenario);
    let by_name: Value = named().map(|(axis, value)| (axis.name.clone(), json!(value))).collect();
    let signals: Vec<Signal> = header.signals.iter().map(signal).collect();
    if command.json {
        let value = |value: Option<f64>| value.map_or(Value::Null, number);
        output::json(json!({
            "run": command.recorded.file.to_string_lossy(),
            "target": header.target.name,
            "space": header.space,
            "axes": header.axes.iter().map(|axis| &axis.name).collect::<Vec<_>>(),
            "trial": trial,
            "simulation": simulation,
            "point": simulation::box_point(header, trial, scenario),
            "initial_configuration": scenario,
            "scenario": by_name,
            "seed": replayed.recorded.seed.to_string(),
            "end": simulation::end_text(replayed.episode.end, &signals),
            "steps": replayed.episode.steps,
            "robustness": value(robustness),
            "same": replayed.differences.is_empty(),
            "differences": replayed.differences,
        }))?;
    } else {
        let value = |(axis, value): (&store::AxisRecord, &Option<f64>)| {
            let recorded = mishandle::recorded_axis(axis);
            let value = match value {
                // All digits.
                Some(value) if recorded.levels().is_none() => value.to_string(),
                value => scenario::value_text(&recorded, *value),
            };
            scenario::axis_value(&escape::name(&axis.name), &value, &escape::name(&axis.unit))
        };
        let values: Vec<String> = named().map(value).collect();
        output::line(&format!(
            "{}, {}, seed {}\nformula {}\nrobustness {} after {}",
            simulation::text(header, &replayed.recorded),
            values.join(", "),
            replayed.recorded.seed,
            escape::name(&header.formula),
            robustness.map_or("undecided".to_string(), |rho| rho.to_string()),
            plural(replayed.episode.steps, "control step"),
        ))?;
        if !replayed.episode.end.has_verdict() {
            output::line(&simulation::end_text(replayed.episode.end, &signals))?;
        }
    }
    if !replayed.differences.is_empty() {
        bail!("{}", run::differences_text(&replayed.differences));
    }
    output::message("the replay is bit-identical to the record, which agrees with the plan of the run");
    Ok(ExitStatus::Done)
}

fn signal(recorded: &SignalRecord) -> Signal {
    Signal { name: recorded.name.clone(), unit: recorded.unit.clone() }
}

/// Replays an exported counterexample.
fn counterexample(command: &Arguments) -> Result<ExitStatus> {
    flags::check_flags(command.recorded.trial, command.recorded.simulation)?;
    let (recorded, replayed) =
        counterexample::replay(&command.recorded.file, command.recorded.controller.as_deref())?;
    let CounterexampleReplay { header, episode, differences, .. } = &replayed;
    if let Some(path) = &command.trace.trace {
        let folder = command.recorded.file.parent().unwrap_or(Path::new(""));
        let more = match command.trace.is_full() {
            true => {
                let controller = command.recorded.controller.as_deref();
                mishandle::full_trace(&recorded.resolve(folder, controller)?, episode)?
            }
            false => Vec::new(),
        };
        simulation::write_trace(path, header, &episode.trace, &more)?;
    }
    let signals: Vec<Signal> = header.signals.iter().map(signal).collect();
    let end = simulation::end_text(episode.end, &signals);
    let scenario = || recorded.scenario.iter();
    if command.json {
        output::json(json!({
            "run": command.recorded.file.to_string_lossy(),
            "target": recorded.target.name,
            "space": recorded.plan.space,
            "axes": scenario().map(|axis| &axis.axis).collect::<Vec<_>>(),
            "trial": recorded.trial,
            "simulation": recorded.simulation,
            "point": Value::Null,
            "initial_configuration": scenario().map(|axis| axis.value).collect::<Vec<_>>(),
            "scenario": scenario().map(|axis| (axis.axis.clone(), json!(axis.value))).collect::<Value>(),
            "seed": recorded.seed.to_string(),
            "end": end,
            "steps": episode.steps,
            "robustness": episode.robustness().map(number),
            "same": differences.is_empty(),
            "differences": differences,
        }))?;
    } else {
        let value = |axis: &AxisValue| {
            let value = axis.value.map_or("random".to_string(), |value| value.to_string());
            scenario::axis_value(&axis.axis, &value, &axis.unit)
        };
        output::line(&format!(
            "{}, {}, seed {}\nformula {}\nrobustness {} after {}",
            recorded.target.name,
            scenario().map(value).collect::<Vec<_>>().join(", "),
            recorded.seed,
            escape::name(&header.formula),
            episode.robustness().map_or("undecided".to_string(), |rho| rho.to_string()),
            plural(episode.steps, "control step"),
        ))?;
    }
    if !differences.is_empty() {
        bail!("the counterexample differs from the replay:\n  {}", differences.join("\n  "));
    }
    output::message("the replay is bit-identical to the counterexample");
    Ok(ExitStatus::Done)
}
