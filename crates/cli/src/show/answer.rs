//! The answer of a run, as text.

use mishandle::results::Answer;

use super::{evaluation, falsification, hardening, margin, metamorphic, risk};

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
