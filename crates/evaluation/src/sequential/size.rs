//! How many simulations a question takes, fixed beforehand or with a rule that stops by itself.

use mishandle_random::{Seed, Sequence};

use super::{DifferenceSequence, RateSequence, StopRule};
use crate::f_distribution::{incomplete_beta, ln_beta};
use crate::{Estimate, PairedCounts, wilson};

/// Power of the tests for a fixed number.
const POWER: f64 = 0.9;

/// Probability of each tail of a two-sided 5 % test.
const TAIL: f64 = 0.025;

/// Number of standard deviations of the numbers of discordant pairs over which the power is summed.
const DEVIATIONS: f64 = 9.0;

/// How the rule is simulated.
#[derive(Clone, Copy, Debug)]
pub struct SizeSettings {
    /// Largest number of simulations, or of pairs.
    pub max: u64,
    /// Number of simulations, or of pairs, between two looks.
    pub batch: u64,
    /// Number of replications of the rule.
    pub replications: u64,
    /// Random seed of the replications.
    pub seed: Seed,
}

impl SizeSettings {
    /// Largest maximum: larger ones would take minutes.
    pub const LARGEST: u64 = 100_000;
}

/// Numbers of simulations, or of pairs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sizes {
    /// Smallest number that is fixed beforehand; `None` above the maximum.
    pub fixed: Option<u64>,
    /// Median number of the rule; `None` if it does not decide in half of the replications.
    pub median: Option<u64>,
    /// Number within which the rule decides in 90 % of the replications; `None` if it does not.
    pub ninety_percent: Option<u64>,
    /// Mean number of the rule; a replication without a decision counts the maximum.
    pub mean: f64,
    /// Share of the replications in which the rule decides.
    pub decided: f64,
}

/// Returns how many simulations it takes to know a rate that is probably `rate`.
///
/// For a fixed number, the interval is Wilson's.
///
/// # Example
/// ```
/// use mishandle_evaluation::{SizeSettings, StopRule, rate_size};
/// use mishandle_random::Seed;
/// let settings = SizeSettings { max: 2000, batch: 64, replications: 50, seed: Seed(0) };
/// let found = rate_size(0.5, StopRule::Width(0.1), settings);
/// // Wilson's interval of 381 simulations is 0.1 wide.
/// assert!((380..=382).contains(&found.fixed.unwrap()) && found.median > found.fixed);
/// ```
pub fn rate_size(rate: f64, rule: StopRule, settings: SizeSettings) -> Sizes {
    let is_enough = |n: u64| match rule {
        StopRule::Rate(limit) => rate_power(rate, limit, n) >= POWER,
        _ => rule.decide(&wilson((rate * n as f64).round() as u64, n)).is_some(),
    };
    let replicate = |sequence: &mut Sequence| {
        let mut found = RateSequence::default();
        stop(rule, settings, |count| {
            (0..count).for_each(|_| found.add(sequence.uniform() < rate));
            found.look();
            found.estimate()
        })
    };
    summary(smallest(settings.max, is_enough), settings, replicate)
}

/// Returns how many pairs it takes to know the difference of two rates. `cells` are the
/// probabilities that both, only the first, only the second, and neither succeeds.
///
/// For a fixed number, the test is McNemar's exact test and the interval Newcombe's.
///
/// # Example
/// ```
/// use mishandle_evaluation::{SizeSettings, StopRule, pair_size};
/// use mishandle_random::Seed;
/// let settings = SizeSettings { max: 4000, batch: 64, replications: 50, seed: Seed(0) };
/// let found = pair_size([0.85, 0.03, 0.1, 0.02], StopRule::Difference(None), settings);
/// assert!(found.fixed.unwrap() < 400 && found.decided > 0.9);
/// ```
pub fn pair_size(cells: [f64; 4], rule: StopRule, settings: SizeSettings) -> Sizes {
    let [both, first_only, second_only, _] = cells;
    let is_enough = |n: u64| match rule {
        StopRule::Difference(None) => mcnemar_power(first_only, second_only, n) >= POWER,
        StopRule::Difference(Some(_)) if mcnemar_power(first_only, second_only, n) >= POWER => true,
        _ => rule.decide(&expected_counts(cells, n).difference()).is_some(),
    };
    let replicate = |sequence: &mut Sequence| {
        let mut found = DifferenceSequence::default();
        stop(rule, settings, |count| {
            for _ in 0..count {
                let u = sequence.uniform();
                let is_first = u < both + first_only;
                found.add(is_first, u < both || !is_first && u < both + first_only + second_only);
            }
            found.look();
            found.estimate()
        })
    };
    summary(smallest(settings.max, is_enough), settings, replicate)
}

/// Returns the smallest n up to `max` from which on `is_enough` holds, by bisection: powers rise
/// with n but for small steps.
fn smallest(max: u64, is_enough: impl Fn(u64) -> bool) -> Option<u64> {
    let (mut less, mut enough) = (0, max);
    if !is_enough(max) {
        return None;
    }
    while enough - less > 1 {
        let n = less + (enough - less) / 2;
        if is_enough(n) { enough = n } else { less = n }
    }
    Some(enough)
}

/// Returns after how many values the rule decides; `None` if it does not.
fn stop(rule: StopRule, settings: SizeSettings, mut after: impl FnMut(u64) -> Estimate) -> Option<u64> {
    let mut n = 0;
    while n < settings.max {
        let count = settings.batch.max(1).min(settings.max - n);
        n += count;
        if rule.decide(&after(count)).is_some() {
            return Some(n);
        }
    }
    None
}

fn summary(
    fixed: Option<u64>,
    settings: SizeSettings,
    replicate: impl Fn(&mut Sequence) -> Option<u64>,
) -> Sizes {
    let SizeSettings { max, replications, seed, .. } = settings;
    let mut found: Vec<Option<u64>> =
        (0..replications).map(|stream| replicate(&mut Sequence::new(seed.0, stream))).collect();
    // Replications without a decision are the last ones.
    found.sort_by_key(|n| n.unwrap_or(u64::MAX));
    let at = |share: f64| {
        let index = (share * replications as f64).ceil() as usize;
        found.get(index.saturating_sub(1)).copied().flatten()
    };
    let total: f64 = found.iter().map(|n| n.unwrap_or(max) as f64).sum();
    let decided = found.iter().flatten().count() as f64;
    Sizes {
        fixed,
        median: at(0.5),
        ninety_percent: at(0.9),
        mean: total / replications.max(1) as f64,
        decided: decided / replications.max(1) as f64,
    }
}

/// Returns the expected numbers of pairs, rounded.
fn expected_counts([both, first_only, second_only, _]: [f64; 4], n: u64) -> PairedCounts {
    let count = |share: f64| (share * n as f64).round() as u64;
    let (first_only, second_only) = (count(first_only), count(second_only));
    let both = count(both).min(n.saturating_sub(first_only + second_only));
    PairedCounts { both, first_only, second_only, neither: n.saturating_sub(both + first_only + second_only) }
}

/// Returns the probability of at least `k` successes in `n`.
fn at_least(k: u64, n: u64, p: f64) -> f64 {
    match k {
        0 => 1.0,
        k if k > n => 0.0,
        k => {
            let halves = (2 * k as u32, 2 * (n - k + 1) as u32);
            incomplete_beta(p, halves, ln_beta(halves))
        }
    }
}

/// Returns the smallest k in 0..=n + 1 for which `holds`, which stays true from there on.
fn first_count(n: u64, holds: impl Fn(u64) -> bool) -> u64 {
    let (mut low, mut high) = (0, n + 1);
    while low < high {
        let k = low + (high - low) / 2;
        if holds(k) { high = k } else { low = k + 1 }
    }
    low
}

/// Returns the probability with which Wilson's interval lies on the side of `limit` on which `rate`
/// is.
fn rate_power(rate: f64, limit: f64, n: u64) -> f64 {
    if rate < limit {
        // The same for failures.
        return rate_power(1.0 - rate, 1.0 - limit, n);
    }
    let above = first_count(n, |k| wilson(k, n).low.is_some_and(|low| low > limit));
    at_least(above, n, rate)
}

/// Returns the probability with which the exact McNemar test finds the difference at 5 %.
fn mcnemar_power(first_only: f64, second_only: f64, n: u64) -> f64 {
    let discordant = first_only + second_only;
    if discordant == 0.0 {
        return 0.0;
    }
    let share = first_only.max(second_only) / discordant;
    let (mean, deviation) = (discordant * n as f64, (discordant * (1.0 - discordant) * n as f64).sqrt());
    let low = (mean - DEVIATIONS * deviation).floor().max(0.0) as u64;
    let high = ((mean + DEVIATIONS * deviation).ceil() as u64).min(n);
    let power = |count: u64| {
        let critical = first_count(count, |k| at_least(k, count, 0.5) <= TAIL);
        at_least(critical, count, share)
    };
    let chance = |count: u64| at_least(count, n, discordant) - at_least(count + 1, n, discordant);
    (low..=high).map(|count| chance(count).max(0.0) * power(count)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sign_test;

    #[test]
    fn the_power_of_mcnemars_test_is_that_of_simulated_pairs() {
        let (first_only, second_only, n) = (0.02, 0.06, 300);
        let mut found = 0;
        for stream in 0..4000 {
            let mut sequence = Sequence::new(3, stream);
            let mut counts = [0; 2];
            for _ in 0..n {
                let u = sequence.uniform();
                if u < first_only {
                    counts[0] += 1;
                } else if u < first_only + second_only {
                    counts[1] += 1;
                }
            }
            found += u32::from(counts[1] > counts[0] && sign_test(counts[0], counts[1]) <= 0.05);
        }
        let simulated = f64::from(found) / 4000.0;
        // Five standard errors of 4000 replications.
        let computed = mcnemar_power(first_only, second_only, n);
        assert!((simulated - computed).abs() < 0.04, "{simulated}, computed {computed}");
    }

    #[test]
    fn the_power_of_a_rate_is_that_of_the_binomial_distribution() {
        // 0.9 against 0.5 with 10 simulations: Wilson's interval of 8 of 10 starts at 0.49 and that
        // of 9 of 10 at 0.596, so 9 or 10 successes decide.
        let expected = 10.0 * 0.9_f64.powi(9) * 0.1 + 0.9_f64.powi(10);
        assert!((rate_power(0.9, 0.5, 10) - expected).abs() < 1e-12);
        assert!((rate_power(0.1, 0.5, 10) - expected).abs() < 1e-12);
    }

    #[test]
    fn replications_without_a_decision_count_the_maximum() {
        let settings = SizeSettings { max: 100, batch: 64, replications: 20, seed: Seed(1) };
        let found = pair_size([0.9, 0.05, 0.05, 0.0], StopRule::Width(0.001), settings);
        assert_eq!((found.fixed, found.median, found.mean, found.decided), (None, None, 100.0, 0.0));
    }
}
