//! How many simulations a question takes, fixed beforehand or with a rule that stops by itself.

use std::cmp::Ordering;

use mishandle_random::{Seed, Sequence};

use super::{DifferenceSequence, RateSequence, StopRule};
use crate::beta::Beta;
use crate::{Estimate, PairedCounts, sign_test, wilson};

/// Probability with which a fixed number is enough.
const POWER: f64 = 0.9;

/// Largest number of replications that find the power for a fixed number of pairs, if it is not
/// computed.
const POWER_REPLICATIONS: u64 = 2000;

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
    /// Smallest number that is fixed beforehand and is enough with a probability of 90 %; `None`
    /// above the maximum.
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
/// For a fixed number, the interval is Wilson's, and the probability that it is on the right side
/// of the rate, or narrow enough, is that of the binomial distribution.
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
        StopRule::Width(width) => width_power(rate, width, n) >= POWER,
        // A rate alone has no difference.
        StopRule::Difference(_) => false,
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
/// For a fixed number, the test is McNemar's exact test and the interval Newcombe's. The power of
/// the test is computed; how often the interval is narrow enough, or within the margin, is counted
/// in replications with the seed.
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
    let [_, first_only, second_only, _] = cells;
    let fixed = match rule {
        StopRule::Difference(None) => {
            smallest(settings.max, |n| mcnemar_power(first_only, second_only, n) >= POWER)
        }
        _ => smallest_replicated(cells, rule, settings),
    };
    let replicate = |sequence: &mut Sequence| {
        let mut found = DifferenceSequence::default();
        stop(rule, settings, |count| {
            for _ in 0..count {
                let [first, second] = pair(cells, sequence);
                found.add(first, second);
            }
            found.look();
            found.estimate()
        })
    };
    summary(fixed, settings, replicate)
}

/// Returns the smallest n up to `max` from which on `is_enough` holds, by bisection: powers rise
/// with n but for small steps.
fn smallest(max: u64, is_enough: impl Fn(u64) -> bool) -> Option<u64> {
    let mut less = 0;
    let mut enough = max;
    if !is_enough(max) {
        return None;
    }
    while enough - less > 1 {
        let n = less + (enough - less) / 2;
        if is_enough(n) { enough = n } else { less = n }
    }
    Some(enough)
}

/// Draws a pair: whether the first and the second succeed.
fn pair([both, first_only, second_only, _]: [f64; 4], sequence: &mut Sequence) -> [bool; 2] {
    let u = sequence.uniform();
    let is_first = u < both + first_only;
    [is_first, u < both || !is_first && u < both + first_only + second_only]
}

/// Returns the smallest number of pairs that is enough in 90 % of replications.
fn smallest_replicated(cells: [f64; 4], rule: StopRule, settings: SizeSettings) -> Option<u64> {
    let replications = settings.replications.clamp(1, POWER_REPLICATIONS);
    let is_enough = |n: u64| {
        let enough = (0..replications).filter(|stream| {
            let mut sequence = Sequence::new(settings.seed.child(1).0, *stream);
            let mut counts = PairedCounts::default();
            for _ in 0..n {
                let [first, second] = pair(cells, &mut sequence);
                counts.add(first, second);
            }
            is_right(&counts, cells, rule)
        });
        enough.count() as f64 >= POWER * replications as f64
    };
    // What the expected counts need is close, so that few large numbers are replicated.
    let mut most =
        smallest(settings.max, |n| rule.decide(&expected_counts(cells, n).difference()).is_some())?;
    while !is_enough(most) {
        if most == settings.max {
            return None;
        }
        most = most.saturating_mul(2).min(settings.max);
    }
    smallest(most, is_enough)
}

/// Returns whether the usual interval of the pairs is narrow enough, or within the margin, or the
/// usual test finds the difference that there is.
fn is_right(counts: &PairedCounts, [_, first_only, second_only, _]: [f64; 4], rule: StopRule) -> bool {
    let found = counts.difference();
    let StopRule::Difference(Some(margin)) = rule else { return rule.decide(&found).is_some() };
    let is_within = found.low.zip(found.high).is_some_and(|(low, high)| -margin < low && high < margin);
    let is_direction_right = match second_only.total_cmp(&first_only) {
        Ordering::Less => counts.second_only < counts.first_only,
        Ordering::Greater => counts.second_only > counts.first_only,
        Ordering::Equal => false,
    };
    is_within || is_direction_right && sign_test(counts.first_only, counts.second_only) <= 2.0 * TAIL
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
    let first_only = count(first_only);
    let second_only = count(second_only);
    let both = count(both).min(n.saturating_sub(first_only + second_only));
    PairedCounts { both, first_only, second_only, neither: n.saturating_sub(both + first_only + second_only) }
}

/// Returns the probability of at least `k` successes in `n`.
fn at_least(k: u64, n: u64, p: f64) -> f64 {
    match k {
        0 => 1.0,
        k if k > n => 0.0,
        k => Beta::new(2 * k as u32, 2 * (n - k + 1) as u32).below(p),
    }
}

/// Returns the smallest k in 0..=n + 1 for which `holds`, which stays true from there on.
fn first_count(n: u64, holds: impl Fn(u64) -> bool) -> u64 {
    let mut low = 0;
    let mut high = n + 1;
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

/// Returns the probability with which Wilson's interval is at most `width` wide. It is the wider
/// the closer the number of successes is to n / 2.
fn width_power(rate: f64, width: f64, n: u64) -> f64 {
    let is_narrow = |k: u64| StopRule::Width(width).decide(&wilson(k, n)).is_some();
    let many = first_count(n, |k| 2 * k >= n && is_narrow(k));
    if 2 * many <= n + 1 {
        return 1.0;
    }
    // As many failures are as narrow.
    at_least(many, n, rate) + at_least(many, n, 1.0 - rate)
}

/// Returns the probability with which the exact McNemar test finds the difference at 5 %.
fn mcnemar_power(first_only: f64, second_only: f64, n: u64) -> f64 {
    let discordant = first_only + second_only;
    if discordant == 0.0 {
        return 0.0;
    }
    let share = first_only.max(second_only) / discordant;
    let mean = discordant * n as f64;
    let deviation = (discordant * (1.0 - discordant) * n as f64).sqrt();
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

    #[test]
    fn the_power_of_mcnemars_test_is_that_of_simulated_pairs() {
        let first_only = 0.02;
        let second_only = 0.06;
        let n = 300;
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
    fn a_fixed_number_is_enough_in_90_percent_of_new_samples() {
        // Counted with other seeds than those of the answer.
        let sample = |stream: u64, n: u64, cells: [f64; 4]| {
            let mut sequence = Sequence::new(11, stream);
            let mut counts = PairedCounts::default();
            for _ in 0..n {
                let [first, second] = pair(cells, &mut sequence);
                counts.add(first, second);
            }
            counts
        };
        let share = |is: &dyn Fn(u64) -> bool| (0..2000).filter(|stream| is(*stream)).count() as f64 / 2000.0;
        let settings = SizeSettings { max: 4000, batch: 64, replications: 2000, seed: Seed(0) };
        let few = SizeSettings { replications: 1, ..settings };

        let n = rate_size(0.97, StopRule::Width(0.04), few).fixed.expect("4000 are enough");
        let found = share(&|stream| {
            let rate = sample(stream, n, [0.97, 0.0, 0.0, 0.03]).both;
            let found = wilson(rate, n);
            found.high.zip(found.low).is_some_and(|(high, low)| high - low <= 0.04)
        });
        assert!((0.88..0.94).contains(&found), "{n} simulations: {found}");

        let cells = [0.94, 0.01, 0.01, 0.04];
        let n = smallest_replicated(cells, StopRule::Difference(Some(0.02)), settings);
        let n = n.expect("4000 are enough");
        let found = share(&|stream| {
            let found = sample(stream, n, cells).difference();
            found.low.zip(found.high).is_some_and(|(low, high)| -0.02 < low && high < 0.02)
        });
        assert!((0.87..0.94).contains(&found), "{n} pairs: {found}");
    }

    #[test]
    fn replications_without_a_decision_count_the_maximum() {
        let settings = SizeSettings { max: 100, batch: 64, replications: 20, seed: Seed(1) };
        let found = pair_size([0.9, 0.05, 0.05, 0.0], StopRule::Width(0.001), settings);
        assert_eq!((found.fixed, found.median, found.mean, found.decided), (None, None, 100.0, 0.0));
    }
}
