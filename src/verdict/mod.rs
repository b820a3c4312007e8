//! The few lines that say what an answer means: what fails or holds, what causes it and since when,
//! how sure that is, and what to do next.
//!
//! Terminal, Python and pages show the same lines. Texts have names as they are in the run file:
//! escape them before you print them. What to do next is a [`Command`], which each of them words in
//! its own language.

mod axes;
mod check;
mod comparison;
mod evaluation;
mod falsification;
mod hardening;
mod margin;
mod monitor;
mod risk;
mod subject;

use mishandle_results::{Answer, Command, Estimate, Repeats, WithoutVerdict};
use mishandle_text::{measured, without_middle};

use crate::run::without_verdict_text;

pub use axes::{axis_text, axis_value, value_text};
pub use check::check;
pub use comparison::comparison;
pub use falsification::{smallest_cause, sureness};
pub use hardening::hardening;
pub use margin::category_names;
pub use monitor::{LogAnswer, log, log_table, monitor, untested};
pub use subject::tested;

/// Largest number of characters of a text: names and formulas come from run files, which anybody
/// can write.
const MAX_TEXT: usize = 2000;

/// The conclusion of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Conclusion {
    /// The requirement is violated.
    Fails,
    /// Nothing tested violates the requirement, and the question measures how much that says.
    Holds,
    /// A search found no violation.
    NothingFound,
    /// Too few simulations have a verdict, or they ask nothing.
    NoVerdict,
    /// The second of two controllers is better.
    Better,
    /// It is worse.
    Worse,
    /// Neither is shown to be better.
    NoDifference,
}

impl Conclusion {
    /// Returns the word that stands first.
    pub fn name(self) -> &'static str {
        match self {
            Conclusion::Fails => "FAILS",
            Conclusion::Holds => "HOLDS",
            Conclusion::NothingFound => "NOTHING FOUND",
            Conclusion::NoVerdict => "NO VERDICT",
            Conclusion::Better => "BETTER",
            Conclusion::Worse => "WORSE",
            Conclusion::NoDifference => "NOT BETTER",
        }
    }
}

/// The meaning of an answer.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// The conclusion, which stands before the headline.
    pub conclusion: Conclusion,
    /// The tested system, and the numbers behind the conclusion.
    pub headline: String,
    /// A table below the headline, its first row the head; empty without one.
    pub table: Vec<Vec<String>>,
    /// Other facts, in the order in which they are shown.
    pub facts: Vec<Fact>,
    /// Next steps.
    pub next: Vec<NextStep>,
}

/// A fact with its label.
#[derive(Clone, Debug, PartialEq)]
pub struct Fact {
    /// Topic of the text, such as `cause`.
    pub label: &'static str,
    /// The text.
    pub text: String,
}

/// Something to do, with its label.
#[derive(Clone, Debug, PartialEq)]
pub struct NextStep {
    /// Purpose: `look`, `keep`, `fix` or `try`.
    pub label: &'static str,
    /// The command.
    pub command: Command,
}

/// A line of a verdict.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Line {
    /// The conclusion, or the label of a fact or of a next step.
    pub label: &'static str,
    /// The text.
    pub text: String,
    /// Whether the text is a command.
    pub is_command: bool,
}

impl Verdict {
    /// Returns all lines. `words` is how a front words a command.
    pub fn lines(&self, words: impl Fn(&Command) -> String) -> Vec<Line> {
        let line =
            |label, text: &str| Line { label, text: without_middle(text, MAX_TEXT), is_command: false };
        let headline = std::iter::once(line(self.conclusion.name(), &self.headline));
        let facts = self.facts.iter().map(|fact| line(fact.label, &fact.text));
        let next = self.next.iter().map(|step| Line {
            label: step.label,
            text: words(&step.command),
            is_command: true,
        });
        headline.chain(facts).chain(next).collect()
    }

    fn new(conclusion: Conclusion, headline: impl Into<String>) -> Verdict {
        Verdict {
            conclusion,
            headline: headline.into(),
            table: Vec::new(),
            facts: Vec::new(),
            next: Vec::new(),
        }
    }

    /// Adds a fact unless its text is empty.
    fn add(&mut self, label: &'static str, text: impl Into<String>) {
        let text = text.into();
        if !text.is_empty() {
            self.facts.push(Fact { label, text });
        }
    }

    fn then(&mut self, label: &'static str, command: Command) {
        self.next.push(NextStep { label, command });
    }
}

/// Returns what an answer means; `None` for relations between pairs of scenarios, which have a
/// table of their own.
pub fn verdict(answer: &Answer) -> Option<Verdict> {
    let mut verdict = match answer {
        Answer::Evaluation(found) => evaluation::verdict(found),
        Answer::Falsification(found) => falsification::verdict(found),
        Answer::Margin(found) => margin::verdict(found),
        Answer::Metamorphic(_) => return None,
        Answer::Risk(found) => risk::verdict(found),
        Answer::Hardening(found) => hardening(found),
    };
    for requirement in answer.requirements() {
        let nothing = requirement.asks_nothing.as_ref().filter(|_| requirement.simulations > 0);
        let nothing = nothing.map_or(String::new(), |reason| format!(": {reason}"));
        let violated = if requirement.simulations > 0 { "violated in " } else { "" };
        let text = format!("{}: {violated}{}{nothing}", requirement.name, requirement.violated_text());
        verdict.add("requirement", text);
    }
    if verdict.conclusion != Conclusion::Fails && !answer.asks_nothing().is_empty() {
        verdict.conclusion = Conclusion::NoVerdict;
        verdict.headline += &match answer {
            Answer::Evaluation(found) => nothing(found.asks_nothing.as_deref()),
            Answer::Margin(found) => nothing(found.asks_nothing.as_deref()),
            Answer::Risk(found) => nothing(found.asks_nothing.as_deref()),
            _ => String::new(),
        };
    }
    Some(verdict)
}

/// Returns why nothing was asked, as the end of a headline; empty if something was.
fn nothing(reason: Option<&str>) -> String {
    reason.map_or(String::new(), |reason| format!("; the requirement asks nothing: {reason}"))
}

/// Returns the share of simulations without a verdict and what they count as, as the start of a
/// headline; empty if all have one.
fn undecided(found: &WithoutVerdict, meaning: &str) -> String {
    let Some(text) = without_verdict_text(found) else { return String::new() };
    let meaning = if found.ends.total() > 0 { format!("; {meaning}") } else { String::new() };
    format!("{text}{meaning}. ")
}

/// Formats a rate as a percentage with at most four digits.
fn percent(rate: f64) -> String {
    format!("{} %", measured(100.0 * rate))
}

/// Formats a difference of rates with its interval: `+12 (+3 to +21)`, in percentage points.
fn points(difference: &Estimate) -> String {
    let signed = |value: f64| format!("{}{}", if value > 0.0 { "+" } else { "" }, measured(100.0 * value));
    let Some(value) = difference.value else { return "-".to_string() };
    match (difference.low, difference.high) {
        (Some(low), Some(high)) => format!("{} ({} to {})", signed(value), signed(low), signed(high)),
        _ => signed(value),
    }
}

/// End of a sentence about a failure that fails with at most half of the other seeds.
const LUCK: &str = ": the failure is the luck of its seed";

/// Says how often a failure fails with other seeds.
fn repeats_text(repeats: &Repeats) -> String {
    format!("fails in {} of {} repeats with other seeds", repeats.failures, repeats.failure_rate.n)
}
