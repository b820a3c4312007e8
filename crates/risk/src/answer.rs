//! The answer that follows from the parts of an estimation.

use mishandle_evaluation::{Estimate, clopper_pearson};

use crate::importance::Importance;
use crate::splitting::{Disagreement, Splitting};
use crate::{CONFIDENCE, FREQUENT, Method, MonteCarlo};

/// Confidence of the intervals that are compared. Two correct ones are apart with a probability of
/// at most 2 %.
const CHECK: f64 = 0.99;

/// An interval of importance sampling that spans more than this factor is not an estimate.
const USEFUL_RATIO: f64 = 10.0;

/// Bounds that span at most this factor are the interval of the answer: it then needs no
/// assumption.
const TIGHT_RATIO: f64 = 3.0;

/// The probability of a failure, as far as the simulations show it.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// The part that the estimate is from; `None` without an estimate.
    pub source: Option<Source>,
    /// Estimate with a 95 % interval; no value without an estimate.
    pub estimate: Estimate,
    /// Whether the interval holds only under the assumption of its source. Without it, too, the
    /// interval counts simulations of Monte Carlo without a verdict as passed.
    pub has_assumption: bool,
    /// Bounds (95 %) that hold without an assumption. For the upper one, simulations without a
    /// verdict are failures.
    pub bounds: [f64; 2],
    /// Why multilevel splitting has no estimate; `None` if it has one, or was not needed.
    pub splitting_refusal: Option<Refusal>,
}

/// The part of an estimation that an answer is from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// Monte Carlo: no assumption of its own.
    MonteCarlo,
    /// Importance sampling, plus the failures of Monte Carlo outside of its regions. Assumes that
    /// failures outside of the regions are negligible if Monte Carlo has none.
    Importance,
    /// Multilevel splitting. Assumes that the chains lost no failure mode.
    Splitting,
}

impl Source {
    /// Returns the name, which is that of a method.
    pub fn name(self) -> &'static str {
        match self {
            Source::MonteCarlo => Method::MonteCarlo,
            Source::Importance => Method::Importance,
            Source::Splitting => Method::Splitting,
        }
        .name()
    }
}

/// Why an estimate is refused.
#[derive(Clone, Debug, PartialEq)]
pub enum Refusal {
    /// Its part of the budget is too small for an estimate. If it is large enough for chains, they
    /// only find failures.
    Budget {
        /// Number of simulations of its part.
        simulations: u64,
        /// Fewest simulations of the whole estimation for an estimate of this part.
        needed: u64,
    },
    /// The target cannot start from some scenarios. The chains estimate the probability of a
    /// violation among all of them, not among the valid ones.
    InvalidStarts,
    /// The chains disagree or are too small.
    Chains(Disagreement),
    /// The interval is apart from that of Monte Carlo.
    MonteCarlo,
    /// The interval is below the lower bound of importance sampling, which holds without an
    /// assumption: the chains lost a failure mode.
    BelowImportance,
    /// The interval is above that of importance sampling: the searches missed a failure mode, or
    /// the chains are wrong. Neither is trusted.
    AboveImportance,
}

impl Answer {
    pub(crate) fn new(
        monte_carlo: &MonteCarlo,
        splitting: Option<&Splitting>,
        importance: Option<&Importance>,
    ) -> Answer {
        let all_valid = monte_carlo.ends.invalid_starts == 0;
        // The regions have a probability among all scenarios, too.
        let importance = importance.filter(|_| all_valid);
        let bounds = bounds(monte_carlo, importance);
        let weighted = importance.and_then(|importance| weighted(importance, monte_carlo, bounds));
        let splitting = splitting.map(|splitting| {
            if all_valid {
                checked(splitting, monte_carlo, importance, weighted.map(|(estimate, _)| estimate))
            } else {
                Err(Refusal::InvalidStarts)
            }
        });
        let (accepted, splitting_refusal) = match splitting {
            Some(Ok(estimate)) => (Some(estimate), None),
            Some(Err(refusal)) => (None, Some(refusal)),
            None => (None, None),
        };
        // Chains that agree on more than the regions contain have seen a mode that the regions
        // lack, or are wrong.
        let weighted = weighted.filter(|_| splitting_refusal != Some(Refusal::AboveImportance));
        let all_decided = monte_carlo.ends.total() == 0;
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
        // If Monte Carlo answers and has all verdicts, its interval has no assumption, so it is the
        // bounds, too.
        let bounds = match (source, estimate.low, estimate.high) {
            (Some(Source::MonteCarlo), Some(low), Some(high)) if all_decided => [low, high],
            _ => bounds,
        };
        Answer { source, estimate, has_assumption, bounds, splitting_refusal }
    }
}

/// Returns bounds that hold without an assumption: those of Monte Carlo, or the sums of the bounds
/// of the failures in the regions and outside of them, each with a confidence of 97.5 %. With
/// simulations without a verdict, the upper one is that of Monte Carlo in which they fail: the
/// weights of importance sampling do not know where they lie.
fn bounds(monte_carlo: &MonteCarlo, importance: Option<&Importance>) -> [f64; 2] {
    let pair = |estimate: Estimate| [estimate.low.unwrap_or(0.0), estimate.high.unwrap_or(1.0)];
    let [low, high] = match importance {
        None => pair(monte_carlo.estimate()),
        Some(importance) => {
            let inside = pair(importance.wide);
            let outside = pair(outside(importance, monte_carlo, 0.5 + 0.5 * CONFIDENCE));
            [inside[0] + outside[0], (inside[1] + outside[1]).min(1.0)]
        }
    };
    let undecided = (monte_carlo.ends.total() > 0 && monte_carlo.has_verdict())
        .then(|| monte_carlo.bound_with_undecided())
        .flatten();
    [low, undecided.unwrap_or(high)]
}

/// Returns the probability of failures outside of the regions, from Monte Carlo, to which they were
/// not fitted.
fn outside(importance: &Importance, monte_carlo: &MonteCarlo, confidence: f64) -> Estimate {
    clopper_pearson(importance.monte_carlo_outside, monte_carlo.valid(), confidence)
}

/// Returns the estimate of importance sampling and whether its interval has an assumption; `None`
/// if it is too uncertain.
///
/// If Monte Carlo has failures outside of the regions, they are added. Otherwise the estimate is
/// that of the regions. Bounds without an assumption are the interval if they are tight, or if the
/// failures outside make the assumption wrong.
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

#[cfg(test)]
mod tests {
    use super::*;
    use mishandle_results::{Chain, EndCounts};

    fn chains(probabilities: [f64; 5]) -> Splitting {
        let chain =
            |probability| Chain { level: 0.0, probability, is_complete: true, levels: 9, acceptance: 0.4 };
        Splitting { simulations: 1000, population: 200, chains: probabilities.map(chain).to_vec() }
    }

    fn monte_carlo(failures: u64) -> MonteCarlo {
        MonteCarlo { simulations: 5000, failures, ..MonteCarlo::default() }
    }

    /// Importance sampling of this probability within 10 %.
    fn regions(value: f64, monte_carlo_outside: u64) -> Importance {
        let within = |factor: f64| Estimate {
            value: Some(value),
            low: Some(value / factor),
            high: Some(value * factor),
            n: 2000,
        };
        Importance {
            simulations: 2000,
            failures: 900,
            fitting: 500,
            components: 1,
            effective_failures: 500.0,
            outside: 0.0,
            monte_carlo_inside: 0,
            monte_carlo_outside,
            regions: within(1.1),
            wide: within(1.12),
        }
    }

    /// The measured defect: chains that all lost a mode agree on 4e-9 within 30 %, where the truth
    /// is 2e-3.
    #[test]
    fn chains_that_agree_are_refused_if_monte_carlo_contradicts_them() {
        let agreeing = chains([4e-9, 5e-9, 3.5e-9, 4.2e-9, 4.4e-9]);
        assert!(agreeing.estimate().is_ok());
        let answer = Answer::new(&monte_carlo(10), Some(&agreeing), None);
        assert_eq!(answer.splitting_refusal, Some(Refusal::MonteCarlo));
        assert_eq!(answer.source, Some(Source::MonteCarlo));
        // Without failures, Monte Carlo does not contradict them.
        assert_eq!(Answer::new(&monte_carlo(0), Some(&agreeing), None).source, Some(Source::Splitting));
    }

    /// Two intervals that both assume nothing would leave the choice to the reader.
    #[test]
    fn the_bounds_are_the_interval_of_monte_carlo_if_it_answers() {
        let unreliable = Importance { effective_failures: 1.0, ..regions(1e-3, 5) };
        let answer = Answer::new(&monte_carlo(5), None, Some(&unreliable));
        assert_eq!(answer.source, Some(Source::MonteCarlo));
        assert_eq!([answer.estimate.low, answer.estimate.high], answer.bounds.map(Some));
    }

    #[test]
    fn chains_that_disagree_have_no_estimate() {
        let refusal =
            |splitting: &Splitting| Answer::new(&monte_carlo(0), Some(splitting), None).splitting_refusal;
        let spread = refusal(&chains([1e-6, 2e-6, 1e-6, 3e-6, 2e-5]));
        assert!(
            matches!(spread, Some(Refusal::Chains(Disagreement::Spread { ratio })) if (ratio - 20.0).abs() < 1e-9)
        );
        let extinct = refusal(&chains([1e-6, 2e-6, 0.0, 3e-6, 2e-6]));
        assert_eq!(extinct, Some(Refusal::Chains(Disagreement::Extinct { extinct: 1 })));
        let small = Splitting { population: 179, ..chains([1e-6; 5]) };
        assert_eq!(refusal(&small), Some(Refusal::Chains(Disagreement::Small { population: 179 })));
        let mut incomplete = chains([1e-6; 5]);
        incomplete.chains[2].is_complete = false;
        let expected = Some(Refusal::Chains(Disagreement::Incomplete { complete: 4 }));
        assert_eq!(refusal(&incomplete), expected);
    }

    #[test]
    fn chains_below_the_regions_are_refused_and_chains_above_them_refuse_both() {
        let weighted = regions(1e-6, 0);
        let answer = |p: f64| {
            let agreeing = chains([p, 1.1 * p, 0.9 * p, 1.05 * p, 0.95 * p]);
            Answer::new(&monte_carlo(0), Some(&agreeing), Some(&weighted))
        };
        let below = answer(1e-7);
        assert_eq!(below.splitting_refusal, Some(Refusal::BelowImportance));
        assert_eq!((below.source, below.estimate.value), (Some(Source::Importance), Some(1e-6)));
        let above = answer(1e-5);
        assert_eq!((above.splitting_refusal, above.source), (Some(Refusal::AboveImportance), None));
        let equal = answer(1e-6);
        assert_eq!((equal.splitting_refusal, equal.source), (None, Some(Source::Importance)));
        assert!(equal.has_assumption && equal.bounds[0] == 1e-6 / 1.12);
    }

    #[test]
    fn failures_of_monte_carlo_outside_of_the_regions_are_added() {
        // 4 of 5000 outside: 8e-4 more, with the interval of Clopper and Pearson at 97.5 % and that
        // of the regions.
        let answer = Answer::new(&monte_carlo(4), None, Some(&regions(1e-3, 4)));
        assert!((answer.estimate.value.unwrap() - 1.8e-3).abs() < 1e-15 && !answer.has_assumption);
        let outside = clopper_pearson(4, 5000, 0.975);
        assert_eq!(answer.estimate.low, Some(1e-3 / 1.12 + outside.low.unwrap()));
        assert_eq!(answer.bounds, [answer.estimate.low.unwrap(), answer.estimate.high.unwrap()]);
    }

    /// 35 % of the space has no verdict and nothing else fails: the probability is up to 0.35.
    #[test]
    fn bounds_without_an_assumption_count_simulations_without_a_verdict_as_failures() {
        let ends = |diverged: u64| EndCounts { simulations: 5000, diverged, ..EndCounts::default() };
        let undecided = |failures: u64| MonteCarlo { ends: ends(1750), ..monte_carlo(failures) };
        let found = Answer::new(&undecided(0), None, None);
        // Two-sided 97.5 %: the p at which 1,750 or fewer of 5,000 have the probability 0.0125,
        // from the sum of the binomial distribution in Python.
        let expected = 0.365_326_124_338;
        assert!((found.bounds[1] - expected).abs() < 1e-9 && found.bounds[0] == 0.0, "{:?}", found.bounds);
        assert_eq!(found.source, None);
        // Whatever part an estimate is from: it counts them as passed, the bounds do not.
        for (failures, importance) in [(5, None), (500, None), (0, Some(regions(1e-3, 0)))] {
            let found = Answer::new(&undecided(failures), None, importance.as_ref());
            assert!(found.bounds[1] > 0.35, "{:?}", found.bounds);
            assert!(found.estimate.high < Some(0.2), "{:?}", found.estimate);
        }
        // Nothing is known without a verdict.
        let none = MonteCarlo { ends: ends(5000), ..monte_carlo(0) };
        assert_eq!(Answer::new(&none, None, None).bounds, [0.0, 1.0]);
    }

    #[test]
    fn a_few_large_weights_are_no_estimate() {
        let poor = Importance { effective_failures: 3.0, ..regions(1e-6, 0) };
        let answer = Answer::new(&monte_carlo(0), None, Some(&poor));
        assert_eq!((answer.source, answer.bounds[0]), (None, 1e-6 / 1.12));
        let leaking = Importance { outside: 1e-6, ..regions(1e-6, 0) };
        assert_eq!(Answer::new(&monte_carlo(0), None, Some(&leaking)).source, None);
    }
}
