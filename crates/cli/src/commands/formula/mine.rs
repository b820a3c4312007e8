//! `formula` with parameters: their tightest values.

use std::path::PathBuf;

use anyhow::{Context, Result, bail, ensure};
use mishandle::plan::Settings;
use mishandle::stl::TimeUnit;
use mishandle_logs::Evaluation;
use mishandle_requirements::{MiningQuestion, NamedTrace, ParameterRange, check_names, mine};

use super::{Arguments, check_out};
use crate::exit_status::ExitStatus;
use crate::run::formula_context::{self, Drawn};
use crate::run::logs;
use crate::show::{mining, output};

/// Parses `LOW:HIGH`, with an optional unit of time at the end.
fn parameter(name: &str, range: &str) -> Result<ParameterRange> {
    let expected = || format!("--parameter {name} is {range}; expected a range, such as 0:50 or 0:5s");
    let (low, high) = range.split_once(':').with_context(expected)?;
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
        bail!("--parameter {name} is {range}; expected both ends in the same unit");
    }
    let (Some(low), Some(high)) = (number(low.trim()), number(high.trim())) else {
        bail!(expected());
    };
    Ok(ParameterRange { name: name.to_string(), low, high, unit: own, resolution: None })
}

/// Finds the tightest values of the parameters.
pub fn run(command: &Arguments, settings: &Settings) -> Result<ExitStatus> {
    let asked = &settings.formula;
    for (flag, is_given) in [
        ("--target", command.target.is_some()),
        ("--requirements", command.requirements.is_some()),
        ("--strict", command.strict),
    ] {
        ensure!(!is_given, "{flag} is for a formula without parameters");
    }
    let parameters = command.parameter.iter().map(|(name, range)| parameter(name, range));
    let mut parameters = parameters.collect::<Result<Vec<_>>>()?;
    for (name, step) in &asked.resolution {
        let parameter = parameters.iter_mut().find(|parameter| parameter.name == *name);
        let parameter = parameter.with_context(|| {
            format!("formula.resolution.{name} is set, but no --parameter declares {name}")
        })?;
        parameter.resolution = Some(*step);
    }
    check_names(&parameters)?;
    let options = settings.log.options()?;
    let unit = settings.log.unit;
    let (text, paths) = command.words.split_first().context("there is no formula")?;
    let (runs, paths): (Vec<PathBuf>, Vec<PathBuf>) =
        paths.iter().map(PathBuf::from).partition(|path| formula_context::is_run(path));
    let has_logs = runs.is_empty() || !paths.is_empty() || !settings.log.topics.is_empty();
    let sources = if has_logs { logs::sources(&settings.log, &paths)? } else { Vec::new() };
    let inputs = sources.iter().flatten().map(|source| source.path.as_path());
    check_out(command, "csv", inputs.chain(runs.iter().map(PathBuf::as_path)))?;
    let first = sources.first().map_or(&[][..], Vec::as_slice);
    let formula = logs::formula_with(text, &parameters, first, &options)?;
    let names: Vec<&str> = parameters.iter().map(|parameter| parameter.name.as_str()).collect();
    formula_context::refuse_signals(&sources, &options, &names)?;
    let evaluation = Evaluation { unit, strict_horizon: false };
    let mut drawn = formula_context::of_logs(&sources, &options, &formula, evaluation)?;
    let Some(simulated) = formula_context::of_runs(&runs, asked.simulations, unit)? else {
        return Ok(ExitStatus::Interrupted);
    };
    drawn.extend(simulated);
    let traces: Vec<NamedTrace> = drawn
        .into_iter()
        .map(|Drawn { name, trace, clock, start, .. }| NamedTrace { name, trace, clock, start })
        .collect();
    let question = MiningQuestion {
        formula: text,
        parameters: &parameters,
        share: asked.share,
        points: asked.points as usize,
        unit,
    };
    let found = mine(&question, &traces)?;
    if let Some(path) = &command.out {
        output::write_atomically(path, command.force, mining::csv(&found)?.as_bytes())?;
    }
    if command.json {
        output::json(&found)?;
    } else {
        output::line(&mining::text(&found, output::width()))?;
    }
    Ok(if found.points.is_empty() { ExitStatus::Violated } else { ExitStatus::Done })
}
