//! Verdicts on recorded logs: as text, Markdown and JUnit.

use mishandle::results::{LogVerdict, NoVerdict, Number};
use mishandle_text::{number_text, plural, xml_text};

use super::{escape, output};

/// Number of violations that the text of a verdict lists.
const LISTED: usize = 10;

/// The outcome of a requirement on a log: a verdict, or a reason for none.
#[derive(Clone, Copy)]
pub enum Outcome<'a> {
    Verdict(&'a LogVerdict),
    None(&'a NoVerdict),
}

/// Returns all outcomes: violated requirements, those without a verdict, satisfied ones. The
/// verdicts are worst first.
pub fn outcomes<'a>(verdicts: &'a [LogVerdict], without: &'a [NoVerdict]) -> Vec<Outcome<'a>> {
    let (violated, satisfied) = verdicts.split_at(verdicts.partition_point(|verdict| verdict.violated));
    let violated = violated.iter().map(Outcome::Verdict);
    violated.chain(without.iter().map(Outcome::None)).chain(satisfied.iter().map(Outcome::Verdict)).collect()
}

impl<'a> Outcome<'a> {
    fn log(self) -> &'a str {
        match self {
            Outcome::Verdict(found) => &found.log,
            Outcome::None(lacking) => &lacking.log,
        }
    }

    fn name(self) -> Option<&'a str> {
        match self {
            Outcome::Verdict(found) => found.name.as_deref(),
            Outcome::None(lacking) => lacking.name.as_deref(),
        }
    }

    fn formula(self) -> &'a str {
        match self {
            Outcome::Verdict(found) => &found.formula,
            Outcome::None(lacking) => &lacking.formula,
        }
    }

    /// Names the log and the requirement.
    fn title(self) -> String {
        let log = escape::name(self.log());
        self.name().map_or(log.clone(), |name| format!("{log}, {}", escape::name(name)))
    }

    /// Returns what a reader must know beside the verdict.
    fn notes(self) -> Vec<String> {
        let found = match self {
            Outcome::Verdict(found) => found,
            Outcome::None(lacking) => {
                return vec![format!("has no verdict: {}", escape::name(&lacking.reason))];
            }
        };
        let cut = found.cuts_windows.then(|| {
            "a window extends past the end of the trace and is cut there; samples after the end could change the value"
                .to_string()
        });
        let missing =
            (found.missing_values > 0).then(|| format!("{} missing", plural(found.missing_values, "value")));
        cut.into_iter().chain(missing).collect()
    }
}

/// Returns verdicts, worst first, as text.
pub fn verdicts(found: &[LogVerdict], has_logs: bool) -> String {
    shown(&outcomes(found, &[]), has_logs)
}

/// Returns the outcomes as text: one as sentences, several as a table.
pub fn shown(found: &[Outcome<'_>], has_logs: bool) -> String {
    match found {
        [Outcome::Verdict(only)] if !has_logs => text(only),
        _ => table(found, has_logs),
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

/// Returns the verdict as text: when the formula is violated, how long, and by which part.
pub fn text(found: &LogVerdict) -> String {
    let robustness = number_text(found.robustness.0 + 0.0);
    let mut lines = vec![format!("robustness {robustness} at time 0: {}", judgment(found))];
    lines.extend(found.asks_nothing.as_ref().map(|reason| format!("asks nothing: {}", escape::name(reason))));
    // A part can be violated although the formula is not, where the formula has an `or`.
    if found.violated {
        for violation in found.violations.iter().take(LISTED) {
            lines.push(format!("{} violated {}", escape::name(&violation.formula), interval(violation)));
        }
        if let Some(more) = found.violations.len().checked_sub(LISTED + 1) {
            lines.push(format!("and {} more times", more + 1));
        }
    }
    if let Some(predicate) = &found.predicate {
        let [left, right] = predicate.values.map(|value| short(value.0));
        let at = at(predicate.time, predicate.sample);
        lines.push(format!(
            "decided by {} at {at}: the sides are {left} and {right}",
            escape::name(&predicate.formula)
        ));
    }
    lines.join("\n")
}

/// Names the log and the requirement of a verdict.
pub fn title(found: &LogVerdict) -> String {
    Outcome::Verdict(found).title()
}

/// Names a sample and its time in seconds.
pub fn instant(sample: usize, time: f64) -> String {
    format!("{} s (sample {sample})", short(time))
}

/// Returns the table of several outcomes.
fn table(found: &[Outcome<'_>], has_logs: bool) -> String {
    output::table(&rows(found, has_logs)) + &reasons(found)
}

/// Returns a line for each of the first verdicts that ask nothing.
fn reasons(found: &[Outcome<'_>]) -> String {
    let reason = |outcome: &Outcome<'_>| {
        let Outcome::Verdict(LogVerdict { asks_nothing: Some(reason), .. }) = outcome else { return None };
        Some(format!("\n{} asks nothing: {}", outcome.title(), escape::name(reason)))
    };
    found.iter().filter_map(reason).take(LISTED).collect()
}

fn rows(found: &[Outcome<'_>], has_logs: bool) -> Vec<Vec<String>> {
    let has_names = found.iter().any(|outcome| outcome.name().is_some());
    let mut rows = Vec::new();
    let head = ["log", "requirement", "verdict", "robustness", "first violation", "in all", "formula"];
    let is_shown = |column: usize| (column != 0 || has_logs) && (column != 1 || has_names);
    let kept = |row: [String; 7]| {
        row.into_iter().enumerate().filter(|(column, _)| is_shown(*column)).map(|(_, cell)| cell).collect()
    };
    rows.push(kept(head.map(String::from)));
    for outcome in found {
        let none = || "-".to_string();
        let [verdict, robustness, first, total] = match outcome {
            Outcome::None(_) => ["no verdict".to_string(), none(), none(), none()],
            Outcome::Verdict(found) => {
                let first = found.violations.first().filter(|_| found.violated);
                [
                    judgment(found),
                    number_text(found.robustness.0 + 0.0),
                    first.map_or_else(none, |violation| at(violation.start, violation.start_sample)),
                    total(found).unwrap_or_else(none),
                ]
            }
        };
        rows.push(kept([
            escape::name(outcome.log()),
            escape::name(outcome.name().unwrap_or("-")),
            verdict,
            robustness,
            first,
            total,
            escape::name(outcome.formula()),
        ]));
    }
    rows
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
    (verdict.violated && !verdict.violations.is_empty()).then(|| format!("{} s", short(total)))
}

fn interval(violation: &mishandle::results::LogViolation) -> String {
    let worst = format!("at worst {}", number_text(violation.worst.0 + 0.0));
    match (violation.start, violation.end, violation.duration) {
        (Some(start), Some(end), Some(duration)) if duration.0 > 0.0 => {
            format!("from {} s to {} s ({} s), {worst}", short(start.0), short(end.0), short(duration.0))
        }
        (Some(start), ..) => format!("at {} s, {worst}", short(start.0)),
        _ => {
            let first = violation.start_sample.unwrap_or(0);
            let last = violation.end_sample.unwrap_or(0);
            if first == last {
                format!("at sample {first}, {worst}")
            } else {
                format!("from sample {first} to {last}, {worst}")
            }
        }
    }
}

fn at(time: Option<Number>, sample: Option<u64>) -> String {
    match (time, sample) {
        (Some(time), _) => format!("{} s", short(time.0)),
        (None, Some(sample)) => format!("sample {sample}"),
        (None, None) => "-".to_string(),
    }
}

/// Formats a number without the digits that errors of rounding leave behind.
fn short(value: f64) -> String {
    number_text(format!("{value:.9e}").parse().unwrap_or(value))
}

/// Returns a Markdown table of the outcomes, then a list of their notes.
pub fn markdown(found: &[Outcome<'_>]) -> String {
    let rows = rows(found, true);
    let line = |cells: Vec<String>| {
        let cells: Vec<String> = cells.iter().map(|cell| without_tags(cell)).collect();
        format!("| {} |\n", cells.join(" | "))
    };
    let mut text = String::new();
    for (index, row) in rows.into_iter().enumerate() {
        let columns = row.len();
        text += &line(row);
        if index == 0 {
            text += &line(vec!["---".to_string(); columns]);
        }
    }
    let note = |outcome: &Outcome<'_>, note: &str| without_tags(&format!("- {}: {note}\n", outcome.title()));
    let notes =
        |outcome: &Outcome<'_>| outcome.notes().iter().map(|text| note(outcome, text)).collect::<String>();
    let notes: String = found.iter().map(notes).collect();
    if notes.is_empty() { text } else { format!("{text}\n{notes}") }
}

/// Escapes what is a cell or a tag in Markdown. The `<` of a formula stays.
fn without_tags(cell: &str) -> String {
    let mut escaped = String::new();
    let mut rest = cell.chars().peekable();
    while let Some(character) = rest.next() {
        match (character, rest.peek()) {
            ('|', _) => escaped += "\\|",
            ('<', Some(next)) if next.is_ascii_alphabetic() || matches!(next, '/' | '!' | '?') => {
                escaped += "&lt;";
            }
            _ => escaped.push(character),
        }
    }
    escaped
}

/// Returns the outcomes as a report of JUnit: a suite for each log, a case for each requirement. A
/// case without a verdict is an error.
pub fn junit(found: &[Outcome<'_>]) -> String {
    let mut logs: Vec<&str> = Vec::new();
    for outcome in found {
        if !logs.contains(&outcome.log()) {
            logs.push(outcome.log());
        }
    }
    let mut text = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites>\n");
    for log in logs {
        let cases = || found.iter().filter(move |outcome| outcome.log() == log);
        let count =
            |name: &str| cases().filter(|case| element(case).is_some_and(|(own, _)| own == name)).count();
        text += &format!(
            "  <testsuite name=\"{}\" tests=\"{}\" failures=\"{}\" errors=\"{}\" skipped=\"{}\">\n",
            xml_text(log),
            cases().count(),
            count("failure"),
            count("error"),
            count("skipped")
        );
        for case in cases() {
            let name = xml_text(case.name().unwrap_or(case.formula()));
            text += &format!("    <testcase classname=\"{}\" name=\"{name}\">\n", xml_text(log));
            let mut lines = vec![case.formula().to_string()];
            if let Outcome::Verdict(found) = case {
                lines.push(self::text(found));
            }
            lines.extend(case.notes());
            let message = xml_text(&lines.join("\n"));
            text += &match element(case) {
                Some((name, summary)) => {
                    format!("      <{name} message=\"{}\">{message}</{name}>\n", xml_text(&summary))
                }
                None => format!("      <system-out>{message}</system-out>\n"),
            };
            text += "    </testcase>\n";
        }
        text += "  </testsuite>\n";
    }
    text + "</testsuites>\n"
}

/// Returns the element of JUnit that says that a case did not pass, with its message; `None` if it
/// passed.
fn element(case: &Outcome<'_>) -> Option<(&'static str, String)> {
    match case {
        Outcome::None(lacking) => Some(("error", format!("no verdict: {}", lacking.reason))),
        Outcome::Verdict(found) if found.fails() => {
            Some(("failure", format!("robustness {}", number_text(found.robustness.0))))
        }
        Outcome::Verdict(found) => {
            let reason = found.asks_nothing.as_ref()?;
            Some(("skipped", format!("{}: {reason}", found.words())))
        }
    }
}
