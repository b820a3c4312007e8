//! Whether recorded logs satisfy formulas.

use std::collections::BTreeMap;

use mishandle_results::{LogVerdict, LogViolation, Monitor, NoVerdict, Number, Severity};
use mishandle_text::{measured, number_text, plural};

use super::{Conclusion, Verdict};

/// Number of violations, and of reasons, that a verdict lists.
const LISTED: usize = 10;

/// Returns what the verdicts on logs mean. `logs` is the number of logs.
pub fn monitor(found: &Monitor, logs: usize) -> Verdict {
    if let ([only], [], ..=1) = (&found.verdicts[..], &found.no_verdict[..], logs) {
        return log(only);
    }
    let all = found.verdicts.len() + found.no_verdict.len();
    let verdicts = || found.verdicts.iter();
    let count = |count: usize, what: &str| (count > 0).then(|| format!("{count} {what}"));
    let is_untested = |verdict: &&LogVerdict| !verdict.violated && verdict.asks_nothing.is_some();
    let counts: Vec<String> = [
        count(verdicts().filter(|verdict| verdict.violated).count(), "violated"),
        count(found.no_verdict.len(), "without a verdict"),
        count(verdicts().filter(is_untested).count(), "satisfied: asks nothing"),
        count(verdicts().filter(|verdict| verdict.words() == "satisfied").count(), "satisfied"),
    ]
    .into_iter()
    .flatten()
    .collect();
    let of_logs = format!("{} of {}", plural(all, "verdict"), plural(logs, "log"));
    let conclusion = match conclusion(verdicts()) {
        Conclusion::Holds if !found.no_verdict.is_empty() => Conclusion::NoVerdict,
        conclusion => conclusion,
    };
    let mut verdict = Verdict::new(conclusion, format!("{of_logs}: {}", counts.join(", ")));
    verdict.table = log_table(&found.verdicts, &found.no_verdict, logs > 1);
    for untested in verdicts().filter(is_untested).take(LISTED) {
        let reason = untested.asks_nothing.as_deref().unwrap_or_default();
        verdict.add("asks nothing", format!("{}: {reason}", log_title(untested)));
    }
    verdict
}

/// Returns what the verdict of a formula on a log means: when it is violated, how long, and by
/// which part.
pub fn log(found: &LogVerdict) -> Verdict {
    let headline = format!(
        "{}: {} is {}, robustness {}",
        log_title(found),
        found.formula,
        judgment(found),
        measured(found.robustness.0 + 0.0)
    );
    let mut verdict = Verdict::new(conclusion(std::iter::once(found)), headline);
    verdict.add("asks nothing", found.asks_nothing.as_deref().unwrap_or_default());
    // A part can be violated although the formula is not, where the formula has an `or`.
    if found.violated {
        for violation in found.violations.iter().take(LISTED) {
            verdict.add("when", format!("{} violated {}", violation.formula, interval(violation)));
        }
        if let Some(more) = found.violations.len().checked_sub(LISTED + 1) {
            verdict.add("when", format!("and {} more times", more + 1));
        }
    }
    if let Some(predicate) = &found.predicate {
        let [left, right] = predicate.values.map(|value| measured(value.0 + 0.0));
        let at = at(predicate.time, predicate.sample);
        verdict.add("decided by", format!("{} at {at}: {left} against {right}", predicate.formula));
    }
    verdict
}

/// Names the log and the requirement of a verdict.
fn log_title(found: &LogVerdict) -> String {
    found.name.as_ref().map_or(found.log.clone(), |name| format!("{}, {name}", found.log))
}

/// Returns the table of the formulas on the logs: violated ones, those without a verdict, satisfied
/// ones. The first row is the head.
pub fn log_table(verdicts: &[LogVerdict], without: &[NoVerdict], has_logs: bool) -> Vec<Vec<String>> {
    let has_names = verdicts.iter().any(|found| found.name.is_some())
        || without.iter().any(|lacking| lacking.name.is_some());
    let head = ["log", "requirement", "verdict", "robustness", "first violation", "in all", "formula"];
    let is_shown = |column: usize| (column != 0 || has_logs) && (column != 1 || has_names);
    let kept = |row: [String; 7]| -> Vec<String> {
        row.into_iter().enumerate().filter(|(column, _)| is_shown(*column)).map(|(_, cell)| cell).collect()
    };
    let none = || "-".to_string();
    let name = |name: &Option<String>| name.clone().unwrap_or_else(none);
    let judged = |found: &LogVerdict| {
        let first = found.violations.first().filter(|_| found.violated);
        kept([
            found.log.clone(),
            name(&found.name),
            judgment(found),
            measured(found.robustness.0 + 0.0),
            first.map_or_else(none, |violation| at(violation.start, violation.start_sample)),
            total(found).unwrap_or_else(none),
            found.formula.clone(),
        ])
    };
    let lacks = |lacking: &NoVerdict| {
        let verdict = "no verdict".to_string();
        let (log, formula) = (lacking.log.clone(), lacking.formula.clone());
        kept([log, name(&lacking.name), verdict, none(), none(), none(), formula])
    };
    let (violated, satisfied) = verdicts.split_at(verdicts.partition_point(|found| found.violated));
    std::iter::once(kept(head.map(String::from)))
        .chain(violated.iter().map(judged))
        .chain(without.iter().map(lacks))
        .chain(satisfied.iter().map(judged))
        .collect()
}

fn conclusion<'a>(found: impl Iterator<Item = &'a LogVerdict> + Clone) -> Conclusion {
    if found.clone().any(LogVerdict::fails) {
        Conclusion::Fails
    } else if untested(found).is_some() {
        Conclusion::NoVerdict
    } else {
        Conclusion::Holds
    }
}

/// Returns a requirement that asks nothing of every log, with the reason; `None` if each one asks
/// something of a log. One with the severity `warning` does not count, unless no other one asks
/// something.
pub fn untested<'a>(found: impl IntoIterator<Item = impl Into<LogAnswer<'a>>>) -> Option<(&'a str, &'a str)> {
    let mut reasons: BTreeMap<&str, (Severity, Option<&str>)> = BTreeMap::new();
    for found in found {
        let LogAnswer { requirement, severity, asks_nothing } = found.into();
        let (_, known) = reasons.entry(requirement).or_insert((severity, asks_nothing));
        *known = known.and(asks_nothing);
    }
    let nothing = reasons.values().all(|(_, reason)| reason.is_some());
    reasons.into_iter().find_map(|(requirement, (severity, reason))| {
        let counts = nothing || severity != Severity::Warning;
        Some((requirement, reason.filter(|_| counts)?))
    })
}

/// The demand of a requirement on a log.
#[derive(Clone, Copy, Debug)]
pub struct LogAnswer<'a> {
    /// Name of the requirement, or its formula.
    pub requirement: &'a str,
    /// Its severity.
    pub severity: Severity,
    /// Why it asks nothing of the log; `None` if it asks something.
    pub asks_nothing: Option<&'a str>,
}

impl<'a> From<&'a LogVerdict> for LogAnswer<'a> {
    fn from(found: &'a LogVerdict) -> LogAnswer<'a> {
        LogAnswer {
            requirement: found.name.as_ref().unwrap_or(&found.formula),
            severity: found.severity,
            asks_nothing: found.asks_nothing.as_deref(),
        }
    }
}

/// Returns the verdict in words, with the mark of a violation that is only a warning.
fn judgment(found: &LogVerdict) -> String {
    if found.violated && !found.fails() {
        format!("{} ({})", found.words(), found.severity)
    } else {
        found.words().to_string()
    }
}

/// Returns the time in which a part of the formula is violated: parts may fail at the same time.
fn total(verdict: &LogVerdict) -> Option<String> {
    let mut spans = Vec::new();
    for violation in &verdict.violations {
        spans.push((violation.start?.0, violation.end?.0));
    }
    spans.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut total = 0.0;
    let mut until = f64::NEG_INFINITY;
    for (start, end) in spans {
        total += (end - start.max(until)).max(0.0);
        until = until.max(end);
    }
    (verdict.violated && !verdict.violations.is_empty()).then(|| format!("{} s", seconds(total)))
}

fn interval(violation: &LogViolation) -> String {
    let worst = format!("at worst {}", measured(violation.worst.0 + 0.0));
    match (violation.start, violation.end, violation.duration) {
        (Some(start), Some(end), Some(duration)) if duration.0 > 0.0 => {
            let [start, end, duration] = [start, end, duration].map(|time| seconds(time.0));
            format!("from {start} s to {end} s ({duration} s), {worst}")
        }
        (Some(start), ..) => format!("at {} s, {worst}", seconds(start.0)),
        _ => match [violation.start_sample, violation.end_sample].map(|sample| sample.unwrap_or(0)) {
            [first, last] if first == last => format!("at sample {first}, {worst}"),
            [first, last] => format!("from sample {first} to {last}, {worst}"),
        },
    }
}

fn at(time: Option<Number>, sample: Option<u64>) -> String {
    match (time, sample) {
        (Some(time), _) => format!("{} s", seconds(time.0)),
        (None, Some(sample)) => format!("sample {sample}"),
        (None, None) => "-".to_string(),
    }
}

/// Formats a time of a log, which can be long, without the digits that errors of rounding leave
/// behind.
fn seconds(value: f64) -> String {
    number_text(format!("{value:.9e}").parse().unwrap_or(value))
}
