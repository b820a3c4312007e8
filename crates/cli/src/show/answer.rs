//! The answer of a run, as text.

use mishandle::results::{Answer, EndCounts, WithoutVerdict};
use mishandle::run::without_verdict_text;

use super::{evaluation, falsification, hardening, margin, metamorphic, risk};

/// Returns the first line of an answer with simulations without a verdict; empty if all have one.
/// `meaning` says what they count as.
pub fn without_verdict(found: &WithoutVerdict, meaning: &str) -> String {
    let EndCounts { invalid_starts, .. } = found.ends;
    let text = |ends: EndCounts| without_verdict_text(&WithoutVerdict { ends, ..*found });
    let undecided = text(EndCounts { invalid_starts: 0, ..found.ends });
    let left_out = text(EndCounts { invalid_starts, ..EndCounts::default() });
    let parts: Vec<String> =
        undecided.map(|text| format!("{text}; {meaning}")).into_iter().chain(left_out).collect();
    if parts.is_empty() { String::new() } else { format!("{}\n", parts.join("; ")) }
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
