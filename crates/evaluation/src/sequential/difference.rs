use std::sync::LazyLock;

use super::{Remaining, times_ln};
use crate::{Estimate, PairedCounts};

/// Number of bets in the mixture.
const BETS: u32 = 64;

/// Distance of candidates from -1 and 1, where some bets are infinite.
const EDGE: f64 = 1e-12;

/// Fractions of the largest bets, from -1 to 1: the nodes of the arcsine distribution with equal
/// weights (Gauss-Chebyshev).
static FRACTIONS: LazyLock<Vec<f64>> = LazyLock::new(|| {
    let node = |k: u32| (std::f64::consts::PI * (f64::from(k) + 0.5) / f64::from(BETS)).cos();
    (0..BETS).map(node).collect()
});

/// The confidence sequence of a difference of two rates from pairs: an interval of 95 % that holds
/// at all looks together, and a test of "no difference".
///
/// A pair has the value d = 1 if only the second has the property, -1 if only the first has it, and
/// otherwise 0. The capital against the difference m is a mixture of fixed bets:
///
/// ```text
/// K(m) = mean over c of Π (1 + λ(c, m) (dᵢ - m)),   c from the arcsine distribution on [-1, 1]
/// λ(c, m) = c / (1 + m) if c > 0,   c / (1 - m) if c < 0
/// ```
///
/// Every factor is at least 0 and has the expectation 1 if m is the true difference, whatever the
/// rates are and however the pairs are correlated. K is convex in m and at most 1 at the observed
/// difference, so the interval has no gaps.
///
/// At m = 0 only the discordant pairs count, and K is the mixture of Beta(1/2, 1/2) against 1/2:
/// the sequential form of McNemar's test. The interval excludes 0 exactly if the p-value is at most
/// 0.05.
///
/// # Example
/// ```
/// use mishandle_evaluation::DifferenceSequence;
/// let mut difference = DifferenceSequence::default();
/// for i in 0..400 {
///     // The second succeeds in 40 of 400 pairs in which the first fails, the reverse in 8.
///     difference.add(i % 10 != 0, i % 50 != 1);
/// }
/// difference.look();
/// let found = difference.estimate();
/// assert!((found.value.unwrap() - 0.08).abs() < 1e-12);
/// assert!(found.low.unwrap() > 0.0 && difference.p_value() < 0.001);
/// ```
///
/// # Reference
/// Waudby-Smith and Ramdas, "Estimating means of bounded random variables by betting", Journal of
/// the Royal Statistical Society B 86, 2024, section 4; Orabona and Jun, "Tight concentrations and
/// confidence sequences from the regret of universal portfolio", IEEE Transactions on Information
/// Theory 70, 2024: mixtures of bets.
#[derive(Clone, Debug, PartialEq)]
pub struct DifferenceSequence {
    counts: PairedCounts,
    remaining: Remaining,
    log_largest: f64,
}

impl Default for DifferenceSequence {
    fn default() -> Self {
        DifferenceSequence {
            counts: PairedCounts::default(),
            remaining: Remaining { low: EDGE - 1.0, high: 1.0 - EDGE },
            log_largest: 0.0,
        }
    }
}

impl DifferenceSequence {
    /// Makes the sequence of pairs at which nobody has looked.
    pub fn of(counts: PairedCounts) -> DifferenceSequence {
        DifferenceSequence { counts, ..DifferenceSequence::default() }
    }

    /// Adds a pair.
    pub fn add(&mut self, first: bool, second: bool) {
        self.counts.add(first, second);
    }

    /// Returns the number of pairs by who has the property.
    pub fn counts(&self) -> PairedCounts {
        self.counts
    }

    /// Returns the logarithm of the capital against the difference `m`, which is between -1 and 1.
    pub fn log_capital(&self, m: f64) -> f64 {
        let PairedCounts { first_only, second_only, both, neither } = self.counts;
        let logs: Vec<f64> = FRACTIONS
            .iter()
            .map(|c| {
                let bet = if *c > 0.0 { c / (1.0 + m) } else { c / (1.0 - m) };
                times_ln(second_only, 1.0 + bet * (1.0 - m))
                    + times_ln(both + neither, 1.0 - bet * m)
                    + times_ln(first_only, 1.0 - bet * (1.0 + m))
            })
            .collect();
        let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let sum: f64 = logs.iter().map(|log| (log - largest).exp()).sum();
        largest + (sum / f64::from(BETS)).ln()
    }

    /// Excludes the differences against which the capital exceeds 1 / α now.
    pub fn look(&mut self) {
        if self.counts.n() > 0 {
            let mut remaining = self.remaining;
            remaining.narrow(self.mean(), |m| self.log_capital(m));
            self.remaining = remaining;
            self.log_largest = self.log_largest.max(self.log_capital(0.0));
        }
    }

    /// Returns the difference, second minus first, with its interval after the looks so far.
    pub fn estimate(&self) -> Estimate {
        if self.counts.n() == 0 {
            return Estimate::default();
        }
        self.remaining.estimate(self.mean(), self.counts.n())
    }

    /// Returns the p-value of "no difference": 1 / (largest capital at a look), at most 1. It holds
    /// at any time.
    pub fn p_value(&self) -> f64 {
        (-self.log_largest).exp().min(1.0)
    }

    fn mean(&self) -> f64 {
        let PairedCounts { first_only, second_only, .. } = self.counts;
        (second_only as f64 - first_only as f64) / self.counts.n() as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sequence(first_only: u64, second_only: u64, concordant: u64) -> DifferenceSequence {
        let counts = PairedCounts { both: concordant, first_only, second_only, neither: 0 };
        DifferenceSequence::of(counts)
    }

    /// Integrates the likelihood ratio of discordant pairs against 1/2 over Beta(1/2, 1/2).
    fn integrated(first_only: u64, second_only: u64) -> f64 {
        let cells = 20_000;
        let ratio = |cell: u32| {
            let t = std::f64::consts::FRAC_PI_2 * (f64::from(cell) + 0.5) / f64::from(cells);
            let q = t.sin().powi(2);
            (times_ln(second_only, 2.0 * q) + times_ln(first_only, 2.0 - 2.0 * q)).exp()
        };
        (0..cells).map(ratio).sum::<f64>() / f64::from(cells)
    }

    #[test]
    fn against_no_difference_the_capital_is_a_beta_mixture_over_discordant_pairs() {
        for (first, second) in [(0, 0), (0, 7), (5, 5), (10, 30), (60, 40)] {
            let expected = integrated(first, second);
            for concordant in [0, 1000] {
                let found = sequence(first, second, concordant).log_capital(0.0).exp();
                assert!((found / expected - 1.0).abs() < 1e-6, "{first} and {second}: {found}, {expected}");
            }
        }
    }

    #[test]
    fn the_expected_capital_is_1_for_every_distribution_with_the_mean() {
        // The mean of the capital after n pairs, over all numbers of pairs of each kind.
        let ways = |n: u64, a: u64, b: u64| {
            let ln_factorial = |k: u64| (1..=k).map(|i| (i as f64).ln()).sum::<f64>();
            (ln_factorial(n) - ln_factorial(a) - ln_factorial(b) - ln_factorial(n - a - b)).exp()
        };
        for [minus, plus] in [[0.1, 0.1], [0.02, 0.05], [0.4, 0.3], [0.0, 0.2]] {
            let zero = 1.0 - minus - plus;
            for n in [1, 5, 20] {
                let mut mean = 0.0;
                for a in 0..=n {
                    for b in 0..=n - a {
                        let chance = times_ln(a, minus) + times_ln(b, plus) + times_ln(n - a - b, zero);
                        let capital = sequence(a, b, n - a - b).log_capital(plus - minus);
                        mean += ways(n, a, b) * (chance + capital).exp();
                    }
                }
                assert!((mean - 1.0).abs() < 1e-9, "{minus} and {plus}, n = {n}: {mean}");
            }
        }
    }

    #[test]
    fn the_capital_is_convex_and_at_most_1_at_the_observed_difference() {
        for (first, second, concordant) in [(3, 9, 88), (0, 1, 0), (50, 40, 10), (0, 0, 30), (7, 0, 0)] {
            let found = sequence(first, second, concordant);
            let mean = found.mean().clamp(EDGE - 1.0, 1.0 - EDGE);
            assert!(found.log_capital(mean) <= 1e-9, "{first}, {second}, {concordant}");
            let values: Vec<f64> =
                (-90..=90).map(|m| found.log_capital(f64::from(m) / 100.0).min(600.0).exp()).collect();
            for three in values.windows(3) {
                let middle = 0.5 * (three[0] + three[2]);
                assert!(three[1] <= middle * (1.0 + 1e-9), "{first}, {second}, {concordant}");
            }
        }
    }

    #[test]
    fn the_interval_excludes_0_exactly_if_the_p_value_is_at_most_5_percent() {
        for first in 0..25 {
            for second in 0..25 {
                let mut found = sequence(first, second, 60);
                found.look();
                let Estimate { low, high, .. } = found.estimate();
                let excludes = low.expect("a bound") > 0.0 || high.expect("a bound") < 0.0;
                assert_eq!(excludes, found.p_value() <= 0.05, "{first} and {second}");
            }
        }
    }

    #[test]
    fn swapping_the_two_mirrors_the_interval() {
        for (first, second, concordant) in [(3, 9, 88), (0, 12, 40), (1, 0, 200)] {
            let [mut there, mut back] =
                [sequence(first, second, concordant), sequence(second, first, concordant)];
            there.look();
            back.look();
            let there = there.estimate();
            let back = back.estimate();
            let sum = |a: Option<f64>, b: Option<f64>| (a.expect("a bound") + b.expect("a bound")).abs();
            assert!(sum(there.low, back.high) < 1e-7 && sum(there.high, back.low) < 1e-7);
        }
    }
}
