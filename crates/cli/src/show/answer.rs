//! The answer of a run, as text.

use mishandle::results::{Answer, WithoutVerdict};
use mishandle::run::without_verdict_text;

use super::{evaluation, falsification, hardening, margin, metamorphic, risk};

/// Returns the first line of an answer with simulations without a verdict; empty if all have one.
/// `meaning` says what they count as.
pub fn without_verdict(found: &WithoutVerdict, meaning: &str) -> String {
    match without_verdict_text(&found.ends) {
        Some(text) if found.ends.total() > 0 => format!("{text}; {meaning}\n"),
        Some(text) => format!("{text}\n"),
        None => String::new(),
    }
}

/// Returns the answer as the command of its question prints it.
pub fn text(found: &Answer) -> String {
    match found {
        Answer::Evaluation(found) => evaluation::text(found),
        Answer::Falsification(found) => falsification::text(found),
        Answer::Margin(found) => margin::text(found),
        Answer::Metamorphic(found) => metamorphic::text(&[("metamorphic", found)]),
        Answer::Risk(found) => risk::text(found),
        Answer::Hardening(found) => hardening::text(found),
    }
}
