//! Verdicts of requirements on recorded logs.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail, ensure};
use mishandle::files::{limits, read_text_bounded};
use mishandle::inspect::{common_unit, explain_trace};
use mishandle::plan::LogSettings;
use mishandle::results::{FormulaTrap, LogExplanation, LogVerdict, Severity};
use mishandle::stl::{Clock, Formula, ParseError, TimeUnit, name_hint, unquoted};
use mishandle_logs::{Evaluation, LogError, NamedSamples, OpenLog, Options, Requirement, Signals, Source};
use mishandle_requirements::{
    ParameterRange, RequirementFile, WrittenRequirement, certainty, parse_with_ranges, start_traps,
};

use crate::show::{escape, formula_error, log_verdicts, output};

/// A requirement whose formula was not parsed yet.
#[derive(Clone, Debug)]
pub struct Unparsed {
    pub name: Option<String>,
    pub text: String,
    pub severity: Severity,
    /// The unit of bounds without one.
    pub unit: Option<TimeUnit>,
    pub description: Option<String>,
    pub units: Units,
}

/// Units by the names of signals.
type Units = BTreeMap<String, String>;

/// Reads a file of requirements; `unit` is that of bounds without one, where the file has none.
pub fn requirements(path: &Path, unit: Option<TimeUnit>) -> Result<Vec<Unparsed>> {
    let (file, _) = requirement_file(path)?;
    let units = file.units;
    let unparsed = |written: WrittenRequirement| Unparsed {
        unit: written.unit.or(unit),
        name: Some(written.name),
        text: written.formula,
        severity: written.severity,
        description: written.text,
        units: units.clone(),
    };
    Ok(file.requirements.into_iter().map(unparsed).collect())
}

/// Reads a file of requirements; returns also its text.
pub fn requirement_file(path: &Path) -> Result<(RequirementFile, String)> {
    let shown = || format!("requirements {}", path.display());
    let text = read_text_bounded(path, limits::PLAN).with_context(shown)?;
    let file = RequirementFile::from_toml(&text).with_context(shown)?;
    Ok((file, text))
}

/// Returns the files of each log: one for each path, or all topics together.
pub fn sources(log: &LogSettings, paths: &[PathBuf]) -> Result<Vec<Vec<Source>>> {
    let sources: Vec<Vec<Source>> = if log.topics.is_empty() {
        paths.iter().map(|path| vec![Source { topic: None, path: path.clone() }]).collect()
    } else {
        ensure!(paths.is_empty(), "log.topics names the files of one log; leave out {}", paths[0].display());
        let source =
            |(name, path): (&String, &String)| Source { topic: Some(name.clone()), path: path.into() };
        vec![log.topics.iter().map(source).collect()]
    };
    ensure!(
        !sources.is_empty(),
        "there is no log: name a file, or several topics with -k log.topics.NAME=FILE"
    );
    let count = sources.iter().flatten().filter(|source| source.path.as_os_str() == "-").count();
    ensure!(count <= 1, "stdin (-) can be read once");
    Ok(sources)
}

/// Parses the formulas, with hints about the names in the first log.
pub fn parsed(written: Vec<Unparsed>, log: &[Source], options: &Options) -> Result<Vec<Requirement>> {
    let mut requirements = Vec::new();
    for Unparsed { name, text, severity, unit, description, units } in written {
        let formula = formula(name.as_deref(), &text, log, options)?;
        output::warn_about(&formula);
        let traps = start_traps(&formula);
        for trap in &traps {
            output::message(&format!("{}: {}", trap.severity, escape::name(&trap.at_start())));
        }
        let traps = traps.iter().map(FormulaTrap::at_start).collect();
        let certainty = certainty(&formula);
        requirements.push(Requirement {
            name,
            formula,
            severity,
            unit,
            description,
            units,
            traps,
            certainty,
        });
    }
    let reads = |signal: &str| {
        requirements.iter().any(|found: &Requirement| found.formula.signals().contains(&signal))
    };
    if let Some(signal) =
        requirements.iter().flat_map(|found| found.units.keys()).find(|signal| !reads(signal))
    {
        bail!("[units] names `{signal}`, which no formula reads");
    }
    Ok(requirements)
}

/// Parses a formula, with a hint about the names in the log.
pub fn formula(name: Option<&str>, text: &str, log: &[Source], options: &Options) -> Result<Formula> {
    Formula::parse(text).map_err(|error| {
        let message = parse_error(text, &error, log, options);
        match name.filter(|name| *name != text) {
            Some(name) => anyhow!("`{name}`: {message}"),
            None => anyhow!("{message}"),
        }
    })
}

/// Parses a formula with parameters, with a hint about the names in the log.
pub fn formula_with(
    text: &str,
    parameters: &[ParameterRange],
    log: &[Source],
    options: &Options,
) -> Result<Formula> {
    parse_with_ranges(text, parameters)
        .map_err(|error| anyhow!("{}", parse_error(text, &error, log, options)))
}

fn parse_error(text: &str, error: &ParseError, log: &[Source], options: &Options) -> String {
    let message = formula_error::message(text, error);
    match hint(text, log, options) {
        Some(hint) => format!("{message}\nhint: {hint}"),
        None => message,
    }
}

/// Returns the hint on a formula that does not parse, if it has the name of a column without the
/// backquotes that it needs.
fn hint(text: &str, log: &[Source], options: &Options) -> Option<String> {
    if log.iter().any(|source| !source.path.is_file()) {
        return None;
    }
    let log = OpenLog::open(log, options).ok()?;
    name_hint(unquoted(text, log.names().iter().map(String::as_str))?)
}

/// Returns the name of each log: its files.
pub fn names(logs: &[Vec<Source>]) -> Vec<String> {
    let files = |log: &Vec<Source>| {
        log.iter().map(|source| source.path.display().to_string()).collect::<Vec<_>>().join(", ")
    };
    let mut names: Vec<String> = logs.iter().map(files).collect();
    mishandle_logs::tell_apart(&mut names);
    names
}

/// A requirement without a verdict on a log, and its error.
pub type Lacking<'a> = (&'a Requirement, anyhow::Error);

/// Reads the signals of the requirements from a log, as a log for each run of its clock; no log if
/// it has those of no requirement. Returns also the requirements whose signals it has, and each
/// other one with its error.
pub fn read<'a>(
    name: &str,
    log: &[Source],
    requirements: &'a [Requirement],
    options: &Options,
) -> Result<(Vec<NamedSamples>, Vec<&'a Requirement>, Vec<Lacking<'a>>)> {
    let trace = || format!("trace {name}");
    let log = OpenLog::open(log, options).with_context(trace)?;
    let mut readable = Vec::new();
    let mut errors = Vec::new();
    for requirement in requirements {
        match log.check_signals(&requirement.formula) {
            Ok(()) => readable.push(requirement),
            Err(error) => errors.push((requirement, without_verdict(name, requirement, error))),
        }
    }
    if readable.is_empty() {
        return Ok((Vec::new(), readable, errors));
    }
    let formulas: Vec<&Formula> = readable.iter().map(|requirement| &requirement.formula).collect();
    let runs = log.samples_of_runs(formulas, options).with_context(trace)?;
    Ok((NamedSamples::of_runs(name, runs), readable, errors))
}

/// Returns the error of a requirement that has no verdict on a log.
pub fn without_verdict(log: &str, requirement: &Requirement, error: LogError) -> anyhow::Error {
    let error = anyhow::Error::new(error);
    match &requirement.name {
        Some(name) => error.context(format!("trace {log}, requirement {}", escape::name(name))),
        None => error.context(format!("trace {log}")),
    }
}

/// Warns about signals with the values 0 and 1 that are formulas on their own: both satisfy them.
pub fn note_truth_values(log: &NamedSamples, requirements: &[&Requirement]) {
    let mut noted: Vec<String> = Vec::new();
    for text in requirements.iter().flat_map(|requirement| requirement.formula.subformulas()) {
        let Ok(formula) = Formula::parse(&text) else { continue };
        if let [signal] = formula.signals()[..]
            && formula.subformulas().len() == 1
            && text == mishandle::stl::spelled(signal)
            && log.samples.has_truth_values(signal)
            && !noted.contains(&text)
        {
            output::message(&format!(
                "note: a signal alone holds from 0 on, and {text} is 0 or 1: write {text} >= 1"
            ));
            noted.push(text);
        }
    }
}

/// Returns what decides a verdict, and the time of the first sample in seconds.
pub fn explanation(
    log: &NamedSamples,
    requirement: &Requirement,
    evaluation: &Evaluation,
    verdict: &LogVerdict,
) -> Result<(LogExplanation, f64)> {
    let Signals::Even { trace, period, start, .. } = &log.samples.signals else {
        bail!(
            "samples are explained: pass -k log.resample=hold|linear instead of log.dense; without --explain, \
             `mishandle monitor` reads dense time"
        );
    };
    ensure!(
        !evaluation.strict_horizon,
        "windows are cut at the end of the trace in an explanation: leave out log.strict-horizon"
    );
    let period = period.context(
        "the log has no times: pass the column with the times as -k log.time=COLUMN, or -k log.period=SECONDS",
    )?;
    let formula = &requirement.formula;
    let clock = log.samples.clock(formula, evaluation)?.unwrap_or(Clock::steps(period));
    let mut explained = explain_trace(formula, trace, clock)?;
    let unit = |name: &str| requirement.units.get(name).cloned();
    if let Some(predicate) = &explained.diagnosis.predicate {
        explained.unit = common_unit(&predicate.text, unit);
    }
    let time = |sample: usize| start + sample as f64 * period;
    let name = |sample| log_verdicts::instant(sample, time(sample));
    let unit = |name: &str| unit(name).unwrap_or_default();
    let decision = explained.result(&verdict.formula, trace, unit, time, name);
    Ok((LogExplanation { verdict: verdict.clone(), period, decision }, *start))
}
