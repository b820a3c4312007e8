//! Verdicts of requirements on recorded logs.

use std::path::Path;

use anyhow::{Context, Result, anyhow, bail, ensure};
use mishandle::stl::{Formula, TimeUnit, name_hint, unquoted};
use mishandle_logs::{NamedSamples, OpenLog, Options, Requirement, Source};
use serde::Deserialize;

use crate::show::{formula_error, output};

/// A requirement whose formula was not parsed yet.
#[derive(Clone, Debug)]
pub struct WrittenRequirement {
    pub name: Option<String>,
    pub text: String,
    /// Whether a violation gives exit code 1.
    pub is_error: bool,
    /// The unit of bounds without one.
    pub unit: Option<TimeUnit>,
    pub description: Option<String>,
}

/// A file of requirements.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default)]
    requirement: Vec<Entry>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    name: String,
    formula: String,
    #[serde(default)]
    severity: Severity,
    unit: Option<String>,
    description: Option<String>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Severity {
    #[default]
    Error,
    Warning,
}

/// Reads a file of requirements; `unit` is that of bounds without one, where the file has none.
pub fn requirements(path: &Path, unit: Option<TimeUnit>) -> Result<Vec<WrittenRequirement>> {
    let shown = || format!("requirements {}", path.display());
    let text = std::fs::read_to_string(path).with_context(shown)?;
    let file: File = toml::from_str(&text)
        .map_err(|error| anyhow!("{}", error.to_string().trim_end()))
        .with_context(shown)?;
    ensure!(!file.requirement.is_empty(), "{} has no [[requirement]]", path.display());
    let mut found: Vec<WrittenRequirement> = Vec::new();
    for entry in file.requirement {
        ensure!(
            found.iter().all(|known| known.name.as_ref() != Some(&entry.name)),
            "{}: two requirements are named `{}`",
            path.display(),
            entry.name
        );
        let own = entry.unit.as_deref().map(|text| time_unit(text, "unit")).transpose();
        found.push(WrittenRequirement {
            unit: own.with_context(|| format!("{}: requirement `{}`", path.display(), entry.name))?.or(unit),
            name: Some(entry.name),
            text: entry.formula,
            is_error: entry.severity == Severity::Error,
            description: entry.description,
        });
    }
    Ok(found)
}

/// Reads the unit of bounds that have none.
pub fn time_unit(text: &str, flag: &str) -> Result<TimeUnit> {
    let known = TimeUnit::ALL.map(TimeUnit::symbol);
    TimeUnit::ALL
        .into_iter()
        .find(|unit| unit.symbol() == text)
        .with_context(|| format!("{flag} is `{text}`; it must be one of {}", known.join(", ")))
}

/// Parses the formulas, with hints about the names in the first log.
pub fn parsed(
    written: Vec<WrittenRequirement>,
    log: &[Source],
    options: &Options,
) -> Result<Vec<Requirement>> {
    let mut requirements = Vec::new();
    for WrittenRequirement { name, text, is_error, unit, description } in written {
        let formula = Formula::parse(&text).map_err(|error| {
            let message = formula_error::message(&text, &error);
            let named = name.as_ref().filter(|name| **name != text);
            let message = named.map_or(message.clone(), |name| format!("`{name}`: {message}"));
            match hint(&text, log, options) {
                Some(hint) => anyhow!("{message}\nhint: {hint}"),
                None => anyhow!("{message}"),
            }
        })?;
        output::warn_about(&formula);
        requirements.push(Requirement { name, formula, is_error, unit, description });
    }
    Ok(requirements)
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

/// Reads the signals of the requirements from a log.
pub fn read(
    name: String,
    log: &[Source],
    requirements: &[Requirement],
    options: &Options,
) -> Result<NamedSamples> {
    let formulas = requirements.iter().map(|requirement| &requirement.formula);
    let samples = OpenLog::open(log, options).and_then(|log| log.samples(formulas, options));
    Ok(NamedSamples { samples: samples.with_context(|| format!("trace {name}"))?, name })
}

/// Checks that stdin is read once.
pub fn check_stdin(logs: &[Vec<Source>]) -> Result<()> {
    let count = logs.iter().flatten().filter(|source| source.path.as_os_str() == "-").count();
    if count > 1 {
        bail!("stdin (-) can be read once");
    }
    Ok(())
}
