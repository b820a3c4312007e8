//! The answer of a run, as text.

use anyhow::Result;
use mishandle::results::{Answer, EndCounts, WithoutVerdict};
use mishandle::run::without_verdict_text;
use mishandle::verdict::Verdict;

use super::{
    escape, evaluation, falsification, hardening, margin, metamorphic, mode_survey, output, risk, verdict,
};

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

/// Returns the first line of an answer that concludes nothing, because no simulation asks anything.
pub fn asks_nothing(reason: Option<&String>) -> String {
    reason.map_or(String::new(), |reason| {
        format!("asks nothing: {}; nothing is concluded\n", escape::name(reason))
    })
}

/// Prints what an answer means, and with `verbose` all tables and values.
///
/// # Errors
/// If stdout cannot be written.
pub fn print(found: &Answer, verbose: bool) -> Result<()> {
    let verdict = mishandle::verdict::verdict(found);
    let details = if verbose { details(found) } else { String::new() };
    print_parts(verdict.as_ref(), &below(found), &details)
}

/// Prints a verdict, what stands below it, and details, with empty lines between them.
///
/// # Errors
/// If stdout cannot be written.
pub fn print_parts(verdict: Option<&Verdict>, below: &str, details: &str) -> Result<()> {
    let mut has_any = false;
    if let Some(verdict) = verdict {
        output::styled(&verdict::text(verdict))?;
        has_any = true;
    }
    for part in [below, details] {
        let part = part.trim_start_matches('\n');
        if !part.is_empty() {
            output::line(&format!("{}{part}", if has_any { "\n" } else { "" }))?;
            has_any = true;
        }
    }
    Ok(())
}

/// Returns what stands below the verdict of an answer.
pub fn below(found: &Answer) -> String {
    match found {
        Answer::Evaluation(found) => evaluation::text(found),
        Answer::Falsification(found) => {
            let survey = found.modes.as_ref().map(|modes| mode_survey::text(&found.subject, modes));
            falsification::text(found) + &survey.map_or(String::new(), |survey| format!("\n{survey}"))
        }
        Answer::Margin(found) => margin::text(found),
        Answer::Metamorphic(found) => metamorphic::text(&[("metamorphic", found)]),
        Answer::Risk(found) => risk::text(found),
        Answer::Hardening(_) => String::new(),
    }
}

/// Returns all tables and values of an answer; empty if nothing is left out without them.
fn details(found: &Answer) -> String {
    match found {
        Answer::Evaluation(found) => evaluation::details(found),
        Answer::Falsification(found) => falsification::details(found),
        Answer::Margin(found) => margin::details(found),
        Answer::Metamorphic(_) => String::new(),
        Answer::Risk(found) => risk::details(found),
        Answer::Hardening(found) => hardening::details(found),
    }
}
