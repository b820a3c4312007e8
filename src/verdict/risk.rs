//! How probable a violation is.

use mishandle_results::{Command, Risk};
use mishandle_risk::Method;
use mishandle_text::{plural, probability_text as probability};

use super::axes::off_nominal;
use super::subject::tested;
use super::{Conclusion, Verdict, undecided};

/// Largest number of axes of a failure that are named.
const NAMED: usize = 4;

pub(super) fn verdict(found: &Risk) -> Verdict {
    let is_violated = !found.failures.is_empty();
    let [low, high] = found.bounds.map(probability);
    let bounds = format!("from {low} to {high} with 95 % confidence, which assumes nothing");
    let estimate = found.probability.as_ref().filter(|estimate| estimate.assumption.is_none());
    let answer = match estimate.and_then(|estimate| estimate.value) {
        Some(value) => format!("the probability of a violation is {}, {bounds}", probability(value)),
        None => format!("the probability of a violation is {bounds}"),
    };
    let is_untested = found.monte_carlo.failure_rate.value.is_none() || found.without_verdict.is_too_large();
    let conclusion = match (is_violated, is_untested) {
        (true, _) => Conclusion::Fails,
        (false, true) => Conclusion::NoVerdict,
        (false, false) => Conclusion::NothingFound,
    };
    // The chosen method was not run: the answer is that of another one.
    let is_leading =
        found.method == Method::Splitting.name() && found.splitting_refusal.as_deref() == Some("budget");
    let refused: String = found.refusals.iter().map(|refusal| format!("no estimate: {refusal}; ")).collect();
    let answer = if is_leading { refused + &answer } else { answer };
    let undecided = undecided(&found.without_verdict, "the bounds count them as failures");
    let interrupted = if found.is_complete { "" } else { "; interrupted" };
    let mut verdict =
        Verdict::new(conclusion, format!("{undecided}{}: {answer}{interrupted}", tested(&found.subject)));
    verdict.add("from", evidence(found));
    verdict.add(
        "if",
        match &found.probability {
            Some(estimate) => match (&estimate.assumption, estimate.value, estimate.low, estimate.high) {
                (Some(assumption), Some(value), Some(low), Some(high)) => format!(
                    "{assumption}: {}, 95 % interval {} to {}",
                    probability(value),
                    probability(low),
                    probability(high)
                ),
                _ => String::new(),
            },
            None => String::new(),
        },
    );
    for refusal in found.refusals.iter().filter(|_| !is_leading) {
        verdict.add("but", format!("no estimate: {refusal}"));
    }
    verdict.add("nearest", nearest(found));
    if let Some(run) = &found.run {
        verdict.then("look", Command::Report { run: run.clone() });
        if is_violated {
            verdict.then("keep", Command::Keep { run: run.clone() });
        }
    }
    verdict
}

/// Says which simulations the bounds rest on.
fn evidence(found: &Risk) -> String {
    let monte_carlo = &found.monte_carlo;
    let random = format!(
        "{} of the distribution: {}",
        plural(monte_carlo.simulations, "random simulation"),
        monte_carlo.counts_text()
    );
    let starts = match monte_carlo.invalid_starts {
        0 => String::new(),
        n => format!("; left out: {}, from which the target cannot start", plural(n, "scenario")),
    };
    match found.simulations - monte_carlo.simulations {
        0 => random + &starts,
        others => format!(
            "{random}{starts}; {} search for failures or weigh them",
            plural(others, "other simulation")
        ),
    }
}

/// Describes the failure that is nearest to the center of the distribution.
fn nearest(found: &Risk) -> String {
    let Some(failure) = found.failures.first() else { return String::new() };
    let values = found.subject.space_axes.iter().zip(failure.scenario.values().copied());
    let off: Vec<_> = values.filter(|(axis, value)| value.is_some() && *value != axis.nominal).collect();
    let control_dt = found.subject.control_dt;
    let named: Vec<String> =
        off.iter().take(NAMED).map(|(axis, value)| off_nominal(axis, *value, control_dt)).collect();
    let more = match off.len().saturating_sub(NAMED) {
        0 => String::new(),
        more => format!(" and {}", plural(more as u64, "other value")),
    };
    format!("{}{more} (simulation {})", named.join(", "), failure.simulation)
}
