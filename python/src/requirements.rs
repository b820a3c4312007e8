//! Formulas in words with their traps, patterns, and mined parameters.

use std::collections::BTreeMap;

use mishandle::plan::{FormulaSettings, LogSettings, Settings};
use mishandle::results::{ExampleKind, FormulaDescription};
use mishandle::stl::{Formula, TimeUnit};
use mishandle_logs::{Evaluation, LogError, NamedSamples};
use mishandle_requirements::{
    Context, MiningQuestion, NamedTrace, ParameterRange, RequirementError, add_examples,
    describe_formula as describe, draw, parse_with_ranges, pattern, with_values,
};
use pyo3::prelude::*;

use crate::call::settings;
use crate::logs::{Contents, LogArgument};
use crate::words::worded;
use crate::work::json;
use crate::{InvalidValueError, plain, raised};

/// Width of texts, characters.
const WIDTH: usize = 100;

/// A parameter: name, least and greatest value, unit.
type ParameterArgument = (String, f64, f64, Option<String>);

/// Reads the samples of logs that a formula reads.
fn traces(
    py: Python<'_>,
    formula: &Formula,
    logs: Vec<LogArgument<'_>>,
    settings: &LogSettings,
) -> PyResult<Vec<NamedTrace>> {
    let options = settings.options().map_err(raised)?;
    let mut names: Vec<String> = logs.iter().map(|(name, ..)| name.clone()).collect();
    mishandle_logs::tell_apart(&mut names);
    let evaluation = Evaluation { unit: settings.unit, strict_horizon: false };
    let mut found = Vec::new();
    for (name, (_, files, topics)) in names.into_iter().zip(logs) {
        let named = |error: LogError| InvalidValueError::new_err(format!("trace {name}: {}", worded(&error)));
        let contents = Contents::new(files, topics, &options)?;
        let runs = py.detach(|| contents.runs(&name, [formula], &options)).map_err(named)?;
        for NamedSamples { name, samples } in runs {
            let (trace, clock, start) = samples.evenly(formula, &evaluation).map_err(named)?;
            found.push(NamedTrace { name, trace: trace.clone(), clock, start });
        }
    }
    Ok(found)
}

/// Returns the description of a formula, and its text.
#[pyfunction]
pub fn describe_formula(
    py: Python<'_>,
    text: &str,
    logs: Vec<LogArgument<'_>>,
    call: &str,
    units: BTreeMap<String, String>,
) -> PyResult<(String, String)> {
    let Settings { log, formula: FormulaSettings { episode: episode_secs, .. }, .. } = settings(call)?;
    let LogSettings { unit, period, .. } = log;
    let formula = Formula::parse(text).map_err(plain)?;
    let mut context = Context { unit, units, episode_secs, period, ..Context::default() };
    let traces = traces(py, &formula, logs, &log)?;
    if let Some(first) = traces.first() {
        context.period = first.clock.period_secs().or(context.period);
        context.samples = traces.iter().map(|trace| trace.trace.len()).min();
        context.traces = traces.iter().map(|trace| (trace.name.clone(), trace.trace.clone())).collect();
    }
    let describe = || -> Result<FormulaDescription, RequirementError> {
        let mut found = describe(&formula, &context)?;
        for NamedTrace { name, trace, clock, .. } in &traces {
            let example = draw(&formula, ExampleKind::Log, name, trace, *clock)?;
            found.examples.push(with_values(example, trace, &formula.signals()));
        }
        if traces.is_empty() {
            add_examples(&mut found, &formula, &context);
        }
        Ok(found)
    };
    let mut found = py.detach(describe).map_err(plain)?;
    let text = mishandle_cli::formula_text(&found, None, WIDTH);
    found
        .examples
        .iter_mut()
        .filter(|example| example.kind == ExampleKind::Log)
        .for_each(|example| example.values = None);
    Ok((json(&found)?, text))
}

/// Returns the formula of a pattern, and its sentence.
#[pyfunction]
pub fn pattern_formula(name: &str, settings: Vec<(String, String)>) -> PyResult<(String, String)> {
    pattern(name).and_then(|pattern| pattern.fill(&settings)).map_err(plain)
}

/// Returns parameters with the steps of settings.
fn ranges(
    parameters: Vec<ParameterArgument>,
    FormulaSettings { resolution, .. }: &FormulaSettings,
) -> PyResult<Vec<ParameterRange>> {
    if let Some(name) = resolution.keys().find(|name| parameters.iter().all(|(known, ..)| known != *name)) {
        let message = format!("plan[\"formula\"][\"resolution\"] names `{name}`, which is no parameter");
        return Err(InvalidValueError::new_err(message));
    }
    let unit_of = |symbol: String| {
        let unit = TimeUnit::ALL.into_iter().find(|unit| unit.symbol() == symbol);
        unit.ok_or_else(|| {
            let known = TimeUnit::ALL.map(TimeUnit::symbol).join(", ");
            InvalidValueError::new_err(format!("unit is `{symbol}`; it must be one of {known}"))
        })
    };
    let range = |(name, low, high, unit): ParameterArgument| {
        let resolution = resolution.get(&name).copied();
        Ok(ParameterRange { name, low, high, unit: unit.map(unit_of).transpose()?, resolution })
    };
    parameters.into_iter().map(range).collect()
}

/// Returns the signals of a formula with parameters.
#[pyfunction]
pub fn mined_signals(formula: &str, parameters: Vec<ParameterArgument>, call: &str) -> PyResult<Vec<String>> {
    let parameters = ranges(parameters, &settings(call)?.formula)?;
    mishandle_requirements::check_names(&parameters).map_err(plain)?;
    let formula = parse_with_ranges(formula, &parameters).map_err(plain)?;
    Ok(formula.signals().into_iter().map(str::to_owned).collect())
}

/// Returns the tightest values of the parameters for which logs satisfy a formula, and their text.
#[pyfunction]
pub fn mine(
    py: Python<'_>,
    formula: &str,
    parameters: Vec<ParameterArgument>,
    logs: Vec<LogArgument<'_>>,
    call: &str,
) -> PyResult<(String, String)> {
    let Settings { log, formula: asked, .. } = settings(call)?;
    let parameters = ranges(parameters, &asked)?;
    let parsed = parse_with_ranges(formula, &parameters).map_err(plain)?;
    let traces = traces(py, &parsed, logs, &log)?;
    let FormulaSettings { share, points, .. } = asked;
    let question =
        MiningQuestion { formula, parameters: &parameters, share, points: points as usize, unit: log.unit };
    let found = py.detach(|| mishandle_requirements::mine(&question, &traces)).map_err(plain)?;
    Ok((json(&found)?, mishandle_cli::mining_text(&found, WIDTH)))
}
