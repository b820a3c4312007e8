//! Explanations of a formula: in mathematical symbols and in English.

use crate::clock::{Bound, Clock, Interval, Window};
use crate::error::MonitorError;
use crate::formula::{Formula, Node};
use crate::number::{Shown, write_number};
use crate::operator::Operator;
use std::fmt;

/// The time at which an explained formula is evaluated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EvaluationTime {
    /// The first sample: windows are given as steps of the trace.
    Start,
    /// Any sample: windows are relative to it.
    Any,
}

impl Formula {
    /// Returns the formula in mathematical symbols: `always[0:30](not p and q)` becomes
    /// `□[0:30](¬ p ∧ q)`.
    pub fn symbols(&self) -> impl fmt::Display {
        fmt::from_fn(|f| self.write(f, symbol))
    }

    /// Returns the formula in English, line by line; parts of a line above are indented.
    ///
    /// Windows are given in steps and seconds; as they are written, if the period is unknown.
    /// `unit` returns the unit of a signal, or "" if it has none.
    ///
    /// # Errors
    /// If the sampling period is not positive and finite, or an interval bound is not a whole
    /// number of samples.
    ///
    /// # Example
    /// ```
    /// use mishandle_stl::{Clock, EvaluationTime, Formula};
    /// let formula = Formula::parse("always[50:300](distance <= 0.12)").unwrap();
    /// let lines = formula.explain(&Clock::steps(1.0 / 60.0), EvaluationTime::Start, |_| "m").unwrap();
    /// assert_eq!(lines, ["at every step from 50 to 300 (0.83 s to 5 s): distance is at most 0.12 m"]);
    /// assert_eq!(formula.symbols().to_string(), "□[50:300](distance ≤ 0.12)");
    /// ```
    pub fn explain<'a>(
        &self,
        clock: &Clock,
        time: EvaluationTime,
        unit: impl Fn(&str) -> &'a str,
    ) -> Result<Vec<String>, MonitorError> {
        clock.check()?;
        let absolute = self.evaluated_at_start(time);
        let in_number = self.inside_numbers();
        let starts = self.starts();
        // In postfix order the operands of an operator come before it, so deep nesting needs no
        // recursion.
        let mut phrases: Vec<Phrase> = Vec::new();
        for (index, (node, absolute)) in self.nodes.iter().zip(absolute).enumerate() {
            let mut new = match *node {
                Node::Constant(value) => {
                    Phrase::value(&fmt::from_fn(|f| write_number(f, value)).to_string(), None)
                }
                Node::Signal(signal) => {
                    let name = &self.signals[signal as usize];
                    Phrase::value(name, Some(unit(name)))
                }
                Node::Apply(operator, interval) => {
                    let window = match clock.period_secs() {
                        Some(_) => Span::Samples(clock.window(operator.name(), interval)?),
                        None => Span::Written(interval),
                    };
                    let last = phrases.pop().unwrap_or_default();
                    let first = if operator.arity() == 2 { phrases.pop() } else { None };
                    let in_number = in_number[index];
                    let applied = AppliedOperator { operator, window, clock, absolute, in_number };
                    match first {
                        Some(first) => applied.binary(first, last),
                        None => applied.unary(last),
                    }
                }
            };
            if in_number[index] && !new.is_number() {
                let text = fmt::from_fn(|f| self.write_node(f, Operator::name, index, &starts));
                new = Phrase::value(&format!("the robustness of `{text}`"), Some(""));
            }
            phrases.push(new);
        }
        Ok(phrases.pop().unwrap_or_default().statement().lines())
    }

    /// Returns for each node whether its value is a number for a comparison or for arithmetic above
    /// it.
    fn inside_numbers(&self) -> Vec<bool> {
        let starts = self.starts();
        let mut flags = vec![false; self.nodes.len()];
        for index in (0..self.nodes.len()).rev() {
            if let Node::Apply(operator, _) = self.nodes[index] {
                let is_inside = flags[index] || operator.is_term() || operator.is_comparison();
                self.operands(index, &starts).into_iter().for_each(|operand| flags[operand] = is_inside);
            }
        }
        flags
    }

    /// Returns for each node whether it is evaluated at the first sample only: no temporal operator
    /// encloses it.
    fn evaluated_at_start(&self, time: EvaluationTime) -> Vec<bool> {
        let mut flags = vec![false; self.nodes.len()];
        let mut pending = vec![time == EvaluationTime::Start];
        for (flag, node) in flags.iter_mut().zip(&self.nodes).rev() {
            *flag = pending.pop().unwrap_or(false);
            if let Node::Apply(operator, _) = node {
                pending.extend(std::iter::repeat_n(*flag && !operator.is_temporal(), operator.arity()));
            }
        }
        flags
    }
}

/// Returns the spelling of the operator that [`Formula::symbols`] prints as this character.
pub(crate) fn spelling_of_symbol(character: char) -> Option<&'static str> {
    let is_symbol = |operator: &Operator| symbol(*operator).chars().eq([character]);
    Operator::all().find(is_symbol).map(Operator::name)
}

/// Returns the mathematical symbol of an operator.
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

/// The kind of phrase that a part of a formula becomes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum PhraseKind {
    /// A number.
    #[default]
    Value,
    /// An arithmetic expression, which needs parentheses beside an operator.
    Expression,
    /// A short statement without a colon.
    Atom,
    /// A longer statement.
    Compound,
    /// Two statements, each on lines of its own.
    Pair,
    /// A conjunction of the parts.
    All,
    /// A disjunction of the parts.
    AnyOf,
}

/// A part of a formula in words.
#[derive(Debug, Default)]
struct Phrase {
    kind: PhraseKind,
    /// The lines of each part; only conjunctions and disjunctions have several parts.
    parts: Vec<Vec<String>>,
    /// The unit of a number that depends on signals.
    unit: Option<String>,
}

impl Phrase {
    fn value(text: &str, unit: Option<&str>) -> Phrase {
        Phrase {
            kind: PhraseKind::Value,
            parts: vec![vec![text.to_string()]],
            unit: unit.map(str::to_string),
        }
    }

    fn new(kind: PhraseKind, lines: Vec<String>) -> Phrase {
        Phrase { kind, parts: vec![lines], unit: None }
    }

    fn is_number(&self) -> bool {
        matches!(self.kind, PhraseKind::Value | PhraseKind::Expression)
    }

    /// Returns the text of a number, in parentheses if necessary.
    fn number(self) -> String {
        let in_parentheses = self.kind == PhraseKind::Expression;
        let text = self.lines().join(" ");
        if in_parentheses { format!("({text})") } else { text }
    }

    /// Turns the phrase into a statement: a number counts as true from 0 on.
    fn statement(self) -> Phrase {
        if self.is_number() {
            let always = match self.parts.first().and_then(|lines| lines.first()).map(String::as_str) {
                Some("true") => Some("this always holds"),
                Some("false") => Some("this never holds"),
                _ => None,
            };
            let text = always.map_or_else(|| format!("{} is at least 0", self.number()), str::to_string);
            return Phrase::new(PhraseKind::Atom, vec![text]);
        }
        self
    }

    /// Returns the number at another step.
    fn moved(self, when: &str) -> Phrase {
        let unit = self.unit.clone();
        let parts = vec![vec![format!("{} {when}", self.number())]];
        Phrase { kind: PhraseKind::Expression, parts, unit }
    }

    /// Returns the least or greatest value of the number in a window.
    fn extremum(self, which: &str, window: &str) -> Phrase {
        let unit = self.unit.clone();
        let parts = vec![vec![format!("the {which} {} {window}", self.number())]];
        Phrase { kind: PhraseKind::Expression, parts, unit }
    }

    fn lines(mut self) -> Vec<String> {
        let (joint, head) = match self.kind {
            PhraseKind::All => (", and ", "all of these hold:"),
            PhraseKind::AnyOf => (", or ", "at least one of these holds:"),
            _ => return self.parts.pop().unwrap_or_default(),
        };
        // Text after a part with a colon would read as belonging to that part.
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

    /// Prefixes the statement with `head`. Of a pair, both statements belong below it.
    fn after(self, head: &str) -> Phrase {
        let phrase = self.statement();
        let is_pair = phrase.kind == PhraseKind::Pair;
        let mut lines = phrase.lines();
        if is_pair {
            let below = lines.into_iter().map(|line| format!("  {line}"));
            return Phrase::new(
                PhraseKind::Compound,
                std::iter::once(head.to_string()).chain(below).collect(),
            );
        }
        if let Some(first) = lines.first_mut() {
            *first = format!("{head} {first}");
        }
        Phrase::new(PhraseKind::Compound, lines)
    }

    /// Joins two statements.
    fn pair(first: Phrase, last: Phrase) -> Phrase {
        Phrase::new(PhraseKind::Pair, [first.lines(), last.lines()].concat())
    }

    /// Joins two statements into one enumeration. Enumerations of the same kind are merged.
    fn enumerated(kind: PhraseKind, first: Phrase, last: Phrase) -> Phrase {
        let parts = [first, last].map(|phrase| {
            let phrase = phrase.statement();
            if phrase.kind == kind { phrase.parts } else { vec![phrase.lines()] }
        });
        Phrase { kind, parts: parts.concat(), unit: None }
    }
}

/// The window of an operator.
#[derive(Clone, Copy)]
enum Span {
    Samples(Window),
    /// As in the text, if the period is unknown.
    Written(Option<Interval>),
}

/// A bound of a window in words, and in seconds.
struct Moment {
    text: String,
    secs: Option<String>,
    is_zero: bool,
}

/// An operator with its window, applied to phrases.
struct AppliedOperator<'a> {
    operator: Operator,
    window: Span,
    clock: &'a Clock,
    /// Whether the window counts from the first sample.
    absolute: bool,
    /// Whether the result is a number for a comparison or for arithmetic.
    in_number: bool,
}

impl AppliedOperator<'_> {
    fn unary(&self, last: Phrase) -> Phrase {
        let name = self.operator.name();
        let is_extremum = self.in_number && last.is_number();
        match self.operator {
            Operator::Always if is_extremum => last.extremum("least", &self.ahead()),
            Operator::Eventually if is_extremum => last.extremum("greatest", &self.ahead()),
            Operator::Historically if is_extremum => last.extremum("least", &self.behind()),
            Operator::Once if is_extremum => last.extremum("greatest", &self.behind()),
            Operator::Always => last.after(&format!("at every step {}:", self.ahead())),
            Operator::Eventually => last.after(&format!("at some step {}:", self.ahead())),
            Operator::Historically => last.after(&format!("at every step {}:", self.behind())),
            Operator::Once => last.after(&format!("at some step {}:", self.behind())),
            Operator::Next | Operator::StrongNext if last.is_number() => last.moved("one step later"),
            Operator::Previous | Operator::StrongPrevious if last.is_number() => {
                last.moved("one step earlier")
            }
            Operator::Next => last.after("one step later, if the trace has it:"),
            Operator::StrongNext => last.after("the trace has a step later, and there:"),
            Operator::Previous => last.after("one step earlier, if the trace has it:"),
            Operator::StrongPrevious => last.after("the trace has a step earlier, and there:"),
            Operator::Rise => {
                last.after("this starts to hold (it did not one step earlier, or this is the first step):")
            }
            Operator::Fall => {
                last.after("this stops holding (it did one step earlier, or this is the first step):")
            }
            Operator::Not => last.after("this does not hold:"),
            Operator::Negate => {
                Phrase { unit: last.unit.clone(), ..Phrase::value(&format!("-{}", last.number()), None) }
            }
            Operator::Abs => {
                let unit = last.unit.clone();
                Phrase { unit, ..Phrase::value(&format!("|{}|", last.lines().join(" ")), None) }
            }
            _ => Phrase::value(&format!("{name}({})", last.lines().join(" ")), Some("")),
        }
    }

    fn binary(&self, first: Phrase, last: Phrase) -> Phrase {
        match self.operator {
            Operator::And => Phrase::enumerated(PhraseKind::All, first, last),
            Operator::Or => Phrase::enumerated(PhraseKind::AnyOf, first, last),
            Operator::Implies => Phrase::pair(first.after("if this holds:"), last.after("then this:")),
            Operator::Iff => Phrase::pair(first.after("this holds:"), last.after("exactly where this does:")),
            Operator::Xor => {
                Phrase::pair(first.after("either this holds:"), last.after("or this, not both:"))
            }
            Operator::Until => {
                let head = format!("at some step {}:", self.ahead());
                Phrase::pair(last.after(&head), first.after("and at every step before that one:"))
            }
            Operator::Release => {
                let head = format!("at every step {}:", self.ahead());
                Phrase::pair(last.after(&head), first.after("unless this held at an earlier step:"))
            }
            Operator::Unless => {
                let every = self.up_to_end();
                let head = format!("or only before a step {} at which:", self.ahead());
                Phrase::pair(first.after(&format!("at every step {every}:")), last.after(&head))
            }
            Operator::Since => {
                let head = format!("at some step {}:", self.behind());
                Phrase::pair(last.after(&head), first.after("and at every later step up to then:"))
            }
            Operator::LessOrEqual => compared(first, "is at most", last),
            Operator::GreaterOrEqual => compared(first, "is at least", last),
            Operator::Less => compared(first, "is less than", last),
            Operator::Greater => compared(first, "is more than", last),
            Operator::Equal => compared(first, "is", last),
            Operator::NotEqual => compared(first, "is not", last),
            Operator::Pow => Phrase::value(&format!("pow({}, {})", first.number(), last.number()), Some("")),
            operator => {
                let is_sum = matches!(operator, Operator::Add | Operator::Subtract);
                let unit = if is_sum { shared_unit(&first, &last) } else { Some(String::new()) };
                let text = format!("{} {} {}", first.number(), symbol(operator), last.number());
                Phrase { kind: PhraseKind::Expression, parts: vec![vec![text]], unit }
            }
        }
    }

    /// Returns begin and end of the window; `None` for an end that is open.
    fn bounds(&self) -> (Moment, Option<Moment>) {
        let step = |step: usize| Moment {
            text: step.to_string(),
            secs: Some(self.seconds(step)),
            is_zero: step == 0,
        };
        let written = |bound: Bound| Moment {
            text: match bound.unit.or(self.clock.bare_unit()) {
                Some(unit) => format!("{} {unit}", Shown(bound.value)),
                None => bound.to_string(),
            },
            secs: None,
            is_zero: bound.value == 0.0,
        };
        match self.window {
            Span::Samples(window) => (step(window.begin), (!window.is_unbounded()).then(|| step(window.end))),
            Span::Written(None) => (Moment { text: String::new(), secs: None, is_zero: true }, None),
            Span::Written(Some(Interval { begin, end })) => {
                (written(begin), end.value.is_finite().then(|| written(end)))
            }
        }
    }

    /// Describes the window of a future operator.
    fn ahead(&self) -> String {
        let (begin, end) = self.bounds();
        match (self.absolute, end) {
            (true, None) if begin.is_zero => "of the trace".to_string(),
            (true, None) => format!("from {}{} on", begin.text, brackets(begin.secs)),
            (true, Some(end)) => {
                format!("from {} to {}{}", begin.text, end.text, brackets(range(begin.secs, end.secs)))
            }
            (false, None) if begin.is_zero => "from then on".to_string(),
            (false, None) => format!("from {} later{} on", begin.text, brackets(begin.secs)),
            (false, Some(end)) if begin.is_zero => {
                format!("from then to {} later{}", end.text, brackets(end.secs))
            }
            (false, Some(end)) => {
                let secs = range(begin.secs, end.secs);
                format!("from {} to {} later{}", begin.text, end.text, brackets(secs))
            }
        }
    }

    /// Describes the steps up to the end of the window of a future operator.
    fn up_to_end(&self) -> String {
        let (_, end) = self.bounds();
        match (self.absolute, end) {
            (true, None) => "of the trace".to_string(),
            (false, None) => "from then on".to_string(),
            (true, Some(end)) => format!("up to {}{}", end.text, brackets(end.secs)),
            (false, Some(end)) => format!("from then to {} later{}", end.text, brackets(end.secs)),
        }
    }

    /// Describes the window of a past operator.
    fn behind(&self) -> String {
        let (begin, end) = self.bounds();
        match end {
            None if begin.is_zero => "up to then".to_string(),
            None => format!("{} or more earlier{}", begin.text, brackets(begin.secs)),
            Some(end) if begin.is_zero => {
                format!("from {} earlier to then{}", end.text, brackets(end.secs))
            }
            Some(end) => {
                let secs = range(end.secs, begin.secs);
                format!("from {} to {} earlier{}", end.text, begin.text, brackets(secs))
            }
        }
    }

    /// Formats the duration of `steps` steps with two decimals, or with two significant digits
    /// below 0.1 s.
    fn seconds(&self, steps: usize) -> String {
        let seconds = self.clock.time_secs(steps);
        let decimals = if seconds > 0.0 { (1.0 - seconds.log10().floor()).max(2.0) } else { 0.0 };
        let text = format!("{seconds:.*}", decimals as usize);
        let short = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
        format!("{short} s")
    }
}

/// Returns a text in parentheses after a space.
fn brackets(text: Option<String>) -> String {
    text.map(|text| format!(" ({text})")).unwrap_or_default()
}

fn range(from: Option<String>, to: Option<String>) -> Option<String> {
    Some(format!("{} to {}", from?, to?))
}

/// Returns the unit of a sum or comparison: the unit of both operands, or of one if the other is a
/// constant.
fn shared_unit(first: &Phrase, last: &Phrase) -> Option<String> {
    match (&first.unit, &last.unit) {
        (Some(a), Some(b)) if a != b => Some(String::new()),
        (a, b) => a.clone().or_else(|| b.clone()),
    }
}

/// Describes a comparison of two numbers. A constant takes the unit of the other operand.
fn compared(first: Phrase, verb: &str, last: Phrase) -> Phrase {
    let unit = shared_unit(&first, &last).unwrap_or_default();
    let [first, last] = [first, last].map(|phrase| match phrase.unit {
        None if !unit.is_empty() => format!("{} {unit}", phrase.number()),
        _ => phrase.lines().join(" "),
    });
    Phrase::new(PhraseKind::Atom, vec![format!("{first} {verb} {last}")])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::TimeUnit;

    /// Ten samples per second; every signal is in meters.
    #[track_caller]
    fn check(formula: &str, symbols: &str, words: &[&str]) {
        let formula = Formula::parse(formula).unwrap();
        assert_eq!(formula.symbols().to_string(), symbols);
        assert_eq!(formula.explain(&Clock::steps(0.1), EvaluationTime::Start, |_| "m").unwrap(), words);
    }

    #[test]
    fn outer_windows_are_absolute_and_inner_windows_are_relative() {
        check(
            "eventually[0:270](always[0:30](d <= 0.1 and not (v > 1)))",
            "◇[0:270] □[0:30](d ≤ 0.1 ∧ ¬(v > 1))",
            &[
                "at some step from 0 to 270 (0 s to 27 s): at every step from then to 30 later (3 s): all of these hold:",
                "  - d is at most 0.1 m",
                "  - this does not hold: v is more than 1 m",
            ],
        );
        check("always[5:inf](p)", "□[5:inf] p", &["at every step from 5 (0.5 s) on: p is at least 0"]);
        let formula = Formula::parse("always[0:4](d <= 1)").unwrap();
        let words = formula.explain(&Clock::steps(1.0 / 60.0), EvaluationTime::Any, |_| "");
        assert_eq!(words.unwrap(), ["at every step from then to 4 later (0.067 s): d is at most 1"]);
    }

    #[test]
    fn nested_enumerations_of_one_kind_are_merged() {
        check("a < 1 or b >= 2", "a < 1 ∨ b ≥ 2", &["a is less than 1 m, or b is at least 2 m"]);
        check(
            "a < 1 and b < 1 and (c < 1 or d < 1)",
            "a < 1 ∧ b < 1 ∧ (c < 1 ∨ d < 1)",
            &[
                "all of these hold:",
                "  - a is less than 1 m",
                "  - b is less than 1 m",
                "  - c is less than 1 m, or d is less than 1 m",
            ],
        );
    }

    #[test]
    fn the_left_operand_of_until_holds_before_the_right_one() {
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
    fn windows_are_as_written_if_the_period_is_unknown() {
        let words = |text: &str| {
            let formula = Formula::parse(text).unwrap();
            formula.explain(&Clock::unknown(), EvaluationTime::Start, |_| "").unwrap()
        };
        assert_eq!(words("always[0.5:2s](d <= 1)"), ["at every step from 0.5 s to 2 s: d is at most 1"]);
        let bare = Formula::parse("always[0:2](d <= 1)").unwrap();
        let clock = Clock::unknown_rtamt(TimeUnit::Milliseconds);
        let found = bare.explain(&clock, EvaluationTime::Start, |_| "").unwrap();
        assert_eq!(found, ["at every step from 0 ms to 2 ms: d is at most 1"]);
        assert_eq!(
            words("always (p >= 1 implies once[0:300ms] q >= 1)"),
            [
                "at every step of the trace:",
                "  if this holds: p is at least 1",
                "  then this: at some step from 300 ms earlier to then: q is at least 1",
            ]
        );
    }

    #[test]
    fn numbers_keep_their_units_and_order() {
        check("abs(a - b) * 2 <= 1", "abs(a - b) · 2 ≤ 1", &["|a - b| · 2 is at most 1"]);
        check("a - (b + 1) > -0.5", "a - (b + 1) > -0.5", &["a - (b + 1) is more than -0.5 m"]);
    }

    #[test]
    fn edges_and_neighbors_are_read_as_they_are_meant() {
        check(
            "always(abs(q - (prev q)) <= 1 and rise(p > 2))",
            "□(abs(q - (● q)) ≤ 1 ∧ rise(p > 2))",
            &[
                "at every step of the trace: all of these hold:",
                "  - |q - (q one step earlier)| is at most 1 m",
                "  - this starts to hold (it did not one step earlier, or this is the first step): p is more than 2 m",
            ],
        );
        check(
            "(not (q > 1)) unless[0:9] p > 2",
            "¬(q > 1) W[0:9] p > 2",
            &[
                "at every step up to 9 (0.9 s): this does not hold: q is more than 1 m",
                "or only before a step from 0 to 9 (0 s to 0.9 s) at which: p is more than 2 m",
            ],
        );
    }

    #[test]
    fn a_signal_alone_is_a_statement() {
        check("p", "p", &["p is at least 0"]);
        check("prev p", "● p", &["(p one step earlier) is at least 0"]);
        check("true", "true", &["this always holds"]);
        check("not p", "¬ p", &["this does not hold: p is at least 0"]);
    }

    /// A text that looks like a chain or like an equivalence compares robustness.
    #[test]
    fn a_formula_in_a_comparison_is_its_robustness() {
        check("0.2 <= v <= 0.3", "0.2 ≤ v ≤ 0.3", &["the robustness of `0.2 <= v` is at most 0.3"]);
        check(
            "always((a >= 1) == (b >= 1))",
            "□(a ≥ 1 = (b ≥ 1))",
            &["at every step of the trace: the robustness of `a >= 1` is the robustness of `b >= 1`"],
        );
        check(
            "(a < 1 and b < 1) * 2 >= 1",
            "(a < 1 ∧ b < 1) · 2 ≥ 1",
            &["the robustness of `a < 1 and b < 1` · 2 is at least 1"],
        );
        check(
            "(always[0:9] v) <= 3",
            "(□[0:9] v) ≤ 3",
            &["the least v from 0 to 9 (0 s to 0.9 s) is at most 3 m"],
        );
        check(
            "v - (once[0:2] v) > -1",
            "v - (◆[0:2] v) > -1",
            &["v - (the greatest v from 2 earlier to then (0.2 s)) is more than -1 m"],
        );
    }

    #[test]
    fn a_bound_between_two_samples_is_an_error() {
        let formula = Formula::parse("always[0:0.25s](d <= 1)").unwrap();
        assert!(formula.explain(&Clock::steps(0.1), EvaluationTime::Start, |_| "").is_err());
    }
}
