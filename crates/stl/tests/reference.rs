//! The examples of docs/reference/formulas.md and docs/guide/manner.md: blocks of the language
//! `formula`. A block has an optional line `period SECONDS s`, a line with name and samples for
//! each signal, a blank line, and formulas. The line after a formula starts with `=>` and has the
//! robustness at each sample, the decided values after `decided`, or a part of the message after
//! `error: `.
//!
//! A block in dense time starts with the line `dense hold` or `dense linear`. A signal has
//! `TIME: VALUE` for each sample, and the result `TIME: VALUE` for each breakpoint, or
//! `TIME: BEFORE/VALUE` where it jumps to its value, or `TIME: BEFORE/VALUE/AFTER`. After
//! `violated` are the intervals of violation, `START to END`.

use mishandle_stl::{Breakpoint, Clock, DenseMonitor, DenseSignal, Formula, Interpolation, Monitor, Trace};
use std::sync::Arc;

const PAGE: &str = include_str!("../../../docs/reference/formulas.md");
const MANNER: &str = include_str!("../../../docs/guide/manner.md");

fn numbers(text: &str) -> Vec<f64> {
    text.split_whitespace().map(|word| word.parse().unwrap_or_else(|_| panic!("{word} in {text}"))).collect()
}

/// Returns the blocks of examples of a page.
fn blocks(page: &'static str) -> impl Iterator<Item = &'static str> {
    page.split("\n```formula\n").skip(1).map(|rest| rest.split("\n```\n").next().unwrap())
}

/// Splits a line at the end of the name of the signal, which a formula can read.
fn signal(line: &str) -> (String, Vec<f64>) {
    let end = match line.rfind('`') {
        Some(last) => last + 1,
        None => line.find(' ').unwrap(),
    };
    let name = Formula::parse(&line[..end]).unwrap().signals()[0].to_owned();
    (name, numbers(&line[end..]))
}

/// Returns a word, or a number as it is printed: with the sign of a zero, which is the verdict.
fn canonical(word: &str) -> String {
    word.parse::<f64>().map_or(word.to_owned(), |number| number.to_string())
}

/// The signals of a block.
enum Log {
    Trace(Trace, Clock),
    Dense(Vec<DenseSignal>),
}

impl Log {
    fn new(head: &str) -> Log {
        let dense = [("dense hold\n", Interpolation::Hold), ("dense linear\n", Interpolation::Linear)];
        for (line, interpolation) in dense {
            if let Some(signals) = head.strip_prefix(line) {
                return Log::Dense(signals.lines().map(|line| dense_signal(line, interpolation)).collect());
            }
        }
        let period = head.lines().find_map(|line| line.strip_prefix("period ")?.strip_suffix(" s"));
        let clock = period.map_or(Clock::unknown(), |secs| Clock::steps(secs.parse().unwrap()));
        let signals = head.lines().filter(|line| !line.starts_with("period "));
        let (names, columns): (Vec<String>, Vec<Vec<f64>>) = signals.map(signal).unzip();
        let mut trace = Trace::new(Arc::from(names));
        for step in 0..columns[0].len() {
            trace.push(&columns.iter().map(|column| column[step]).collect::<Vec<_>>());
        }
        Log::Trace(trace, clock)
    }

    /// Returns the values of a formula as the page writes them, of the kind that `expected` has.
    fn evaluate(&self, text: &str, expected: &str) -> Result<String, String> {
        let formula = Formula::parse(text).map_err(|error| error.to_string())?;
        let kind = ["decided", "violated"].into_iter().find(|kind| expected.starts_with(kind)).unwrap_or("");
        let values = match self {
            Log::Trace(trace, clock) => {
                let monitor = Monitor::new(&formula, trace.names(), *clock);
                let mut monitor = monitor.map_err(|error| error.to_string())?;
                let found = match kind {
                    "decided" => monitor.decided_robustness_signal(trace),
                    _ => monitor.robustness_signal(trace),
                };
                found
                    .map(|found| found.iter().map(f64::to_string).collect::<Vec<_>>().join(" "))
                    .map_err(|error| error.to_string())?
            }
            Log::Dense(signals) => {
                dense_values(&formula, signals, kind).map_err(|error| error.to_string())?
            }
        };
        Ok(format!("{kind} {values}"))
    }
}

fn dense_signal(line: &str, interpolation: Interpolation) -> DenseSignal {
    let (name, samples) = line.split_once(' ').unwrap();
    let samples = numbers(&samples.replace(':', " "));
    let column = |first: usize| samples.iter().skip(first).step_by(2).copied().collect();
    DenseSignal::new(name, column(0), column(1), interpolation).unwrap()
}

fn dense_values(
    formula: &Formula,
    signals: &[DenseSignal],
    kind: &str,
) -> Result<String, mishandle_stl::DenseError> {
    let names: Vec<String> = signals.iter().map(|signal| signal.name().to_owned()).collect();
    let monitor = DenseMonitor::new(formula, &names, None)?;
    let found = match kind {
        "decided" => monitor.decided_robustness_signal(signals)?,
        _ => monitor.robustness_signal(signals)?,
    };
    if kind == "violated" {
        let intervals =
            found.violations().into_iter().map(|found| format!("{} to {}", found.start, found.end));
        return Ok(intervals.collect::<Vec<_>>().join(", "));
    }
    let point = |Breakpoint { time, before, at, after }: Breakpoint| match () {
        () if [before, after] == [at; 2] => format!("{time}: {at}"),
        () if after == at => format!("{time}: {before}/{at}"),
        () => format!("{time}: {before}/{at}/{after}"),
    };
    Ok(found.breakpoints().map(point).collect::<Vec<_>>().join(", "))
}

#[test]
fn the_examples_of_the_page_have_its_values() {
    assert!(check(PAGE) > 100);
}

#[test]
fn the_examples_of_the_manner_have_their_values() {
    assert!(check(MANNER) > 10);
}

/// Checks all examples of a page and returns their number.
fn check(page: &'static str) -> usize {
    let mut examples = 0;
    let mut wrong = Vec::new();
    for block in blocks(page) {
        let (head, formulas) = block.split_once("\n\n").unwrap();
        let log = Log::new(head);
        let mut text = String::new();
        for line in formulas.lines() {
            let Some(expected) = line.strip_prefix("=>") else {
                text += &format!("{line}\n");
                continue;
            };
            let text = std::mem::take(&mut text);
            let expected = expected.trim();
            let found = log.evaluate(&text, expected);
            let is_right = match expected.strip_prefix("error: ") {
                Some(part) => found.as_ref().is_err_and(|error| error.contains(part)),
                None => found.as_ref().is_ok_and(|found| {
                    let words = |text: &str| text.split_whitespace().map(canonical).collect::<Vec<_>>();
                    words(found) == words(expected)
                }),
            };
            examples += 1;
            if !is_right {
                wrong.push(format!("{text}=> {found:?}, not {expected}"));
            }
        }
        assert!(text.is_empty(), "no value after {text}");
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    examples
}

#[test]
fn every_operator_and_unit_has_an_example() {
    let examples: String = blocks(PAGE).collect();
    let is_part = |c: char| c.is_alphanumeric() || c == '_';
    let words = "abs sqrt exp ln pow rise fall not always G eventually F historically H once O prev Y next X s_prev sY \
                 s_next sX until U release R unless W since S and or implies iff xor true FALSE inf s ms const";
    for word in words.split_whitespace() {
        let stands = |(at, _): (usize, &str)| {
            let before = &examples[..at];
            let after = &examples[at + word.len()..];
            !before.ends_with(|c: char| is_part(c) && !c.is_numeric()) && !after.starts_with(is_part)
        };
        assert!(examples.match_indices(word).any(stands), "no example of {word}");
    }
    for symbol in
        ["*", "/", "+", "-", "<=", ">=", "<", ">", "==", "!==", "!=", "!", "&", "&&", "|", "||", "->", "<->"]
    {
        assert!(
            examples.contains(&format!(" {symbol} ")) || examples.contains(&format!(" {symbol}")),
            "{symbol}"
        );
    }
}
