//! Verdicts of requirements on recorded logs.

use std::path::Path;

use anyhow::{Context, Result, anyhow, bail, ensure};
use mishandle::results::{LogPredicate, LogVerdict, LogViolation, Number, WorstPart};
use mishandle::stl::{Formula, TimeUnit, is_violated, name_hint, unquoted};
use mishandle_logs::{At, Evaluation, OpenLog, Options, Samples, Source, Verdict};
use serde::Deserialize;

use crate::show::{formula_error, output};

/// A formula with a name.
#[derive(Clone, Debug)]
pub struct Requirement {
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
pub fn requirements(path: &Path, unit: Option<TimeUnit>) -> Result<Vec<Requirement>> {
    let shown = || format!("requirements {}", path.display());
    let text = std::fs::read_to_string(path).with_context(shown)?;
    let file: File = toml::from_str(&text)
        .map_err(|error| anyhow!("{}", error.to_string().trim_end()))
        .with_context(shown)?;
    ensure!(!file.requirement.is_empty(), "{} has no [[requirement]]", path.display());
    let mut found: Vec<Requirement> = Vec::new();
    for entry in file.requirement {
        ensure!(
            found.iter().all(|known| known.name.as_ref() != Some(&entry.name)),
            "{}: two requirements are named `{}`",
            path.display(),
            entry.name
        );
        let own = entry.unit.as_deref().map(|text| time_unit(text, "unit")).transpose();
        found.push(Requirement {
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
pub fn formulas(requirements: &[Requirement], log: &[Source], options: &Options) -> Result<Vec<Formula>> {
    let mut formulas = Vec::new();
    for requirement in requirements {
        let formula = Formula::parse(&requirement.text).map_err(|error| {
            let message = formula_error::message(&requirement.text, &error);
            let named = requirement.name.as_ref().filter(|name| **name != requirement.text);
            let message = named.map_or(message.clone(), |name| format!("`{name}`: {message}"));
            match hint(&requirement.text, log, options) {
                Some(hint) => anyhow!("{message}\nhint: {hint}"),
                None => anyhow!("{message}"),
            }
        })?;
        output::warn_about(&formula);
        formulas.push(formula);
    }
    Ok(formulas)
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

/// A log that was read for some formulas.
pub struct ReadLog {
    pub name: String,
    pub samples: Samples,
}

/// Reads the signals of the formulas from a log.
pub fn read(log: &[Source], formulas: &[Formula], options: &Options) -> Result<ReadLog> {
    let paths: Vec<String> = log.iter().map(|source| source.path.display().to_string()).collect();
    let name = paths.join(", ");
    let read = || -> Result<Samples> {
        let opened = OpenLog::open(log, options)?;
        let mut signals: Vec<&str> = Vec::new();
        for formula in formulas {
            opened.check_signals(formula)?;
            signals.extend(formula.signals());
        }
        signals.sort_unstable();
        signals.dedup();
        Ok(opened.read(&signals)?.samples(options)?)
    };
    let samples = read().with_context(|| format!("trace {name}"))?;
    Ok(ReadLog { name, samples })
}

impl ReadLog {
    /// Returns the verdict of a requirement.
    pub fn verdict(
        &self,
        requirement: &Requirement,
        formula: &Formula,
        strict_horizon: bool,
    ) -> Result<LogVerdict> {
        let evaluation = Evaluation { unit: requirement.unit, strict_horizon };
        let found = self.samples.verdict(formula, &evaluation)?;
        Ok(LogVerdict {
            log: self.name.clone(),
            name: requirement.name.clone(),
            description: requirement.description.clone(),
            severity: if requirement.is_error { "error" } else { "warning" }.to_string(),
            formula: formula.to_string(),
            robustness: found.robustness.into(),
            violated: is_violated(found.robustness),
            cuts_windows: found.cuts_windows,
            samples: found.samples.map(|samples| samples as u64),
            missing_values: self.samples.missing as u64,
            origin_ns: self.samples.origin_ns.and_then(|origin| i64::try_from(origin).ok()),
            violations: violations(&found),
            worst_part: found.part.as_ref().map(|part| WorstPart {
                formula: part.formula.clone(),
                robustness: part.worst.into(),
                time: part.at.secs.map(Number),
                sample: part.at.sample.map(|sample| sample as u64),
            }),
            predicate: found.predicate.map(|predicate| LogPredicate {
                formula: predicate.formula,
                time: predicate.at.secs.map(Number),
                sample: predicate.at.sample.map(|sample| sample as u64),
                values: predicate.values.map(Number),
                robustness: predicate.robustness.into(),
            }),
        })
    }
}

fn violations(found: &Verdict) -> Vec<LogViolation> {
    let number = |at: At| at.secs.map(Number);
    let sample = |at: At| at.sample.map(|sample| sample as u64);
    let each = found.violations.iter().map(|interval| LogViolation {
        formula: interval.formula.clone(),
        start: number(interval.start),
        end: number(interval.end),
        duration: interval.start.secs.zip(interval.end.secs).map(|(start, end)| Number(end - start)),
        start_sample: sample(interval.start),
        end_sample: sample(interval.end),
        worst: interval.worst.into(),
    });
    each.collect()
}

/// Orders verdicts: violated errors, violated warnings, satisfied formulas; within each, the least
/// robustness first.
pub fn worst_first(verdicts: &mut [LogVerdict]) {
    let class = |verdict: &LogVerdict| match (verdict.violated, verdict.severity.as_str()) {
        (true, "error") => 0,
        (true, _) => 1,
        (false, _) => 2,
    };
    verdicts.sort_by(|a, b| class(a).cmp(&class(b)).then(a.robustness.0.total_cmp(&b.robustness.0)));
}

/// Checks that stdin is read once.
pub fn check_stdin(logs: &[Vec<Source>]) -> Result<()> {
    let count = logs.iter().flatten().filter(|source| source.path.as_os_str() == "-").count();
    if count > 1 {
        bail!("stdin (-) can be read once");
    }
    Ok(())
}
