//! Verdicts on recorded logs as Markdown and JUnit.

use mishandle::results::{LogVerdict, NoVerdict};
use mishandle::verdict::{self, Line, log_table};
use mishandle_text::{number_text, plural, xml_text};

use super::escape;
use crate::words::shell_command;

/// The outcome of a requirement on a log: a verdict, or a reason for none.
#[derive(Clone, Copy)]
enum Outcome<'a> {
    Verdict(&'a LogVerdict),
    None(&'a NoVerdict),
}

/// Returns all outcomes: violated requirements, those without a verdict, satisfied ones. The
/// verdicts are worst first.
fn outcomes<'a>(verdicts: &'a [LogVerdict], without: &'a [NoVerdict]) -> Vec<Outcome<'a>> {
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
        let title = self.name().map_or(self.log().to_string(), |name| format!("{}, {name}", self.log()));
        escape::name(&title)
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

/// Names a sample and its time in seconds.
pub fn instant(sample: usize, time: f64) -> String {
    format!("{} s (sample {sample})", short(time))
}

/// Formats a number without the digits that errors of rounding leave behind.
fn short(value: f64) -> String {
    number_text(format!("{value:.9e}").parse().unwrap_or(value))
}

/// Returns a Markdown table of the outcomes, then a list of their notes.
pub fn markdown(verdicts: &[LogVerdict], without: &[NoVerdict]) -> String {
    let line = |cells: Vec<String>| {
        let cells: Vec<String> = cells.iter().map(|cell| without_tags(&escape::name(cell))).collect();
        format!("| {} |\n", cells.join(" | "))
    };
    let mut text = String::new();
    for (index, row) in log_table(verdicts, without, true).into_iter().enumerate() {
        let columns = row.len();
        text += &line(row);
        if index == 0 {
            text += &line(vec!["---".to_string(); columns]);
        }
    }
    let note = |outcome: &Outcome<'_>, note: &str| without_tags(&format!("- {}: {note}\n", outcome.title()));
    let notes =
        |outcome: &Outcome<'_>| outcome.notes().iter().map(|text| note(outcome, text)).collect::<String>();
    let notes: String = outcomes(verdicts, without).iter().map(notes).collect();
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
pub fn junit(verdicts: &[LogVerdict], without: &[NoVerdict]) -> String {
    let found = outcomes(verdicts, without);
    let mut logs: Vec<&str> = Vec::new();
    for outcome in &found {
        if !logs.contains(&outcome.log()) {
            logs.push(outcome.log());
        }
    }
    let line = |line: &Line| format!("{} {}", line.label, escape::name(&line.text));
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
                lines.extend(verdict::log(found).lines(shell_command).iter().map(line));
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
