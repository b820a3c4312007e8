//! Questions about logs: which formulas they meet.

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use mishandle::results::{LogExplanation, LogVerdict};
use mishandle_logs::{Evaluation, NamedSamples, Requirement, Source};

use super::logs::{self, WrittenRequirement};
use crate::flags::LogQuestion;

/// Returns the files of each log.
pub fn sources(question: &LogQuestion, paths: &[PathBuf]) -> Result<Vec<Vec<Source>>> {
    let sources = question.log.logs(paths)?;
    logs::check_stdin(&sources)?;
    Ok(sources)
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

/// Reads each log and gives its verdicts to `each`, in the order of the flags.
pub fn ask(
    question: &LogQuestion,
    sources: &[Vec<Source>],
    mut each: impl FnMut(Asked<'_>) -> Result<()>,
) -> Result<()> {
    let requirements = requested(question, sources)?;
    let options = question.log.options();
    for (name, source) in logs::names(sources).into_iter().zip(sources) {
        let log = &logs::read(name, source, &requirements, &options)?;
        for requirement in &requirements {
            let verdict = log.verdict(requirement, question.strict_horizon);
            let verdict = verdict.with_context(|| format!("trace {}", log.name))?;
            let evaluation = requirement.evaluation(question.strict_horizon);
            each(Asked { log, requirement, evaluation, verdict })
                .with_context(|| format!("trace {}", log.name))?;
        }
    }
    Ok(())
}

/// Returns the formulas of all flags.
fn requirements(question: &LogQuestion) -> Result<Vec<WrittenRequirement>> {
    let unit = question.unit.as_deref().map(|text| logs::time_unit(text, "--unit")).transpose()?;
    let plain = |name: Option<&String>, text: &String| WrittenRequirement {
        name: name.cloned(),
        text: text.clone(),
        is_error: true,
        unit,
        description: None,
        units: BTreeMap::new(),
    };
    let mut found: Vec<WrittenRequirement> = question.formula.iter().map(|text| plain(None, text)).collect();
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
