use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use mishandle::stl::TimeUnit;
use mishandle_logs::Evaluation;
use mishandle_requirements::{MAX_POINTS, MiningQuestion, NamedTrace, ParameterRange, check_names, mine};

use crate::exit_status::ExitStatus;
use crate::flags::{LogFlags, numbers};
use crate::run::formula_context::{self, Drawn};
use crate::run::logs;
use crate::show::{mining, output};

/// Shares of traces.
const SHARE: &str = "a number above 0 and at most 1, such as 0.95";

fn is_share(share: f64) -> bool {
    share > 0.0 && share <= 1.0
}

/// Find the tightest values of parameters for which logs or runs satisfy a formula
#[derive(Debug, Args)]
#[command(
    after_help = "A parameter is a name in the formula: a number, or a bound of a window. Its direction comes from
the formula: `force <= limit` is tighter with a smaller limit, `always[0:T] p` with a greater T.

Examples:
  mishandle mine --formula 'always(force <= limit)' --parameter limit=0:50 logs/*.csv
  mishandle mine --formula 'eventually[0:T](d <= 0.1)' --parameter T=0:5s runs/RUN.sqlite
  mishandle mine --formula 'eventually[0:T] always(abs(x - 1) <= band)' \\
      --parameter T=0:5s --parameter band=0:1 --resolution band=0.01 logs/*.csv

One parameter has one tightest value, exact to the next number, or for a bound to the next sample.
Several have a Pareto front: no parameter of a point can be tighter without another one that is
looser. Windows are cut at the end of a log, as in `mishandle monitor`. If the ends of the ranges
decide, the output says so. docs/guide/requirements.md describes mining.

Exit code 1 means that even the loosest values violate the formula."
)]
pub struct Arguments {
    /// Files with a log each, or run files of `evaluate` and `falsify`, whose random simulations
    /// are simulated again; - reads stdin
    #[arg(value_name = "LOG")]
    pub logs: Vec<PathBuf>,
    /// Formula with the names of the parameters
    #[arg(long, allow_hyphen_values = true)]
    pub formula: String,
    /// Parameter and the range of its values; a bound of a window has a unit, such as T=0:5s, or
    /// counts samples. Repeat the flag for several
    #[arg(long, value_name = "NAME=LOW:HIGH", required = true, allow_hyphen_values = true, value_parser = range)]
    pub parameter: Vec<ParameterRange>,
    /// Step of the values of a parameter [default: exact, or the sampling period for a bound]
    #[arg(long, value_name = "NAME=STEP", value_parser = resolution)]
    pub resolution: Vec<(String, f64)>,
    /// Share of the logs that must satisfy the formula
    #[arg(long, value_name = "SHARE", default_value = "1", allow_negative_numbers = true, value_parser = numbers::number(SHARE, is_share))]
    pub share: f64,
    /// Number of points of the Pareto front of several parameters
    #[arg(long, value_name = "N", default_value = "10", allow_negative_numbers = true, value_parser = numbers::integer::<u32>(2..=MAX_POINTS as u64))]
    pub points: u32,
    /// Largest number of random simulations of each run file, evenly chosen
    #[arg(long, value_name = "N", default_value = "200", allow_negative_numbers = true, value_parser = numbers::integer::<u64>(1..=u64::MAX))]
    pub simulations: u64,
    /// Unit of interval bounds without a unit: s, ms, us or ns [default: such bounds count samples]
    #[arg(long)]
    pub unit: Option<String>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
    /// File to create with the points as CSV
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
    /// Overwrite the file of --csv
    #[arg(long)]
    pub force: bool,
    #[command(flatten)]
    pub log: LogFlags,
}

/// Parses `NAME=LOW:HIGH`, with an optional unit of time at the end.
fn range(text: &str) -> std::result::Result<ParameterRange, String> {
    let expected = || "expected a name and a range, such as limit=0:50 or T=0:5s".to_string();
    let (name, range) = text.split_once('=').ok_or_else(expected)?;
    let (low, high) = range.split_once(':').ok_or_else(expected)?;
    // `ms` before `s`.
    let unit = |text: &str| {
        let units = TimeUnit::ALL.into_iter().filter(|unit| text.ends_with(unit.symbol()));
        units.max_by_key(|unit| unit.symbol().len())
    };
    let number = |text: &str| {
        let digits = unit(text).map_or(text, |unit| &text[..text.len() - unit.symbol().len()]);
        digits.trim().parse::<f64>().ok().filter(|value| value.is_finite())
    };
    let own = unit(high.trim());
    let other = unit(low.trim());
    if other.is_some() && other != own {
        return Err("expected both ends of the range in the same unit".to_string());
    }
    let (Some(low), Some(high)) = (number(low.trim()), number(high.trim())) else {
        return Err(expected());
    };
    Ok(ParameterRange { name: name.trim().to_string(), low, high, unit: own, resolution: None })
}

/// Parses `NAME=STEP`.
fn resolution(text: &str) -> std::result::Result<(String, f64), String> {
    let found = text
        .split_once('=')
        .and_then(|(name, step)| Some((name.trim().to_string(), step.trim().parse().ok()?)));
    found.ok_or_else(|| "expected a name and a step, such as limit=0.1".to_string())
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    let mut parameters = command.parameter.clone();
    for (name, step) in &command.resolution {
        let Some(parameter) = parameters.iter_mut().find(|parameter| parameter.name == *name) else {
            anyhow::bail!("--resolution names `{name}`, which no --parameter declares");
        };
        parameter.resolution = Some(*step);
    }
    check_names(&parameters)?;
    let options = command.log.options();
    let (runs, paths): (Vec<PathBuf>, Vec<PathBuf>) =
        command.logs.iter().cloned().partition(|path| formula_context::is_run(path));
    let has_logs = runs.is_empty() || !paths.is_empty() || !command.log.topic.is_empty();
    let sources = if has_logs { command.log.logs(&paths)? } else { Vec::new() };
    logs::check_stdin(&sources)?;
    if let Some(path) = &command.csv {
        let inputs = sources.iter().flatten().map(|source| source.path.as_path());
        output::refuse_inputs(path, "--csv", inputs.chain(runs.iter().map(PathBuf::as_path)))?;
        drop(output::create(path, command.force)?);
    }
    let unit = command.unit.as_deref().map(|text| logs::time_unit(text, "--unit")).transpose()?;
    let first = sources.first().map_or(&[][..], Vec::as_slice);
    let formula = logs::formula_with(&command.formula, &parameters, first, &options)?;
    let names: Vec<&str> = parameters.iter().map(|parameter| parameter.name.as_str()).collect();
    formula_context::refuse_signals(&sources, &options, &names)?;
    let evaluation = Evaluation { unit, strict_horizon: false };
    let mut drawn = formula_context::of_logs(&sources, &options, &formula, evaluation)?;
    let Some(simulated) = formula_context::of_runs(&runs, command.simulations, unit)? else {
        return Ok(ExitStatus::Interrupted);
    };
    drawn.extend(simulated);
    let traces: Vec<NamedTrace> = drawn
        .into_iter()
        .map(|Drawn { name, trace, clock, start, .. }| NamedTrace { name, trace, clock, start })
        .collect();
    let question = MiningQuestion {
        formula: &command.formula,
        parameters: &parameters,
        share: command.share,
        points: command.points as usize,
        unit,
    };
    let found = mine(&question, &traces)?;
    if let Some(path) = &command.csv {
        output::write_atomically(path, command.force, mining::csv(&found)?.as_bytes())?;
    }
    if command.json {
        output::json(&found)?;
    } else {
        output::line(&mining::text(&found, output::width()))?;
    }
    Ok(if found.points.is_empty() { ExitStatus::Violated } else { ExitStatus::Done })
}
