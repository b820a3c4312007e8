//! The answer that follows from the parts of an estimation.

use mishandle_evaluation::{Estimate, clopper_pearson};

use crate::importance::Importance;
use crate::splitting::{Disagreement, Splitting};
use crate::{CONFIDENCE, FREQUENT, MonteCarlo};

/// Confidence of the intervals that are compared. Two correct ones are apart with a probability of at most 2 %.
const CHECK: f64 = 0.99;

/// An interval of importance sampling that spans more than this factor is no estimate.
const USEFUL_RATIO: f64 = 10.0;

/// Importance sampling with fewer equally weighted failures is no estimate: a draw with a large weight may be missing.
const FEWEST_EFFECTIVE: f64 = 20.0;

/// Largest probability outside of the regions, as a fraction of that inside, with which the regions are an estimate.
const MOST_OUTSIDE: f64 = 0.2;

/// Bounds that span at most this factor are the interval of the answer: it then needs no assumption.
const TIGHT_RATIO: f64 = 3.0;

/// The probability of a failure, as far as the simulations show it.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// The part that the estimate is from; `None` without an estimate.
    pub source: Option<Source>,
    /// Estimate with a 95 % interval, which holds under the assumption of its source; no value without an estimate.
    pub estimate: Estimate,
    /// Bounds (95 %) that hold without an assumption.
    pub bounds: [f64; 2],
    /// Why multilevel splitting is not trusted; `None` if it is, or was not run.
    pub splitting_refusal: Option<Refusal>,
}

/// The part of an estimation that an answer is from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// Monte Carlo: no assumption.
    MonteCarlo,
    /// Importance sampling, plus the failures of Monte Carlo outside of its regions. Assumes that failures outside of the regions are
    /// negligible if Monte Carlo has none.
    Importance,
    /// Multilevel splitting. Assumes that the chains lost no failure mode.
    Splitting,
}

/// Why an estimate is refused.
#[derive(Clone, Debug, PartialEq)]
pub enum Refusal {
    /// The chains disagree.
    Chains(Disagreement),
    /// The interval is apart from that of Monte Carlo.
    MonteCarlo,
    /// The interval is apart from that of importance sampling.
    Importance,
}

impl Answer {
    pub(crate) fn new(
        monte_carlo: &MonteCarlo,
        splitting: Option<&Splitting>,
        importance: Option<&Importance>,
    ) -> Answer {
        let bounds = bounds(monte_carlo, importance);
        let splitting = splitting.map(|splitting| checked(splitting, monte_carlo, importance));
        let (accepted, splitting_refusal) = match splitting {
            Some(Ok(estimate)) => (Some(estimate), None),
            Some(Err(refusal)) => (None, Some(refusal)),
            None => (None, None),
        };
        // Chains that agree on more than the regions contain have seen a mode that the regions lack, or both are wrong.
        let is_contradicted = splitting_refusal == Some(Refusal::Importance);
        let weighted = importance
            .filter(|importance| is_reliable(importance))
            .map(|importance| with_outside(importance, monte_carlo, bounds))
            .filter(|estimate| is_useful(estimate) && !is_contradicted);
        let (source, estimate) = if monte_carlo.failures >= FREQUENT && importance.is_none() {
            (Some(Source::MonteCarlo), monte_carlo.estimate())
        } else if let Some(estimate) = weighted {
            (Some(Source::Importance), estimate)
        } else if let Some(estimate) = accepted {
            (Some(Source::Splitting), estimate)
        } else if monte_carlo.failures > 0 {
            (Some(Source::MonteCarlo), monte_carlo.estimate())
        } else {
            (None, Estimate::default())
        };
        Answer { source, estimate, bounds, splitting_refusal }
    }
}

/// Returns bounds that hold without an assumption: those of Monte Carlo, or the sums of the bounds of the failures in the regions and
/// outside of them, each with a confidence of 97.5 %.
fn bounds(monte_carlo: &MonteCarlo, importance: Option<&Importance>) -> [f64; 2] {
    let pair = |estimate: Estimate| [estimate.low.unwrap_or(0.0), estimate.high.unwrap_or(1.0)];
    let Some(importance) = importance else { return pair(monte_carlo.estimate()) };
    let inside = pair(importance.wide);
    let outside = outside(importance, monte_carlo, 0.5 + 0.5 * CONFIDENCE);
    let outside = pair(outside);
    [inside[0] + outside[0], (inside[1] + outside[1]).min(1.0)]
}

/// Returns the probability of failures outside of the regions, from Monte Carlo, to which they were not fitted.
fn outside(importance: &Importance, monte_carlo: &MonteCarlo, confidence: f64) -> Estimate {
    clopper_pearson(importance.monte_carlo_outside, monte_carlo.simulations, confidence)
}

/// Returns the estimate of importance sampling. If Monte Carlo has failures outside of the regions, they are added. The interval is that of
/// the regions, or else the one without an assumption.
fn with_outside(importance: &Importance, monte_carlo: &MonteCarlo, [low, high]: [f64; 2]) -> Estimate {
    if importance.monte_carlo_outside == 0 && high > TIGHT_RATIO * low {
        return importance.regions;
    }
    let more = outside(importance, monte_carlo, CONFIDENCE).value.unwrap_or(0.0);
    let value = importance.regions.value.map(|inside| inside + more);
    Estimate { value, low: Some(low), high: Some(high), n: importance.simulations + monte_carlo.simulations }
}

fn is_reliable(importance: &Importance) -> bool {
    let inside = importance.regions.value.unwrap_or(0.0);
    importance.effective_failures >= FEWEST_EFFECTIVE && importance.outside <= MOST_OUTSIDE * inside
}

fn is_useful(estimate: &Estimate) -> bool {
    matches!((estimate.low, estimate.high), (Some(low), Some(high)) if low > 0.0 && high <= USEFUL_RATIO * low)
}

/// Returns the estimate of splitting, unless its chains disagree or another part contradicts it.
fn checked(
    splitting: &Splitting,
    monte_carlo: &MonteCarlo,
    importance: Option<&Importance>,
) -> Result<Estimate, Refusal> {
    let estimate = splitting.estimate().map_err(Refusal::Chains)?;
    if are_apart(&estimate, &monte_carlo.estimate_at(CHECK)) {
        return Err(Refusal::MonteCarlo);
    }
    if importance.is_some_and(|importance| {
        is_reliable(importance)
            && is_useful(&importance.regions)
            && are_apart(
                &estimate,
                &with_outside(importance, monte_carlo, bounds(monte_carlo, Some(importance))),
            )
    }) {
        return Err(Refusal::Importance);
    }
    Ok(estimate)
}

fn are_apart(a: &Estimate, b: &Estimate) -> bool {
    a.high < b.low || b.high < a.low
}
