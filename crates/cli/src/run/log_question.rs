//! Questions about logs: which formulas they meet.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use mishandle::plan::LogSettings;
use mishandle::results::{LogExplanation, LogVerdict, NoVerdict, Severity};
use mishandle::verdict::{LogAnswer, untested};
use mishandle_logs::{Evaluation, NamedSamples, Options, Requirement, Source};
use mishandle_text::plural;

use super::logs::{self, Lacking, Unparsed};
use crate::exit_status::ExitStatus;
use crate::flags::LogQuestion;
use crate::show::{escape, output};
use crate::words;

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

/// Requirements and logs without a verdict.
#[derive(Debug, Default)]
pub struct Without {
    /// Each requirement on each log, in the order of the questions.
    pub list: Vec<NoVerdict>,
    /// Number of logs without any verdict.
    logs: usize,
    /// Number of requirements on the other logs, each one on each log.
    requirements: usize,
    /// The error of the only log, if that has no verdict.
    error: Option<anyhow::Error>,
}

impl Without {
    /// Requirements on the only log.
    pub fn requirements(requirements: usize) -> Without {
        Without { requirements, ..Without::default() }
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
        for (index, asked) in found.iter().enumerate() {
            if let Some(name) =
                asked.name.as_ref().filter(|_| found[..index].iter().any(|other| other.name == asked.name))
            {
                bail!("two requirements are named {}; give each its own name", escape::name(name));
            }
        }
        logs::parsed(found, &self.sources[0], &self.options)
    }

    /// Reads each log and gives its verdicts to `each`, in the order of the flags. Returns what has
    /// none, after a message for each but the only one, whose error is that of [`check_all`].
    pub fn ask(&self, mut each: impl FnMut(Asked<'_>) -> Result<()>) -> Result<Without> {
        let requirements = self.requirements()?;
        let mut without = Without::default();
        for (name, source) in logs::names(&self.sources).into_iter().zip(&self.sources) {
            let (verdicts, mut errors) = match self.verdicts(&name, source, &requirements, &mut each) {
                Ok((verdicts, lacking)) => {
                    let mut errors = Vec::new();
                    for (log, (requirement, error)) in lacking {
                        without.list.push(requirement.no_verdict(&log, reason(&error)));
                        errors.push(error);
                    }
                    (verdicts, errors)
                }
                Err(error) => {
                    let lacking = |asked: &Requirement| asked.no_verdict(&name, reason(&error));
                    without.list.extend(requirements.iter().map(lacking));
                    (0, vec![error])
                }
            };
            if verdicts > 0 {
                without.requirements += errors.len();
            } else {
                without.logs += 1;
                errors.truncate(1);
                without.error = if self.sources.len() == 1 { errors.pop() } else { None };
            }
            errors.iter().for_each(output::report_error);
        }
        Ok(without)
    }

    /// Gives the verdicts on a log, or on each run of its clock, to `each`. Returns their number,
    /// and an error for each requirement without one, with the name of the log.
    fn verdicts<'r>(
        &self,
        name: &str,
        source: &[Source],
        requirements: &'r [Requirement],
        each: &mut dyn FnMut(Asked<'_>) -> Result<()>,
    ) -> Result<(usize, Vec<(String, Lacking<'r>)>)> {
        let (runs, readable, errors) = logs::read(name, source, requirements, &self.options)?;
        let mut errors: Vec<_> = errors.into_iter().map(|lacking| (name.to_string(), lacking)).collect();
        if let Some(first) = runs.first() {
            logs::note_truth_values(first, &readable);
        }
        if runs.len() > 1 {
            output::message(&format!(
                "note: the times of {name} start again, so it is {} logs with a verdict each",
                runs.len()
            ));
        }
        let mut verdicts = 0;
        for (log, requirement) in runs.iter().flat_map(|log| readable.iter().map(move |found| (log, *found)))
        {
            let asked = match log.verdict(requirement, self.log.strict_horizon) {
                Ok(verdict) => {
                    let evaluation = requirement.evaluation(self.log.strict_horizon);
                    each(Asked { log, requirement, evaluation, verdict })
                        .with_context(|| format!("trace {}", log.name))
                }
                Err(error) => Err(logs::without_verdict(&log.name, requirement, error)),
            };
            match asked {
                Ok(()) => verdicts += 1,
                Err(error) => errors.push((log.name.clone(), (requirement, error))),
            }
        }
        Ok((verdicts, errors))
    }
}

/// Returns an error without its context, which names the log and the requirement.
fn reason(error: &anyhow::Error) -> String {
    let causes: Vec<_> = error.chain().collect();
    words::with_causes(causes.get(1..).filter(|causes| !causes.is_empty()).unwrap_or(&causes).iter().copied())
}

/// Returns the exit status of verdicts on logs, one of which can fail.
///
/// # Errors
/// If none fails, and a requirement asks nothing of every log, as [`untested`] says.
pub fn status<'a>(
    fails: bool,
    found: impl IntoIterator<Item = impl Into<LogAnswer<'a>>>,
) -> Result<ExitStatus> {
    if fails {
        return Ok(ExitStatus::Violated);
    }
    if let Some((requirement, reason)) = untested(found) {
        bail!("{} is satisfied and asks nothing: {}", escape::name(requirement), escape::name(reason));
    }
    Ok(ExitStatus::Done)
}

/// Returns the exit status of verdicts on logs.
///
/// # Errors
/// As for [`status`].
pub fn status_of<'a>(verdicts: impl Iterator<Item = &'a LogVerdict> + Clone) -> Result<ExitStatus> {
    status(verdicts.clone().any(LogVerdict::fails), verdicts)
}

/// Returns the exit status of a question about logs: a violation comes before what has no verdict,
/// which is then a message.
///
/// # Errors
/// If nothing is violated, and logs or requirements have no verdict, or as in `status`.
pub fn conclude(status: Result<ExitStatus>, without: Without, logs: usize) -> Result<ExitStatus> {
    match (status, check_all(without, logs)) {
        (Ok(ExitStatus::Violated), Err(error)) => {
            output::report_error(&error);
            Ok(ExitStatus::Violated)
        }
        (status, checked) => checked.and(status),
    }
}

/// Returns the error if logs or requirements have no verdict.
pub fn check_all(without: Without, logs: usize) -> Result<()> {
    let Without { logs: missing, requirements, error, .. } = without;
    if let Some(error) = error {
        return Err(error);
    }
    ensure!(missing < logs, "no log has a verdict");
    ensure!(missing == 0, "{missing} of {logs} logs have no verdict");
    ensure!(requirements == 0, "without a verdict: {}", plural(requirements as u64, "requirement"));
    Ok(())
}
