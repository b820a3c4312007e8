//! Questions about logs: which formulas they meet.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use mishandle::results::{LogExplanation, LogVerdict, Severity};
use mishandle_logs::{Evaluation, NamedSamples, Requirement, Source};
use mishandle_text::plural;

use super::logs::{self, Unparsed};
use crate::flags::LogQuestion;
use crate::show::output;

/// Returns the files of each log.
pub fn sources(question: &LogQuestion, paths: &[PathBuf]) -> Result<Vec<Vec<Source>>> {
    let sources = question.log.logs(paths)?;
    logs::check_stdin(&sources)?;
    Ok(sources)
}

/// Returns the files that a question reads, which no output replaces.
pub fn inputs<'a>(question: &'a LogQuestion, sources: &'a [Vec<Source>]) -> impl Iterator<Item = &'a Path> {
    let logs = sources.iter().flatten().map(|source| source.path.as_path());
    logs.chain(question.formulas.as_deref())
}

/// Parses the formulas of all flags; an error may have a hint about the first log.
pub fn requested(question: &LogQuestion, sources: &[Vec<Source>]) -> Result<Vec<Requirement>> {
    logs::parsed(requirements(question)?, &sources[0], &question.log.options())
}

/// A verdict, and what it answers.
pub struct Asked<'a> {
    pub log: &'a NamedSamples,
    pub requirement: &'a Requirement,
    pub evaluation: Evaluation,
    pub verdict: LogVerdict,
}

impl Asked<'_> {
    /// Returns what decides the verdict, and the time of the first sample in seconds.
    pub fn explanation(&self) -> Result<(LogExplanation, f64)> {
        logs::explanation(self.log, self.requirement, &self.evaluation, &self.verdict)
    }
}

/// Numbers of what has no verdict.
#[derive(Clone, Copy, Debug, Default)]
pub struct Without {
    /// Logs without any verdict.
    logs: usize,
    /// Requirements on the other logs, each one on each log.
    requirements: usize,
}

impl Without {
    /// Requirements on the only log.
    pub fn requirements(requirements: usize) -> Without {
        Without { logs: 0, requirements }
    }
}

/// Reads each log and gives its verdicts to `each`, in the order of the flags. Returns what has
/// none, after a message for each; a log or a requirement that is alone is an error.
pub fn ask(
    question: &LogQuestion,
    sources: &[Vec<Source>],
    mut each: impl FnMut(Asked<'_>) -> Result<()>,
) -> Result<Without> {
    let requirements = requested(question, sources)?;
    let mut without = Without::default();
    for (name, source) in logs::names(sources).into_iter().zip(sources) {
        match verdicts(question, &name, source, &requirements, &mut each) {
            Err(error) if sources.len() > 1 => {
                output::report_error(&error);
                without.logs += 1;
            }
            found => without.requirements += found?,
        }
    }
    ensure!(without.logs < sources.len(), "no log has a verdict");
    Ok(without)
}

/// Gives the verdicts on a log to `each`. Returns the number of requirements without one, after a
/// message for each; it is an error if none has one.
fn verdicts(
    question: &LogQuestion,
    name: &str,
    source: &[Source],
    requirements: &[Requirement],
    each: &mut dyn FnMut(Asked<'_>) -> Result<()>,
) -> Result<usize> {
    let (log, readable, mut errors) =
        logs::read(name.to_owned(), source, requirements, &question.log.options())?;
    logs::note_truth_values(&log, &readable);
    let mut asked = Vec::new();
    for requirement in readable {
        match log.verdict(requirement, question.strict_horizon) {
            Ok(verdict) => {
                let evaluation = requirement.evaluation(question.strict_horizon);
                asked.push(Asked { log: &log, requirement, evaluation, verdict });
            }
            Err(error) => errors.push(logs::without_verdict(name, requirement, error)),
        }
    }
    if asked.is_empty()
        && let Some(error) = errors.drain(..).next()
    {
        return Err(error);
    }
    errors.iter().for_each(output::report_error);
    asked.into_iter().try_for_each(|asked| each(asked).with_context(|| format!("trace {name}")))?;
    Ok(errors.len())
}

/// Returns the error if logs or requirements have no verdict.
pub fn check_all(without: Without, logs: usize) -> Result<()> {
    let Without { logs: missing, requirements } = without;
    ensure!(missing == 0, "{missing} of {logs} logs have no verdict");
    ensure!(requirements == 0, "without a verdict: {}", plural(requirements as u64, "requirement"));
    Ok(())
}

/// Returns the formulas of all flags.
fn requirements(question: &LogQuestion) -> Result<Vec<Unparsed>> {
    let unit = question.unit.as_deref().map(|text| logs::time_unit(text, "--unit")).transpose()?;
    let plain = |name: Option<&String>, text: &String| Unparsed {
        name: name.cloned(),
        text: text.clone(),
        severity: Severity::Error,
        unit,
        description: None,
        units: BTreeMap::new(),
    };
    let mut found: Vec<Unparsed> = question.formula.iter().map(|text| plain(None, text)).collect();
    found.extend(question.requirement.iter().map(|(name, text)| plain(Some(name), text)));
    if let Some(path) = &question.formulas {
        found.extend(logs::requirements(path, unit)?);
    }
    ensure!(
        !found.is_empty(),
        "there is no formula: give --formula FORMULA, --requirement NAME=FORMULA, or --formulas FILE"
    );
    Ok(found)
}
