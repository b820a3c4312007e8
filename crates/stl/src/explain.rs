//! A formula for people: in the symbols of the literature, and in words.

use crate::clock::{Clock, Window};
use crate::error::MonitorError;
use crate::formula::{Formula, Node, write_number};
use crate::operator::Operator;
use std::fmt;

/// The moment that a formula is explained for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Moment {
    /// The first sample: windows are steps of the trace.
    Start,
    /// Some sample: windows are counted from there.
    Any,
}

impl Formula {
    /// The formula in symbols: `always[0:30](not p and q)` is `□[0:30](¬ p ∧ q)`.
    pub fn symbols(&self) -> impl fmt::Display {
        fmt::from_fn(|f| self.write(f, symbol))
    }

    /// The formula in words, line by line, indented where one line belongs to the one above: made from its operators,
    /// with seconds beside steps, and with the unit that `unit` knows for a signal.
    ///
    /// # Errors
    /// If a bound of an interval is no whole number of samples.
    ///
    /// # Example
    /// ```
    /// use mishandle_stl::{Clock, Formula, Moment};
    /// let formula = Formula::parse("always[50:300](finger_target_distance <= 0.12)").unwrap();
    /// let words = formula.words(&Clock::steps(1.0 / 60.0), Moment::Start, |_| "m").unwrap();
    /// assert_eq!(words, ["at every step from 50 to 300 (0.83 s to 5 s): finger_target_distance is at most 0.12 m"]);
    /// assert_eq!(formula.symbols().to_string(), "□[50:300](finger_target_distance ≤ 0.12)");
    /// ```
    pub fn words<'a>(
        &self,
        clock: &Clock,
        moment: Moment,
        unit: impl Fn(&str) -> &'a str,
    ) -> Result<Vec<String>, MonitorError> {
        clock.check()?;
        let absolute = self.at_the_start(moment);
        // In postfix order the operands of an operator are said before it, so no depth of nesting needs a call stack.
        let mut said: Vec<Said> = Vec::new();
        for (node, absolute) in self.nodes.iter().zip(absolute) {
            let new = match *node {
                Node::Constant(value) => {
                    Said::value(&fmt::from_fn(|f| write_number(f, value)).to_string(), None)
                }
                Node::Signal(signal) => {
                    let name = &self.signals[signal as usize];
                    Said::value(name, Some(unit(name)))
                }
                Node::Apply(operator, interval) => {
                    let window = clock.window(operator.name(), interval)?;
                    let last = said.pop().unwrap_or_default();
                    let first = if operator.arity() == 2 { said.pop() } else { None };
                    let sentence = Sentence { operator, window, clock, absolute };
                    match first {
                        Some(first) => sentence.of_two(first, last),
                        None => sentence.of_one(last),
                    }
                }
            };
            said.push(new);
        }
        Ok(said.pop().unwrap_or_default().lines())
    }

    /// For each node whether its operator is evaluated at the first sample alone: no temporal operator is around it.
    fn at_the_start(&self, moment: Moment) -> Vec<bool> {
        let mut flags = vec![false; self.nodes.len()];
        let mut waiting = vec![moment == Moment::Start];
        for (flag, node) in flags.iter_mut().zip(&self.nodes).rev() {
            *flag = waiting.pop().unwrap_or(false);
            if let Node::Apply(operator, _) = node {
                waiting.extend(std::iter::repeat_n(*flag && !operator.is_temporal(), operator.arity()));
            }
        }
        flags
    }
}

/// How the literature writes an operator.
fn symbol(operator: Operator) -> &'static str {
    match operator {
        Operator::Always => "□",
        Operator::Eventually => "◇",
        Operator::Historically => "■",
        Operator::Once => "◆",
        Operator::Next => "○",
        Operator::Previous => "●",
        Operator::Not => "¬",
        Operator::And => "∧",
        Operator::Or => "∨",
        Operator::Implies => "→",
        Operator::Iff => "↔",
        Operator::Xor => "⊕",
        Operator::Until => "U",
        Operator::Release => "R",
        Operator::Unless => "W",
        Operator::Since => "S",
        Operator::LessOrEqual => "≤",
        Operator::GreaterOrEqual => "≥",
        Operator::Equal => "=",
        Operator::NotEqual => "≠",
        Operator::Multiply => "·",
        other => other.name(),
    }
}

/// What kind of words a part of a formula has become.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Kind {
    /// A number.
    #[default]
    Value,
    /// A number that needs parentheses beside an operator.
    Sum,
    /// A short sentence without a colon.
    Atom,
    /// Anything longer.
    Sentence,
    /// Its parts all hold.
    All,
    /// One of its parts holds.
    One,
}

/// A part of a formula in words.
#[derive(Debug, Default)]
struct Said {
    kind: Kind,
    /// Lines of each part; there are several only in an enumeration.
    parts: Vec<Vec<String>>,
    /// Unit of a number that is made of signals.
    unit: Option<String>,
}

impl Said {
    fn value(text: &str, unit: Option<&str>) -> Said {
        Said { kind: Kind::Value, parts: vec![vec![text.to_string()]], unit: unit.map(str::to_string) }
    }

    fn new(kind: Kind, lines: Vec<String>) -> Said {
        Said { kind, parts: vec![lines], unit: None }
    }

    fn is_number(&self) -> bool {
        matches!(self.kind, Kind::Value | Kind::Sum)
    }

    /// As a number: its text, in parentheses if need be.
    fn number(self) -> String {
        let in_parentheses = self.kind == Kind::Sum;
        let text = self.lines().join(" ");
        if in_parentheses { format!("({text})") } else { text }
    }

    /// As a statement: a number by itself counts as true where it is positive.
    fn statement(self) -> Said {
        if self.is_number() {
            return Said::new(Kind::Atom, vec![format!("{} is positive", self.number())]);
        }
        self
    }

    fn lines(mut self) -> Vec<String> {
        let (joint, head) = match self.kind {
            Kind::All => (", and ", "all of this holds:"),
            Kind::One => (", or ", "one of this holds:"),
            _ => return self.parts.pop().unwrap_or_default(),
        };
        // A part with a colon would swallow what follows it.
        let is_short = |part: &Vec<String>| matches!(part.as_slice(), [line] if !line.contains([':', ',']));
        if self.parts.len() == 2 && self.parts.iter().all(is_short) {
            return vec![self.parts.concat().join(joint)];
        }
        let items = self.parts.into_iter().flat_map(|part| {
            let marks = std::iter::once("  - ").chain(std::iter::repeat("    "));
            marks.zip(part).map(|(mark, line)| format!("{mark}{line}")).collect::<Vec<_>>()
        });
        std::iter::once(head.to_string()).chain(items).collect()
    }

    /// The statement behind some first words.
    fn after(self, head: &str) -> Said {
        let mut lines = self.statement().lines();
        if let Some(first) = lines.first_mut() {
            *first = format!("{head} {first}");
        }
        Said::new(Kind::Sentence, lines)
    }

    /// Two statements, each behind its own first words.
    fn pair(first: (&str, Said), last: (&str, Said)) -> Said {
        let lines = [first.1.after(first.0).lines(), last.1.after(last.0).lines()].concat();
        Said::new(Kind::Sentence, lines)
    }

    /// Both in one enumeration, into which enumerations of the same kind go over.
    fn enumerated(kind: Kind, first: Said, last: Said) -> Said {
        let parts = [first, last].map(|said| {
            let said = said.statement();
            if said.kind == kind { said.parts } else { vec![said.lines()] }
        });
        Said { kind, parts: parts.concat(), unit: None }
    }
}

/// What an operator makes of its operands.
struct Sentence<'a> {
    operator: Operator,
    window: Window,
    clock: &'a Clock,
    /// Whether its window counts from the first sample.
    absolute: bool,
}

impl Sentence<'_> {
    fn of_one(&self, last: Said) -> Said {
        let name = self.operator.name();
        match self.operator {
            Operator::Always => last.after(&format!("at every step {}:", self.ahead())),
            Operator::Eventually => last.after(&format!("at some step {}:", self.ahead())),
            Operator::Historically => last.after(&format!("at every step {}:", self.behind())),
            Operator::Once => last.after(&format!("at some step {}:", self.behind())),
            Operator::Next | Operator::StrongNext => last.after("one step later:"),
            Operator::Previous | Operator::StrongPrevious => last.after("one step earlier:"),
            Operator::Rise => last.after("this begins to hold:"),
            Operator::Fall => last.after("this ceases to hold:"),
            Operator::Not => last.after("this does not hold:"),
            Operator::Negate => {
                Said { unit: last.unit.clone(), ..Said::value(&format!("-{}", last.number()), None) }
            }
            Operator::Abs => {
                let unit = last.unit.clone();
                Said { unit, ..Said::value(&format!("|{}|", last.lines().join(" ")), None) }
            }
            _ => Said::value(&format!("{name}({})", last.lines().join(" ")), Some("")),
        }
    }

    fn of_two(&self, first: Said, last: Said) -> Said {
        match self.operator {
            Operator::And => Said::enumerated(Kind::All, first, last),
            Operator::Or => Said::enumerated(Kind::One, first, last),
            Operator::Implies => Said::pair(("if this holds:", first), ("then this:", last)),
            Operator::Iff => Said::pair(("this holds:", first), ("exactly where this does:", last)),
            Operator::Xor => Said::pair(("either this holds:", first), ("or this, not both:", last)),
            Operator::Until => {
                let head = format!("at some step {}:", self.ahead());
                Said::pair((&head, last), ("and at every step before that one:", first))
            }
            Operator::Release => {
                let head = format!("at every step {}:", self.ahead());
                Said::pair((&head, last), ("unless this held at an earlier step:", first))
            }
            Operator::Unless => {
                let head = format!("unless this has held at a step {}:", self.ahead());
                Said::pair(("at every step:", first), (&head, last))
            }
            Operator::Since => {
                let head = format!("at some step {}:", self.behind());
                Said::pair((&head, last), ("and at every step since that one:", first))
            }
            Operator::LessOrEqual => compared(first, "is at most", last),
            Operator::GreaterOrEqual => compared(first, "is at least", last),
            Operator::Less => compared(first, "is less than", last),
            Operator::Greater => compared(first, "is more than", last),
            Operator::Equal => compared(first, "is", last),
            Operator::NotEqual => compared(first, "is not", last),
            Operator::Pow => Said::value(&format!("pow({}, {})", first.number(), last.number()), Some("")),
            operator => {
                let is_sum = matches!(operator, Operator::Add | Operator::Subtract);
                let unit = if is_sum { shared_unit(&first, &last) } else { Some(String::new()) };
                let text = format!("{} {} {}", first.number(), symbol(operator), last.number());
                Said { kind: Kind::Sum, parts: vec![vec![text]], unit }
            }
        }
    }

    /// The window of an operator that looks ahead.
    fn ahead(&self) -> String {
        let Window { begin, end } = self.window;
        let time = |step| self.seconds(step);
        match (self.absolute, begin, end) {
            (true, 0, usize::MAX) => "of the trace".to_string(),
            (true, _, usize::MAX) => format!("from {begin} ({}) on", time(begin)),
            (true, ..) => format!("from {begin} to {end} ({} to {})", time(begin), time(end)),
            (false, 0, usize::MAX) => "from then on".to_string(),
            (false, _, usize::MAX) => format!("from {begin} later ({}) on", time(begin)),
            (false, 0, _) => format!("from then to {end} later ({})", time(end)),
            (false, ..) => format!("from {begin} to {end} later ({} to {})", time(begin), time(end)),
        }
    }

    /// The window of an operator that looks back.
    fn behind(&self) -> String {
        let Window { begin, end } = self.window;
        match (begin, end) {
            (0, usize::MAX) => "up to then".to_string(),
            (_, usize::MAX) => format!("up to {begin} earlier ({})", self.seconds(begin)),
            _ => format!("from {end} to {begin} earlier ({} to {})", self.seconds(end), self.seconds(begin)),
        }
    }

    /// The time of so many steps, to two decimals, or to two digits below a tenth of a second.
    fn seconds(&self, steps: usize) -> String {
        let seconds = self.clock.time_secs(steps);
        let decimals = if seconds > 0.0 { (1.0 - seconds.log10().floor()).max(2.0) } else { 0.0 };
        let text = format!("{seconds:.*}", decimals as usize);
        let short = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
        format!("{short} s")
    }
}

/// The unit of what is made of two numbers of one unit, or of one with a unit and a constant.
fn shared_unit(first: &Said, last: &Said) -> Option<String> {
    match (&first.unit, &last.unit) {
        (Some(a), Some(b)) if a != b => Some(String::new()),
        (a, b) => a.clone().or_else(|| b.clone()),
    }
}

/// A comparison of two numbers; a constant takes the unit of what it is compared with.
fn compared(first: Said, verb: &str, last: Said) -> Said {
    let unit = shared_unit(&first, &last).unwrap_or_default();
    let [first, last] = [first, last].map(|said| match said.unit {
        None if !unit.is_empty() => format!("{} {unit}", said.number()),
        _ => said.lines().join(" "),
    });
    Said::new(Kind::Atom, vec![format!("{first} {verb} {last}")])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten samples a second; every signal is in metres.
    #[track_caller]
    fn check(formula: &str, symbols: &str, words: &[&str]) {
        let formula = Formula::parse(formula).unwrap();
        assert_eq!(formula.symbols().to_string(), symbols);
        assert_eq!(formula.words(&Clock::steps(0.1), Moment::Start, |_| "m").unwrap(), words);
    }

    #[test]
    fn windows_at_the_start_are_steps_of_the_trace_and_inner_ones_are_not() {
        check(
            "eventually[0:270](always[0:30](d <= 0.1 and not (v > 1)))",
            "◇[0:270] □[0:30](d ≤ 0.1 ∧ ¬(v > 1))",
            &[
                "at some step from 0 to 270 (0 s to 27 s): at every step from then to 30 later (3 s): all of this holds:",
                "  - d is at most 0.1 m",
                "  - this does not hold: v is more than 1 m",
            ],
        );
        check("always[5:inf](p)", "□[5:inf] p", &["at every step from 5 (0.5 s) on: p is positive"]);
        let formula = Formula::parse("always[0:4](d <= 1)").unwrap();
        let words = formula.words(&Clock::steps(1.0 / 60.0), Moment::Any, |_| "");
        assert_eq!(words.unwrap(), ["at every step from then to 4 later (0.067 s): d is at most 1"]);
    }

    #[test]
    fn enumerations_of_one_kind_are_one_and_mixed_ones_are_set_off() {
        check("a < 1 or b >= 2", "a < 1 ∨ b ≥ 2", &["a is less than 1 m, or b is at least 2 m"]);
        check(
            "a < 1 and b < 1 and (c < 1 or d < 1)",
            "a < 1 ∧ b < 1 ∧ (c < 1 ∨ d < 1)",
            &[
                "all of this holds:",
                "  - a is less than 1 m",
                "  - b is less than 1 m",
                "  - c is less than 1 m, or d is less than 1 m",
            ],
        );
    }

    #[test]
    fn the_left_of_until_holds_before_the_right() {
        check(
            "(a < 1) until[0:9] (b < 1)",
            "a < 1 U[0:9] b < 1",
            &[
                "at some step from 0 to 9 (0 s to 0.9 s): b is less than 1 m",
                "and at every step before that one: a is less than 1 m",
            ],
        );
    }

    #[test]
    fn numbers_keep_their_units_and_their_order() {
        check("abs(a - b) * 2 <= 1", "abs(a - b) · 2 ≤ 1", &["|a - b| · 2 is at most 1"]);
        check("a - (b + 1) > -0.5", "a - (b + 1) > -0.5", &["a - (b + 1) is more than -0.5 m"]);
    }

    #[test]
    fn a_bound_between_two_samples_is_refused() {
        let formula = Formula::parse("always[0:0.25s](d <= 1)").unwrap();
        assert!(formula.words(&Clock::steps(0.1), Moment::Start, |_| "").is_err());
    }
}
