//! The answer that follows from the parts of an estimation.

use mishandle_evaluation::{Estimate, clopper_pearson};

use crate::importance::Importance;
use crate::splitting::{Disagreement, Splitting};
use crate::{CONFIDENCE, FREQUENT, MonteCarlo};

/// Confidence of the intervals that are compared. Two correct ones are apart with a probability of at most 2 %.
const CHECK: f64 = 0.99;

/// An interval of importance sampling that spans more than this factor is no estimate.
const USEFUL_RATIO: f64 = 10.0;

/// Bounds that span at most this factor are the interval of the answer: it then needs no assumption.
const TIGHT_RATIO: f64 = 3.0;

/// The probability of a failure, as far as the simulations show it.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// The part that the estimate is from; `None` without an estimate.
    pub source: Option<Source>,
    /// Estimate with a 95 % interval; no value without an estimate.
    pub estimate: Estimate,
    /// Whether the interval holds only under the assumption of its source.
    pub has_assumption: bool,
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
    /// The interval is below the lower bound of importance sampling, which holds without an assumption: the chains lost a failure mode.
    BelowImportance,
    /// The interval is above that of importance sampling: the searches missed a failure mode, or the chains are wrong. Neither is trusted.
    AboveImportance,
}

impl Answer {
    pub(crate) fn new(
        monte_carlo: &MonteCarlo,
        splitting: Option<&Splitting>,
        importance: Option<&Importance>,
    ) -> Answer {
        let bounds = bounds(monte_carlo, importance);
        let weighted = importance.and_then(|importance| weighted(importance, monte_carlo, bounds));
        let splitting = splitting.map(|splitting| {
            checked(splitting, monte_carlo, importance, weighted.map(|(estimate, _)| estimate))
        });
        let (accepted, splitting_refusal) = match splitting {
            Some(Ok(estimate)) => (Some(estimate), None),
            Some(Err(refusal)) => (None, Some(refusal)),
            None => (None, None),
        };
        // Chains that agree on more than the regions contain have seen a mode that the regions lack, or are wrong.
        let weighted = weighted.filter(|_| splitting_refusal != Some(Refusal::AboveImportance));
        let plain = |failures: u64| (monte_carlo.failures >= failures).then(|| monte_carlo.estimate());
        let frequent = plain(FREQUENT).filter(|_| importance.is_none());
        let (source, estimate, has_assumption) = if let Some(estimate) = frequent {
            (Some(Source::MonteCarlo), estimate, false)
        } else if let Some((estimate, has_assumption)) = weighted {
            (Some(Source::Importance), estimate, has_assumption)
        } else if let Some(estimate) = accepted {
            (Some(Source::Splitting), estimate, true)
        } else if let Some(estimate) = plain(1) {
            (Some(Source::MonteCarlo), estimate, false)
        } else {
            (None, Estimate::default(), false)
        };
        Answer { source, estimate, has_assumption, bounds, splitting_refusal }
    }
}

/// Returns bounds that hold without an assumption: those of Monte Carlo, or the sums of the bounds of the failures in the regions and
/// outside of them, each with a confidence of 97.5 %.
fn bounds(monte_carlo: &MonteCarlo, importance: Option<&Importance>) -> [f64; 2] {
    let pair = |estimate: Estimate| [estimate.low.unwrap_or(0.0), estimate.high.unwrap_or(1.0)];
    let Some(importance) = importance else { return pair(monte_carlo.estimate()) };
    let inside = pair(importance.wide);
    let outside = pair(outside(importance, monte_carlo, 0.5 + 0.5 * CONFIDENCE));
    [inside[0] + outside[0], (inside[1] + outside[1]).min(1.0)]
}

/// Returns the probability of failures outside of the regions, from Monte Carlo, to which they were not fitted.
fn outside(importance: &Importance, monte_carlo: &MonteCarlo, confidence: f64) -> Estimate {
    clopper_pearson(importance.monte_carlo_outside, monte_carlo.simulations, confidence)
}

/// Returns the estimate of importance sampling and whether its interval has an assumption; `None` if it is too uncertain.
///
/// If Monte Carlo has failures outside of the regions, they are added. Otherwise the estimate is that of the regions. Bounds without an
/// assumption are the interval if they are tight, or if the failures outside make the assumption wrong.
fn weighted(
    importance: &Importance,
    monte_carlo: &MonteCarlo,
    [low, high]: [f64; 2],
) -> Option<(Estimate, bool)> {
    let has_outside = importance.monte_carlo_outside > 0;
    let n = importance.simulations + monte_carlo.simulations;
    let more = outside(importance, monte_carlo, CONFIDENCE).value.unwrap_or(0.0);
    let value = importance.regions.value.map(|inside| inside + more);
    let free = Estimate { value, low: Some(low), high: Some(high), n };
    let has_assumption = !has_outside && high > TIGHT_RATIO * low;
    let estimate = if has_assumption { importance.regions } else { free };
    (importance.is_reliable() && is_useful(&estimate)).then_some((estimate, has_assumption))
}

fn is_useful(estimate: &Estimate) -> bool {
    matches!((estimate.low, estimate.high), (Some(low), Some(high)) if low > 0.0 && high <= USEFUL_RATIO * low)
}

/// Returns the estimate of splitting, unless its chains disagree or another part contradicts it.
fn checked(
    splitting: &Splitting,
    monte_carlo: &MonteCarlo,
    importance: Option<&Importance>,
    weighted: Option<Estimate>,
) -> Result<Estimate, Refusal> {
    let estimate = splitting.estimate().map_err(Refusal::Chains)?;
    let wide = splitting.wide_estimate().map_err(Refusal::Chains)?;
    if are_apart(&wide, &monte_carlo.estimate_at(CHECK)) {
        return Err(Refusal::MonteCarlo);
    }
    if importance.is_some_and(|importance| wide.high < importance.wide.low) {
        return Err(Refusal::BelowImportance);
    }
    if weighted.is_some_and(|weighted| wide.low > weighted.high) {
        return Err(Refusal::AboveImportance);
    }
    Ok(estimate)
}

fn are_apart(a: &Estimate, b: &Estimate) -> bool {
    a.high < b.low || b.high < a.low
}
