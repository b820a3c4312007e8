//! Differences of pairs: two controllers on the same scenarios and seeds.

use std::cmp::Ordering;

use mishandle_random::Seed;

use mishandle_results::PairedRates;

use crate::interval::bootstrap_bounds;
use crate::{DifferenceSequence, Estimate, anytime_rate, mean, rate, sign_test, wilson};

/// Numbers of pairs by who has a property, such as success.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PairedCounts {
    /// Both have it.
    pub both: u64,
    /// Only the first has it.
    pub first_only: u64,
    /// Only the second has it.
    pub second_only: u64,
    /// Neither has it.
    pub neither: u64,
}

impl PairedCounts {
    /// Counts a pair.
    pub fn add(&mut self, first: bool, second: bool) {
        let count = match (first, second) {
            (true, true) => &mut self.both,
            (true, false) => &mut self.first_only,
            (false, true) => &mut self.second_only,
            (false, false) => &mut self.neither,
        };
        *count += 1;
    }

    /// Returns the number of pairs.
    pub fn n(&self) -> u64 {
        self.both + self.first_only + self.second_only + self.neither
    }

    /// Returns the two rates with their Wilson intervals.
    pub fn rates(&self) -> [Estimate; 2] {
        [self.first_only, self.second_only].map(|only| wilson(self.both + only, self.n()))
    }

    /// Returns the difference of the rates, second minus first, with Newcombe's interval for pairs
    /// (method 10): the Wilson intervals of both rates, combined by the correlation of the pairs.
    ///
    /// # Example
    /// ```
    /// use mishandle_evaluation::PairedCounts;
    /// let counts = PairedCounts { both: 97, first_only: 0, second_only: 3, neither: 0 };
    /// let difference = counts.difference();
    /// assert!((difference.value.unwrap() - 0.03).abs() < 1e-12);
    /// assert!(difference.low.unwrap() < 0.0 && difference.high.unwrap() < 0.1);
    /// ```
    ///
    /// # Reference
    /// Newcombe, "Improved confidence intervals for the difference between binomial proportions
    /// based on paired data", Statistics in Medicine 17, 1998.
    pub fn difference(&self) -> Estimate {
        let [first, second] = self.rates();
        let bounds = |rate: Estimate| Some((rate.value?, rate.low?, rate.high?));
        let Some(((p, low_p, high_p), (q, low_q, high_q))) = bounds(first).zip(bounds(second)) else {
            return Estimate::default();
        };
        let phi = self.correlation();
        let half = |a: f64, b: f64| (a * a - 2.0 * phi * a * b + b * b).max(0.0).sqrt();
        Estimate {
            value: Some(q - p),
            low: Some(q - p - half(q - low_q, high_p - p)),
            high: Some(q - p + half(p - low_p, high_q - q)),
            n: self.n(),
        }
    }

    /// Returns the correlation of the pairs with Newcombe's continuity correction, or 0 if a rate
    /// is 0 or 1.
    fn correlation(&self) -> f64 {
        let [e, f, g, h] =
            [self.both, self.first_only, self.second_only, self.neither].map(|count| count as f64);
        let margins = (e + f) * (g + h) * (e + g) * (f + h);
        if margins == 0.0 {
            return 0.0;
        }
        let cross = e * h - f * g;
        let corrected = if cross > 0.0 { (cross - self.n() as f64 / 2.0).max(0.0) } else { cross };
        corrected / margins.sqrt()
    }
}

/// Returns the rates of pairs, of which `verdicts` have a verdict in the first and in the second.
/// Without any verdict a rate was not measured, so it has no value, and the difference has none.
pub fn paired_rates(counts: PairedCounts, verdicts: [u64; 2]) -> PairedRates {
    let PairedCounts { both, first_only, second_only, .. } = counts;
    let n = counts.n();
    let first = rate(both + first_only, verdicts[0], n);
    let second = rate(both + second_only, verdicts[1], n);
    let difference = match first.value.and(second.value) {
        Some(_) => counts.difference(),
        None => Estimate { n, ..Estimate::default() },
    };
    PairedRates {
        first,
        second,
        difference,
        first_only,
        second_only,
        p_value: sign_test(first_only, second_only),
    }
}

/// Returns the rates of pairs like [`paired_rates`], with intervals and a p-value that hold at any
/// time, because results decided how many pairs there are.
pub fn paired_rates_at_any_time(counts: PairedCounts, verdicts: [u64; 2]) -> PairedRates {
    let PairedRates { first, second, difference, first_only, second_only, .. } =
        paired_rates(counts, verdicts);
    let mut sequence = DifferenceSequence::of(counts);
    sequence.look();
    let n = counts.n();
    let rate = |rate: Estimate, successes: u64| match rate.value {
        Some(_) => anytime_rate(successes, n),
        None => rate,
    };
    PairedRates {
        first: rate(first, counts.both + first_only),
        second: rate(second, counts.both + second_only),
        difference: if difference.value.is_some() { sequence.estimate() } else { difference },
        first_only,
        second_only,
        p_value: sequence.p_value(),
    }
}

/// Returns the mean difference of pairs, second minus first, with its percentile bootstrap interval
/// over the pairs.
///
/// Resampling pairs keeps what both have in common, such as a difficult scenario, so the interval
/// is narrower than that of two independent samples. See
/// [`bootstrap_mean`](crate::bootstrap_mean) for its coverage and its degenerate cases.
///
/// # Example
/// ```
/// use mishandle_evaluation::paired_mean_difference;
/// use mishandle_rollout::Seed;
/// let first: Vec<f64> = (0..50).map(f64::from).collect();
/// // 1 or 2 more for each scenario, although the scenarios differ by up to 49.
/// let second: Vec<f64> = first.iter().map(|value| value + 1.0 + value % 2.0).collect();
/// let found = paired_mean_difference(&first, &second, Seed(0));
/// assert_eq!(found.value, Some(1.5));
/// assert!(found.low.unwrap() > 1.3 && found.high.unwrap() < 1.7);
/// ```
pub fn paired_mean_difference(first: &[f64], second: &[f64], seed: Seed) -> Estimate {
    // Half the difference of two finite numbers is finite.
    let is_huge = first.iter().zip(second).any(|(first, second)| !(second - first).is_finite());
    let scale = if is_huge { 0.5 } else { 1.0 };
    let mut sorted: Vec<f64> =
        first.iter().zip(second).map(|(first, second)| scale * second - scale * first).collect();
    let n = sorted.len() as u64;
    let value = (n > 0).then(|| mean(&sorted));
    // Adding 0 makes -0 positive.
    sorted.iter_mut().for_each(|difference| *difference += 0.0);
    sorted.sort_by(f64::total_cmp);
    // The resamples pick sorted values, so those of the negated sample would be others. The
    // bootstrap gets the same sample for both directions: of the sorted differences and their
    // negatives, the one that is larger in lexicographic order.
    let negatives = sorted.iter().rev().map(|difference| 0.0 - difference);
    let order = sorted.iter().zip(negatives).map(|(a, b)| a.total_cmp(&b)).find(|order| order.is_ne());
    if order == Some(Ordering::Less) {
        sorted.reverse();
        sorted.iter_mut().for_each(|difference| *difference = 0.0 - *difference);
    }
    let bounds = bootstrap_bounds(&sorted, seed).map(|[low, high]| match order {
        Some(Ordering::Less) => [-high, -low],
        Some(_) => [low, high],
        // The sample is symmetric, and so is its interval.
        None => {
            let half = 0.5 * high - 0.5 * low;
            [-half, half]
        }
    });
    let unscaled = |value: f64| value / scale;
    let [low, high] = [0, 1].map(|end| bounds.map(|bounds| unscaled(bounds[end])));
    Estimate { value: value.map(unscaled), low, high, n }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_of_huge_numbers_are_never_nan() {
        let huge = |signs: &[f64]| -> Vec<f64> {
            (0..30).map(|i| signs[i % signs.len()] * f64::MAX / (1.0 + i as f64 / 100.0)).collect()
        };
        let samples = [huge(&[1.0]), huge(&[-1.0]), huge(&[1.0, -1.0]), vec![0.0; 30], vec![1.0; 30]];
        for first in &samples {
            for second in &samples {
                let Estimate { value, low, high, .. } = paired_mean_difference(first, second, Seed(1));
                for number in [value, low, high].into_iter().flatten() {
                    assert!(!number.is_nan(), "{value:?} {low:?} {high:?}");
                }
                assert!(mean(first).is_finite());
            }
        }
        // Half of the largest number and its negative: the difference is the largest number.
        let up = vec![f64::MAX / 2.0; 12];
        let down = vec![-f64::MAX / 2.0; 12];
        assert_eq!(paired_mean_difference(&down, &up, Seed(1)).value, Some(f64::MAX));
    }

    /// Newcombe, Statistics in Medicine 17, 1998, p. 2635: 36, 12, 2 and 0 of 50 pairs give 0.0569
    /// to 0.3404 by method 10, as first minus second.
    #[test]
    fn the_interval_matches_newcombes_example() {
        let counts = PairedCounts { both: 36, first_only: 12, second_only: 2, neither: 0 };
        let found = counts.difference();
        assert!((found.value.unwrap() + 0.2).abs() < 1e-12);
        assert!((found.low.unwrap() + 0.3404).abs() < 5e-5, "{found:?}");
        assert!((found.high.unwrap() + 0.0569).abs() < 5e-5, "{found:?}");
    }

    #[test]
    fn the_interval_is_antisymmetric_and_never_empty() {
        for counts in [
            PairedCounts { both: 10, first_only: 0, second_only: 0, neither: 0 },
            PairedCounts { both: 90, first_only: 3, second_only: 5, neither: 2 },
            PairedCounts { both: 0, first_only: 7, second_only: 0, neither: 3 },
        ] {
            let swapped =
                PairedCounts { first_only: counts.second_only, second_only: counts.first_only, ..counts };
            let found = counts.difference();
            let mirror = swapped.difference();
            assert!((found.low.unwrap() + mirror.high.unwrap()).abs() < 1e-12, "{found:?} {mirror:?}");
            assert!(found.low.unwrap() < found.high.unwrap(), "{found:?}");
        }
        assert_eq!(PairedCounts::default().difference(), Estimate::default());
    }

    #[test]
    fn the_interval_of_a_mean_is_the_mirror_image_of_the_opposite_one() {
        let first: Vec<f64> = (0..40).map(|i| f64::from(i * i % 17)).collect();
        let other: Vec<f64> = (0..40).map(|i| f64::from(i * 7 % 23)).collect();
        // A sample whose differences are symmetric: 1 and -1 alternate.
        let alternating: Vec<f64> =
            first.iter().zip(0..).map(|(value, i)| value + if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
        for second in [&other, &alternating] {
            let found = paired_mean_difference(&first, second, Seed(3));
            let mirror = paired_mean_difference(second, &first, Seed(3));
            let Estimate { value, low, high, n } = found;
            let [value, low, high] = [value, high, low].map(|value| value.map(|value: f64| -value));
            assert_eq!(Estimate { value, low, high, n }, mirror);
            assert!(found.low < found.value && found.value < found.high, "{found:?}");
        }
        assert_eq!(paired_mean_difference(&[], &[], Seed(3)), Estimate::default());
    }

    /// Five standard errors of a rate of 0.95 in 2000 samples are 0.024.
    #[test]
    fn the_interval_of_correlated_rates_covers_the_difference() {
        use mishandle_random::Sequence;
        const SAMPLES: u64 = 2000;
        let covers = |sample: &u64| {
            let mut sequence = Sequence::new(Seed(*sample).0, 0);
            let mut counts = PairedCounts::default();
            for _ in 0..100 {
                // Both 0.85, first only 0.08, second only 0.03, neither 0.04: a difference
                // of -0.05.
                match sequence.below(100) {
                    0..85 => counts.add(true, true),
                    85..93 => counts.add(true, false),
                    93..96 => counts.add(false, true),
                    _ => counts.add(false, false),
                }
            }
            let found = counts.difference();
            found.low.unwrap() <= -0.05 && -0.05 <= found.high.unwrap()
        };
        let coverage = (0..SAMPLES).filter(covers).count() as f64 / SAMPLES as f64;
        assert!((coverage - 0.95).abs() < 0.024, "{coverage}");
    }
}
