//! What an average is worth: 95 % intervals for rates and for means.

use mishandle_rollout::Seed;

use crate::resample::{Draws, Resample};

/// The 0.975 quantile of the standard normal distribution.
const Z: f64 = 1.959_963_984_540_054;

/// How many times [`bootstrap_mean`] resamples: the ends of its interval are then sure to about 3 % of its width.
const RESAMPLES: u64 = 2000;

/// An average over `n` simulations, with its 95 % interval.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Estimate {
    /// The average; `None` over nothing.
    pub value: Option<f64>,
    /// Lower end of the interval; `None` where the numbers say nothing about their spread.
    pub low: Option<f64>,
    /// Upper end of the interval; `None` where the numbers say nothing about their spread.
    pub high: Option<f64>,
    /// How many simulations were averaged.
    pub n: u64,
}

/// The rate `successes` / `n` with its Wilson score interval.
///
/// ```text
/// centre     = (p + z²/2n) / (1 + z²/n)
/// half-width = z sqrt(p (1 - p) / n + z²/4n²) / (1 + z²/n),   z = 1.96
/// ```
///
/// It stays within [0, 1] and says something even of 0 or `n` successes. With `n` = 0 all is `None`.
/// `successes` has to be at most `n`.
///
/// # Example
/// ```
/// use mishandle_evaluation::wilson;
/// let rate = wilson(100, 100);
/// assert_eq!((rate.value, rate.high), (Some(1.0), Some(1.0)));
/// assert!((rate.low.unwrap() - 0.963).abs() < 0.0005);
/// assert_eq!(wilson(0, 0).value, None);
/// ```
///
/// # Reference
/// Wilson, "Probable inference, the law of succession, and statistical inference", JASA 22, 1927.
pub fn wilson(successes: u64, n: u64) -> Estimate {
    if n == 0 {
        return Estimate::default();
    }
    let count = n as f64;
    let p = successes as f64 / count;
    let scale = 1.0 + Z * Z / count;
    let centre = (p + Z * Z / (2.0 * count)) / scale;
    let half = Z * (p * (1.0 - p) / count + Z * Z / (4.0 * count * count)).sqrt() / scale;
    // Exactly 0 at no success and exactly 1 at nothing but successes, where rounding would leave a rest.
    let low = if successes == 0 { 0.0 } else { centre - half };
    let high = if successes == n { 1.0 } else { centre + half };
    Estimate { value: Some(p), low: Some(low), high: Some(high), n }
}

/// The mean of `values` with its percentile bootstrap interval.
///
/// 2000 times, as many values are drawn with replacement; the interval goes from the 2.5 % to the 97.5 % quantile of
/// their means, interpolated linearly. The draws depend on `seed` only, so the same values, in any order, give the
/// same interval. Of a single value the interval is `None`: one number says nothing about its spread. The time is
/// 2000 draws for each value, about 6 s for a million.
///
/// # Example
/// ```
/// use mishandle_evaluation::bootstrap_mean;
/// use mishandle_rollout::Seed;
/// let estimate = bootstrap_mean(&[40.0, 50.0, 60.0], Seed(0));
/// assert_eq!(estimate.value, Some(50.0));
/// assert_eq!((estimate.low, estimate.high), (Some(40.0), Some(60.0)));
/// assert_eq!(bootstrap_mean(&[40.0], Seed(0)).low, None);
/// ```
///
/// # Reference
/// Efron and Tibshirani, "An Introduction to the Bootstrap", 1993, chapter 13.
pub fn bootstrap_mean(values: &[f64], seed: Seed) -> Estimate {
    let n = values.len() as u64;
    if n == 0 {
        return Estimate::default();
    }
    let mean = |sum: f64| sum / n as f64;
    let value = Some(mean(values.iter().sum()));
    if n == 1 {
        return Estimate { value, low: None, high: None, n };
    }
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let table = Resample::new(&sorted);
    let mut means: Vec<f64> = (0..RESAMPLES)
        .map(|resample| {
            let mut draws = Draws(seed.child(resample).0);
            mean((0..n).map(|_| table.draw(&mut draws)).sum())
        })
        .collect();
    means.sort_by(f64::total_cmp);
    Estimate { value, low: Some(quantile(&means, 0.025)), high: Some(quantile(&means, 0.975)), n }
}

/// The `p` quantile of sorted numbers: linear between the two order statistics next to p (n - 1).
fn quantile(sorted: &[f64], p: f64) -> f64 {
    let position = p * (sorted.len() - 1) as f64;
    let (below, above) = (position.floor() as usize, position.ceil() as usize);
    sorted[below] + (position - below as f64) * (sorted[above] - sorted[below])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check_wilson(successes: u64, n: u64, low: f64, high: f64, tolerance: f64) {
        let found = wilson(successes, n);
        let close = |found: Option<f64>, expected: f64| (found.unwrap() - expected).abs() <= tolerance;
        assert!(
            close(found.low, low) && close(found.high, high),
            "{successes}/{n}: {found:?}, expected [{low}, {high}]"
        );
    }

    #[test]
    fn wilson_gives_the_published_intervals() {
        check_wilson(85, 100, 0.77, 0.91, 0.005);
        check_wilson(92, 100, 0.85, 0.96, 0.005);
        check_wilson(98, 100, 0.93, 0.994, 0.0005);
        check_wilson(100, 100, 0.963, 1.0, 0.0005);
        check_wilson(950, 1000, 0.935, 0.962, 0.0005);
        check_wilson(1000, 1000, 0.996, 1.0, 0.0005);
        // Newcombe, "Two-sided confidence intervals for the single proportion", Stat. Med. 17, 1998, table I, method 3.
        check_wilson(81, 263, 0.2553, 0.3662, 0.00005);
        check_wilson(15, 148, 0.0624, 0.1605, 0.00005);
        check_wilson(0, 20, 0.0, 0.1611, 0.00005);
        check_wilson(1, 29, 0.0061, 0.1718, 0.00005);
    }

    #[test]
    fn wilson_is_symmetric_and_holds_the_rate() {
        for n in 1..60 {
            for k in 0..=n {
                let (rate, mirror) = (wilson(k, n), wilson(n - k, n));
                let (low, value, high) = (rate.low.unwrap(), rate.value.unwrap(), rate.high.unwrap());
                assert!(0.0 <= low && low <= value && value <= high && high <= 1.0, "{k}/{n}: {rate:?}");
                assert!((low - (1.0 - mirror.high.unwrap())).abs() < 1e-12, "{k}/{n}: {rate:?} {mirror:?}");
            }
        }
    }

    #[test]
    fn nothing_has_no_average() {
        assert_eq!(wilson(0, 0), Estimate { value: None, low: None, high: None, n: 0 });
        assert_eq!(bootstrap_mean(&[], Seed(0)), Estimate { value: None, low: None, high: None, n: 0 });
    }

    #[test]
    fn the_bootstrap_of_a_rate_gives_the_binomial_quantiles() {
        // Means of n draws from zeros and ones are Binomial(n, p) / n; its 2.5 and 97.5 % quantiles for n = 100 are
        // 40 and 60 at p = 0.5, and 5 and 16 (4 at 0.0237) at p = 0.1. One count for the finite number of resamples.
        for (ones, low, high) in [(50, 40.0, 60.0), (10, 5.0, 16.0)] {
            let values: Vec<f64> = (0..100).map(|i| f64::from(u8::from(i < ones))).collect();
            for seed in 0..5 {
                let found = bootstrap_mean(&values, Seed(seed));
                assert!(
                    (100.0 * found.low.unwrap() - low).abs() <= 1.0,
                    "{ones} ones, seed {seed}: {found:?}"
                );
                assert!(
                    (100.0 * found.high.unwrap() - high).abs() <= 1.0,
                    "{ones} ones, seed {seed}: {found:?}"
                );
            }
        }
    }

    #[test]
    fn the_bootstrap_repeats_itself_and_moves_with_its_seed() {
        let values: Vec<f64> = (0..50).map(|i| f64::from(i).sin()).collect();
        assert_eq!(bootstrap_mean(&values, Seed(4)), bootstrap_mean(&values, Seed(4)));
        assert_ne!(bootstrap_mean(&values, Seed(4)), bootstrap_mean(&values, Seed(5)));
    }

    #[test]
    fn equal_values_have_no_spread() {
        let found = bootstrap_mean(&[0.25; 9], Seed(0));
        assert_eq!(found, Estimate { value: Some(0.25), low: Some(0.25), high: Some(0.25), n: 9 });
    }

    #[test]
    fn quantiles_are_linear_between_order_statistics() {
        assert_eq!(quantile(&[0.0, 1.0, 2.0, 3.0, 4.0], 0.5), 2.0);
        assert_eq!(quantile(&[0.0, 10.0], 0.25), 2.5);
    }
}
