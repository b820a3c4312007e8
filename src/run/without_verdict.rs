//! Simulations without a verdict: their share of the simulations of a question, and the one
//! sentence about them.

use mishandle_evaluation::count_end;
use mishandle_results::{Answer, Comparison, EndCounts, WithoutVerdict};
use mishandle_store::{MAX_TRIALS, RunFile};
use mishandle_text::plural;

use crate::error::MishandleError;
use crate::run::margin::SEARCH;
use crate::run::rows::episode_end;

/// Returns the simulations of a question without a verdict.
pub(super) fn without_verdict(
    answer: &Answer,
    run: &RunFile,
    max_share: f64,
) -> Result<WithoutVerdict, MishandleError> {
    let ends = match answer {
        // The two phases of a screening estimate the share.
        Answer::Evaluation(found) if found.screening.is_some() => return Ok(found.without_verdict),
        // The success formula decides.
        Answer::Evaluation(found) => found.metrics.ends(),
        // Only the simulations of Monte Carlo are a random sample.
        Answer::Risk(found) => return Ok(found.without_verdict),
        // The repeats of the witness are another trial.
        Answer::Margin(_) => recorded_ends(run, SEARCH)?,
        Answer::Falsification(_) | Answer::Metamorphic(_) => recorded_ends(run, MAX_TRIALS)?,
        Answer::Hardening(found) => return Ok(found.without_verdict),
    };
    Ok(WithoutVerdict::new(ends, max_share))
}

/// Returns how the recorded simulations up to a trial ended.
fn recorded_ends(run: &RunFile, last_trial: u32) -> Result<EndCounts, MishandleError> {
    let mut counts = EndCounts::default();
    for (end, [decided, undecided]) in run.ends(0..=last_trial)? {
        let end = episode_end(end);
        count_end(&mut counts, end, true, decided);
        count_end(&mut counts, end, false, undecided);
    }
    Ok(counts)
}

/// Returns the sentence about simulations without a verdict and about scenarios from which the
/// target cannot start; `None` if there are neither.
///
/// # Example
/// ```
/// use mishandle::results::{EndCounts, WithoutVerdict};
/// use mishandle::run::without_verdict_text;
/// let ends = EndCounts { simulations: 200, diverged: 70, ..EndCounts::default() };
/// let expected = "70 of 200 simulations (35.0 %) have no verdict: 70 diverged";
/// assert_eq!(without_verdict_text(&WithoutVerdict::new(ends, 0.05)).as_deref(), Some(expected));
/// ```
pub fn without_verdict_text(found: &WithoutVerdict) -> Option<String> {
    let ends = &found.ends;
    let invalid_starts = match ends.invalid_starts {
        0 => None,
        n => Some(format!("{}, from which the target cannot start", plural(n, "scenario"))),
    };
    let Some(share) = ends.share().filter(|share| *share > 0.0) else {
        return invalid_starts.map(|starts| format!("left out: {starts}"));
    };
    let given = ends.reasons().into_iter().filter(|(count, _)| *count > 0);
    let given: Vec<String> = given.map(|(count, reason)| format!("{count} {reason}")).collect();
    // A screening repeats more of the simulations without a verdict than of the others.
    let (kind, share) = match found.share.filter(|estimate| *estimate != share) {
        Some(estimate) => ("repeated simulation", format!("an estimated {} of all", share_text(estimate))),
        None => ("simulation", share_text(share)),
    };
    let all = plural(ends.simulations, kind);
    let how_many = match ends.total() {
        total if total == ends.simulations && kind == "simulation" => format!("none of {all} has a verdict"),
        1 => format!("1 of {all} ({share}) has no verdict"),
        total => format!("{total} of {all} ({share}) have no verdict"),
    };
    let left_out = invalid_starts.map_or(String::new(), |starts| format!("; left out: {starts}"));
    Some(format!("{how_many}: {}{left_out}", given.join(", ")))
}

/// Returns why a question has no conclusion; `None` if enough of its simulations have a verdict.
pub fn inconclusive_text(found: &WithoutVerdict) -> Option<String> {
    let why = match found.share {
        _ if !found.is_too_large() => return None,
        None => "no simulation started".to_string(),
        Some(share) => format!(
            "{} of the simulations have no verdict, more than {}",
            share_text(share),
            share_text(found.max_share)
        ),
    };
    Some(format!("no conclusion: {why} (max-without-verdict)"))
}

/// Returns the sentences about both runs of a comparison.
pub fn compared_without_verdict(found: &Comparison) -> Vec<String> {
    let runs = [("A", &found.first), ("B", &found.second)];
    let text = |(name, run): (&str, &mishandle_results::ComparedRun)| {
        Some(format!("{name}: {}", without_verdict_text(&run.without_verdict)?))
    };
    runs.into_iter().filter_map(text).collect()
}

/// Formats a share in percent. Only all are 100 %, and only none is 0 %.
fn share_text(share: f64) -> String {
    let percent = 100.0 * share;
    let text = format!("{percent:.1} %");
    match text.as_str() {
        "0.0 %" if share > 0.0 => "less than 0.1 %".to_string(),
        "100.0 %" if share < 1.0 => "more than 99.9 %".to_string(),
        _ => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ends(simulations: u64, failed: u64, invalid_starts: u64) -> EndCounts {
        EndCounts { simulations, failed, invalid_starts, ..EndCounts::default() }
    }

    #[test]
    fn the_sentence_names_the_share_the_reasons_and_scenarios_without_a_start() {
        let text = |ends: EndCounts| without_verdict_text(&WithoutVerdict::new(ends, 0.05));
        assert_eq!(text(ends(10, 0, 0)), None);
        let expected = "left out: 2 scenarios, from which the target cannot start";
        assert_eq!(text(ends(10, 0, 2)).as_deref(), Some(expected));
        let both = EndCounts { undecided: 1, invalid: 2, ..ends(30, 3, 1) };
        let expected = "6 of 30 simulations (20.0 %) have no verdict: 2 ended in a value that is not finite, \
                        3 failed (crash, invalid answer or time limit), 1 left the formula undecided; left out: 1 scenario, \
                        from which the target cannot start";
        assert_eq!(text(both).as_deref(), Some(expected));
        let expected = "none of 2 simulations has a verdict: 2 failed (crash, invalid answer or time limit)";
        assert_eq!(text(ends(2, 2, 0)).as_deref(), Some(expected));
        let screened = WithoutVerdict { share: Some(0.004), ..WithoutVerdict::new(ends(20, 20, 0), 0.05) };
        let expected = "20 of 20 repeated simulations (an estimated 0.4 % of all) have no verdict: 20 failed (crash, invalid answer or time limit)";
        assert_eq!(without_verdict_text(&screened).as_deref(), Some(expected));
    }

    #[test]
    fn a_share_is_zero_or_one_only_if_none_or_all_are() {
        assert_eq!(
            [0.0, 1e-5, 0.05, 0.99999, 1.0].map(share_text),
            ["0.0 %", "less than 0.1 %", "5.0 %", "more than 99.9 %", "100.0 %"]
        );
    }

    #[test]
    fn a_question_without_a_conclusion_says_why() {
        let text = |ends: EndCounts| inconclusive_text(&WithoutVerdict::new(ends, 0.05));
        assert_eq!(text(ends(20, 1, 50)), None);
        let expected =
            "no conclusion: 10.0 % of the simulations have no verdict, more than 5.0 % (max-without-verdict)";
        assert_eq!(text(ends(20, 2, 0)).as_deref(), Some(expected));
        let expected = "no conclusion: no simulation started (max-without-verdict)";
        assert_eq!(text(ends(0, 0, 5)).as_deref(), Some(expected));
    }
}
