//! Verdicts on recorded logs: as text, Markdown and JUnit.

use mishandle::results::{LogVerdict, Number};
use mishandle_text::{number_text, xml_text};

use super::{escape, output};

/// Number of violations that the text of a verdict lists.
const LISTED: usize = 10;

/// Returns the verdicts as text: one as sentences, several as a table.
pub fn shown(found: &[LogVerdict], has_logs: bool) -> String {
    match found {
        [only] if !has_logs => text(only),
        _ => table(found, has_logs),
    }
}

/// Returns the verdict as text: when the formula is violated, how long, and by which part.
pub fn text(found: &LogVerdict) -> String {
    let robustness = number_text(found.robustness.0 + 0.0);
    let mut lines = vec![format!("robustness {robustness} at time 0: {}", found.words())];
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
    let log = escape::name(&found.log);
    found.name.as_ref().map_or(log.clone(), |name| format!("{log}, {}", escape::name(name)))
}

/// Names a sample and its time in seconds.
pub fn instant(sample: usize, time: f64) -> String {
    format!("{} s (sample {sample})", short(time))
}

/// Returns the table of several verdicts.
fn table(found: &[LogVerdict], has_logs: bool) -> String {
    output::table(&rows(found, has_logs)) + &reasons(found)
}

/// Returns a line for each of the first verdicts that ask nothing.
fn reasons(found: &[LogVerdict]) -> String {
    let reason = |verdict: &LogVerdict| {
        let reason = escape::name(verdict.asks_nothing.as_ref()?);
        Some(format!("\n{} asks nothing: {reason}", title(verdict)))
    };
    found.iter().filter_map(reason).take(LISTED).collect()
}

fn rows(found: &[LogVerdict], has_logs: bool) -> Vec<Vec<String>> {
    let has_names = found.iter().any(|verdict| verdict.name.is_some());
    let mut rows = Vec::new();
    let head = ["log", "requirement", "verdict", "robustness", "first violation", "in all", "formula"];
    let is_shown = |column: usize| (column != 0 || has_logs) && (column != 1 || has_names);
    let kept = |row: [String; 7]| {
        row.into_iter().enumerate().filter(|(column, _)| is_shown(*column)).map(|(_, cell)| cell).collect()
    };
    rows.push(kept(head.map(String::from)));
    for verdict in found {
        let first = verdict.violations.first().filter(|_| verdict.violated);
        rows.push(kept([
            escape::name(&verdict.log),
            escape::name(verdict.name.as_deref().unwrap_or("-")),
            if verdict.violated && !verdict.fails() {
                format!("{} ({})", verdict.words(), verdict.severity)
            } else {
                verdict.words().to_string()
            },
            number_text(verdict.robustness.0 + 0.0),
            first.map_or("-".to_string(), |violation| at(violation.start, violation.start_sample)),
            total(verdict).unwrap_or_else(|| "-".to_string()),
            escape::name(&verdict.formula),
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

/// Returns a Markdown table of the verdicts.
pub fn markdown(found: &[LogVerdict]) -> String {
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
    text
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

/// Returns the verdicts as a report of JUnit: a suite for each log, a case for each requirement.
pub fn junit(found: &[LogVerdict]) -> String {
    let mut logs: Vec<&str> = Vec::new();
    for verdict in found {
        if !logs.contains(&verdict.log.as_str()) {
            logs.push(&verdict.log);
        }
    }
    let mut text = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites>\n");
    for log in logs {
        let cases: Vec<&LogVerdict> = found.iter().filter(|verdict| verdict.log == log).collect();
        let failures = cases.iter().copied().filter(|case| case.fails()).count();
        let skipped = cases.iter().filter(|case| case.asks_nothing.is_some()).count();
        text += &format!(
            "  <testsuite name=\"{}\" tests=\"{}\" failures=\"{failures}\" skipped=\"{skipped}\">\n",
            xml_text(log),
            cases.len()
        );
        for case in cases {
            let name = xml_text(case.name.as_deref().unwrap_or(&case.formula));
            text += &format!("    <testcase classname=\"{}\" name=\"{name}\">\n", xml_text(log));
            let message = format!("{}\n{}", case.formula, self::text(case));
            let robustness = format!("robustness {}", number_text(case.robustness.0));
            let element = match &case.asks_nothing {
                _ if case.fails() => Some(("failure", robustness)),
                Some(reason) => Some(("skipped", format!("{}: {reason}", case.words()))),
                None => None,
            };
            let message = xml_text(&message);
            text += &match element {
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
