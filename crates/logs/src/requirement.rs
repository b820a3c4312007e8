//! Verdicts of requirements on logs, as the documents of `mishandle monitor`.

use std::collections::BTreeMap;

use mishandle_results::{
    LogPredicate, LogVerdict, LogViolation, Monitor, NoVerdict, Number, RequirementVerdict, Severity,
    Windows, WorstPart,
};
use mishandle_stl::{Formula, TimeUnit, Vacuity, is_violated};

use crate::error::Result;
use crate::log::{Log, OpenLog};
use crate::options::Options;
use crate::samples::Samples;
use crate::verdict::{At, Evaluation, Verdict};

/// A formula with a name.
#[derive(Clone, Debug)]
pub struct Requirement {
    /// The name; `None` for a formula that is alone.
    pub name: Option<String>,
    /// The formula.
    pub formula: Formula,
    /// Severity of a violation.
    pub severity: Severity,
    /// The unit of bounds without one; `None`: they count samples.
    pub unit: Option<TimeUnit>,
    /// Its purpose.
    pub description: Option<String>,
    /// Units of signals, which are shown with their values.
    pub units: BTreeMap<String, String>,
    /// Parts that often mean something else than their author thinks.
    pub traps: Vec<String>,
    /// Why it asks nothing of any log.
    pub certainty: Option<&'static str>,
}

impl Requirement {
    /// Returns how the formula is evaluated.
    pub fn evaluation(&self, strict_horizon: bool) -> Evaluation {
        Evaluation { unit: self.unit, strict_horizon }
    }

    /// Returns that the requirement has no verdict on a log.
    pub fn no_verdict(&self, log: &str, reason: String) -> NoVerdict {
        NoVerdict {
            log: log.to_string(),
            name: self.name.clone(),
            severity: self.severity,
            formula: self.formula.to_string(),
            reason,
        }
    }
}

/// The samples of a log with a name.
#[derive(Clone, Debug)]
pub struct NamedSamples {
    /// The name of the log.
    pub name: String,
    /// The samples.
    pub samples: Samples,
}

/// Returns the names of the signals of the formulas, each one once.
fn signals<'a>(formulas: impl IntoIterator<Item = &'a Formula>) -> Vec<&'a str> {
    let mut signals: Vec<&str> = formulas.into_iter().flat_map(Formula::signals).collect();
    signals.sort_unstable();
    signals.dedup();
    signals
}

impl OpenLog {
    /// Reads the signals of the formulas as the samples of each run of the log's clock.
    ///
    /// # Errors
    /// As for [`OpenLog::check_signals`], [`OpenLog::read`] and [`Log::samples_of_runs`].
    pub fn samples_of_runs<'a>(
        self,
        formulas: impl IntoIterator<Item = &'a Formula> + Clone,
        options: &Options,
    ) -> Result<Vec<Samples>> {
        for formula in formulas.clone() {
            self.check_signals(formula)?;
        }
        self.read(&signals(formulas))?.samples_of_runs(options)
    }
}

impl Log {
    /// Returns the names of all columns.
    pub fn names(&self) -> Vec<String> {
        self.topics.iter().flat_map(|topic| &topic.columns).map(|column| column.name.clone()).collect()
    }

    /// Keeps the columns that the formulas read.
    ///
    /// # Errors
    /// If the log lacks a signal.
    pub fn read_by<'a>(mut self, formulas: impl IntoIterator<Item = &'a Formula> + Clone) -> Result<Log> {
        let names = self.names();
        for formula in formulas.clone() {
            formula.check_names(&names)?;
        }
        let signals = signals(formulas);
        for topic in &mut self.topics {
            topic.columns.retain(|column| signals.contains(&column.name.as_str()));
        }
        self.topics.retain(|topic| !topic.columns.is_empty());
        Ok(self)
    }
}

impl NamedSamples {
    /// Names the samples of the runs of a log: after the log, and after the run if it has several.
    pub fn of_runs(log: &str, runs: Vec<Samples>) -> Vec<NamedSamples> {
        let named = |samples: Samples| NamedSamples {
            name: samples.run.as_ref().map_or_else(|| log.to_owned(), |run| run.named(log)),
            samples,
        };
        runs.into_iter().map(named).collect()
    }

    /// Returns the verdict of a requirement. With `strict_horizon`, only windows inside the log
    /// count.
    ///
    /// # Errors
    /// As for [`Samples::verdict`].
    pub fn verdict(&self, requirement: &Requirement, strict_horizon: bool) -> Result<LogVerdict> {
        let Requirement { name, formula, severity, description, .. } = requirement;
        let evaluation = requirement.evaluation(strict_horizon);
        let found = self.samples.verdict(formula, &evaluation)?;
        let is_violated = is_violated(found.robustness);
        let vacuity = match found.robustness {
            f64::INFINITY => Some(Vacuity::NoSample),
            _ if is_violated => None,
            _ => self.samples.vacuity(formula, &evaluation),
        };
        Ok(LogVerdict {
            log: self.name.clone(),
            name: name.clone(),
            description: description.clone(),
            severity: *severity,
            formula: formula.to_string(),
            robustness: found.robustness.into(),
            violated: is_violated,
            asks_nothing: match requirement.certainty.filter(|_| !is_violated) {
                Some(reason) => Some(reason.to_string()),
                None => vacuity.map(|found| found.reason(formula)),
            },
            traps: requirement.traps.clone(),
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

/// Returns the document of the verdicts, which are in the order of the questions: all requirements
/// on the first log, then on the next one. It has them worst first. `no_verdict` are the others,
/// `values` the robustness of the first requirement over time.
///
/// # Panics
/// If there is no verdict.
pub fn document(
    mut verdicts: Vec<LogVerdict>,
    no_verdict: Vec<NoVerdict>,
    logs: usize,
    strict_horizon: bool,
    values: Option<Vec<(At, f64)>>,
) -> Monitor {
    let named = verdicts.iter().filter(|_| logs == 1).filter_map(|verdict| {
        Some(RequirementVerdict {
            name: verdict.name.clone()?,
            formula: verdict.formula.clone(),
            robustness: Some(verdict.robustness),
            violated: Some(verdict.violated),
            asks_nothing: verdict.asks_nothing.clone(),
        })
    });
    let named: Vec<RequirementVerdict> = named.collect();
    let asked = (logs == 1).then(|| verdicts[0].clone());
    worst_first(&mut verdicts, |verdict| verdict);
    let first = asked.unwrap_or_else(|| verdicts[0].clone());
    let times = values.as_ref().and_then(|values| values.iter().map(|(at, _)| at.secs.map(Number)).collect());
    Monitor {
        robustness: first.robustness,
        violated: first.violated,
        asks_nothing: first.asks_nothing,
        windows: if strict_horizon { Windows::Whole } else { Windows::Cut },
        cuts_windows: first.cuts_windows,
        robustness_signal: values.map(|values| values.into_iter().map(|(_, value)| Number(value)).collect()),
        robustness_times: times,
        requirements: (!named.is_empty()).then_some(named),
        verdicts,
        no_verdict,
    }
}

/// Orders what has verdicts: violated formulas by their severity, satisfied formulas; within each,
/// the least robustness first.
pub fn worst_first<T>(found: &mut [T], verdict: impl Fn(&T) -> &LogVerdict) {
    let class = |verdict: &LogVerdict| {
        if verdict.violated {
            Severity::ALL.iter().position(|severity| *severity == verdict.severity)
        } else {
            Some(Severity::ALL.len())
        }
    };
    found.sort_by(|a, b| {
        let a = verdict(a);
        let b = verdict(b);
        class(a).cmp(&class(b)).then(a.robustness.0.total_cmp(&b.robustness.0))
    });
}

/// Numbers the logs that have the same name.
pub fn tell_apart(names: &mut [String]) {
    let given = names.to_vec();
    for (index, name) in names.iter_mut().enumerate() {
        let same = |other: &&String| **other == given[index];
        if given.iter().filter(same).count() > 1 {
            // A number that makes the name of a third log is skipped.
            let mut number = given[..=index].iter().filter(same).count();
            let numbered = |number: usize| format!("{} ({number})", given[index]);
            while given.contains(&numbered(number)) {
                number += given.len();
            }
            *name = numbered(number);
        }
    }
}
