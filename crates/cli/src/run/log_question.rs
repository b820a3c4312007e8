//! Questions about logs: which formulas they meet.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use mishandle::plan::LogSettings;
use mishandle::results::{LogExplanation, LogVerdict, Severity};
use mishandle_logs::{Evaluation, NamedSamples, Options, Requirement, Source};
use mishandle_text::plural;

use super::logs::{self, Unparsed};
use crate::exit_status::ExitStatus;
use crate::flags::LogQuestion;
use crate::show::{escape, output};

/// Formulas, and the logs that they are about.
pub struct Question<'a> {
    flags: &'a LogQuestion,
    log: &'a LogSettings,
    pub options: Options,
    /// The files of each log.
    pub sources: Vec<Vec<Source>>,
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

impl Question<'_> {
    /// Returns the question of flags and settings about logs.
    pub fn new<'a>(flags: &'a LogQuestion, log: &'a LogSettings, paths: &[PathBuf]) -> Result<Question<'a>> {
        Ok(Question { flags, log, options: log.options()?, sources: logs::sources(log, paths)? })
    }

    /// Returns the files that the question reads, which no output replaces.
    pub fn inputs(&self) -> impl Iterator<Item = &Path> {
        let logs = self.sources.iter().flatten().map(|source| source.path.as_path());
        logs.chain(self.flags.requirements.as_deref())
    }

    /// Parses the formulas of all flags; an error may have a hint about the first log.
    pub fn requirements(&self) -> Result<Vec<Requirement>> {
        let unit = self.log.unit;
        let plain = |name: Option<&String>, text: &String| Unparsed {
            name: name.cloned(),
            text: text.clone(),
            severity: Severity::Error,
            unit,
            description: None,
            units: BTreeMap::new(),
        };
        let mut found: Vec<Unparsed> = self.flags.formula.iter().map(|text| plain(None, text)).collect();
        found.extend(self.flags.requirement.iter().map(|(name, text)| plain(Some(name), text)));
        if let Some(path) = &self.flags.requirements {
            found.extend(logs::requirements(path, unit)?);
        }
        ensure!(
            !found.is_empty(),
            "there is no formula: give --formula FORMULA, --requirement NAME=FORMULA, or --requirements FILE"
        );
        logs::parsed(found, &self.sources[0], &self.options)
    }

    /// Reads each log and gives its verdicts to `each`, in the order of the flags. Returns what has
    /// none, after a message for each; a log or a requirement that is alone is an error.
    pub fn ask(&self, mut each: impl FnMut(Asked<'_>) -> Result<()>) -> Result<Without> {
        let requirements = self.requirements()?;
        let mut without = Without::default();
        for (name, source) in logs::names(&self.sources).into_iter().zip(&self.sources) {
            match self.verdicts(&name, source, &requirements, &mut each) {
                Err(error) if self.sources.len() > 1 => {
                    output::report_error(&error);
                    without.logs += 1;
                }
                found => without.requirements += found?,
            }
        }
        ensure!(without.logs < self.sources.len(), "no log has a verdict");
        Ok(without)
    }

    /// Gives the verdicts on a log, or on each run of its clock, to `each`. Returns the number of
    /// requirements without one, after a message for each; it is an error if none has one.
    fn verdicts(
        &self,
        name: &str,
        source: &[Source],
        requirements: &[Requirement],
        each: &mut dyn FnMut(Asked<'_>) -> Result<()>,
    ) -> Result<usize> {
        let (runs, readable, mut errors) = logs::read(name, source, requirements, &self.options)?;
        if let Some(first) = runs.first() {
            logs::note_truth_values(first, &readable);
        }
        if runs.len() > 1 {
            output::message(&format!(
                "note: the times of {name} start again, so it is {} logs with a verdict each",
                runs.len()
            ));
        }
        let mut asked = Vec::new();
        for (log, requirement) in runs.iter().flat_map(|log| readable.iter().map(move |found| (log, *found)))
        {
            match log.verdict(requirement, self.log.strict_horizon) {
                Ok(verdict) => {
                    let evaluation = requirement.evaluation(self.log.strict_horizon);
                    asked.push(Asked { log, requirement, evaluation, verdict });
                }
                Err(error) => errors.push(logs::without_verdict(&log.name, requirement, error)),
            }
        }
        if asked.is_empty()
            && let Some(error) = errors.drain(..).next()
        {
            return Err(error);
        }
        errors.iter().for_each(output::report_error);
        for asked in asked {
            let name = asked.log.name.clone();
            each(asked).with_context(|| format!("trace {name}"))?;
        }
        Ok(errors.len())
    }
}

/// Returns the exit status of verdicts, one of which can fail: each with its requirement and the
/// reason for which it asks nothing.
///
/// # Errors
/// If none fails, and a requirement asks nothing of any log; warnings do not count.
pub fn status<'a>(
    fails: bool,
    found: impl IntoIterator<Item = (String, Severity, Option<&'a str>)>,
) -> Result<ExitStatus> {
    if fails {
        return Ok(ExitStatus::Violated);
    }
    let mut reasons: BTreeMap<String, Option<&str>> = BTreeMap::new();
    for (requirement, severity, reason) in found {
        let reason = reason.filter(|_| severity != Severity::Warning);
        let known = reasons.entry(requirement).or_insert(reason);
        *known = known.and(reason);
    }
    let first = reasons.iter().find_map(|(requirement, reason)| Some((requirement, (*reason)?)));
    if let Some((requirement, reason)) = first {
        bail!("{} is satisfied and asks nothing: {}", escape::name(requirement), escape::name(reason));
    }
    Ok(ExitStatus::Done)
}

/// Returns the exit status of verdicts on logs.
///
/// # Errors
/// As for [`status`].
pub fn status_of<'a>(verdicts: impl Iterator<Item = &'a LogVerdict> + Clone) -> Result<ExitStatus> {
    let fails = verdicts.clone().any(LogVerdict::fails);
    let found = verdicts.map(|found| {
        let name = found.name.clone().unwrap_or_else(|| found.formula.clone());
        (name, found.severity, found.asks_nothing.as_deref())
    });
    status(fails, found)
}

/// Returns the error if logs or requirements have no verdict.
pub fn check_all(without: Without, logs: usize) -> Result<()> {
    let Without { logs: missing, requirements } = without;
    ensure!(missing == 0, "{missing} of {logs} logs have no verdict");
    ensure!(requirements == 0, "without a verdict: {}", plural(requirements as u64, "requirement"));
    Ok(())
}
