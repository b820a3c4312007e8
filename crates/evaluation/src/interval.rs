//! Confidence intervals (95 %) of rates and means.

use mishandle_random::{Seed, Sequence};
use mishandle_results::Estimate;

use crate::beta::beta_quantile;

/// The 0.975 quantile of the standard normal distribution.
pub(crate) const Z: f64 = 1.959_963_984_540_054;

/// Number of bootstrap resamples. The bounds of an interval are then accurate to about 3 % of its
/// width.
const RESAMPLES: u64 = 2000;

/// Smallest sample size with a bootstrap interval; see [`bootstrap_mean`].
const SMALLEST_SAMPLE: usize = 10;

/// Returns the one-sided 95 % upper bound of a failure rate after `n` independent simulations
/// without a failure: 1 - 0.05^(1/n). It is 1 for `n` = 0, and about 3/n for large `n`.
///
/// # Example
/// ```
/// use mishandle_evaluation::bound_without_failures;
/// // 299 simulations without a failure are the fewest that show a rate below 1 %.
/// assert!(bound_without_failures(299) < 0.01 && bound_without_failures(298) > 0.01);
/// assert!((bound_without_failures(1_000_000) - 3.0e-6).abs() < 1e-8);
/// assert_eq!(bound_without_failures(0), 1.0);
/// ```
///
/// # Reference
/// Clopper and Pearson, "The use of confidence or fiducial limits illustrated in the case of the
/// binomial", Biometrika 26, 1934.
pub fn bound_without_failures(n: u64) -> f64 {
    // `exp_m1` is exact where the power is close to 1.
    -(0.05_f64.ln() / n as f64).exp_m1()
}

/// Returns the estimate of the rate of the opposite event.
pub fn complement(rate: Estimate) -> Estimate {
    let opposite = |rate: Option<f64>| rate.map(|rate| 1.0 - rate);
    Estimate { value: opposite(rate.value), low: opposite(rate.high), high: opposite(rate.low), n: rate.n }
}

/// Returns the rate `successes` / `n` with its Wilson score interval.
///
/// ```text
/// center     = (p + z²/2n) / (1 + z²/n)
/// half-width = z sqrt(p (1 - p) / n + z²/4n²) / (1 + z²/n),   z = 1.96
/// ```
///
/// The interval is a part of [0, 1] and has a positive width even for 0 or `n` successes. For `n` =
/// 0 every value is `None`. `successes` must be at most `n`. Its coverage is 95 % on average over p
/// and at least 83 %, close to p = 0.18 / n and 1 - 0.18 / n (exact, in `tests/coverage.rs`).
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
    let center = (p + Z * Z / (2.0 * count)) / scale;
    let half = Z * (p * (1.0 - p) / count + Z * Z / (4.0 * count * count)).sqrt() / scale;
    // The bounds at 0 and `n` successes are exact, without rounding errors.
    let low = if successes == 0 { 0.0 } else { center - half };
    let high = if successes == n { 1.0 } else { center + half };
    Estimate { value: Some(p), low: Some(low), high: Some(high), n }
}

/// Returns the rate `successes` / `n` with its exact interval, which contains the true rate with a
/// probability of at least `confidence` for every rate and every n. For `n` = 0 every value is
/// `None`. `successes` must be at most `n`, and `n` at most 10⁹.
///
/// The bounds are quantiles of beta distributions, which are found by bisection.
///
/// # Example
/// ```
/// use mishandle_evaluation::clopper_pearson;
/// let rate = clopper_pearson(0, 1000, 0.95);
/// // 1 - 0.025^(1/1000)
/// assert!((rate.high.unwrap() - 0.003_682_1).abs() < 1e-7 && rate.low == Some(0.0));
/// ```
///
/// # Reference
/// Clopper and Pearson, "The use of confidence or fiducial limits illustrated in the case of the
/// binomial", Biometrika 26, 1934.
pub fn clopper_pearson(successes: u64, n: u64, confidence: f64) -> Estimate {
    if n == 0 {
        return Estimate::default();
    }
    let tail = 0.5 * (1.0 - confidence);
    let k = successes as u32;
    let others = (n - successes) as u32;
    let low = if k == 0 { 0.0 } else { beta_quantile(tail, 2 * k, 2 * (others + 1)) };
    let high = match (k, others) {
        (_, 0) => 1.0,
        // `exp_m1` is exact where the power is close to 1.
        (0, _) => -(tail.ln() / n as f64).exp_m1(),
        _ => beta_quantile(1.0 - tail, 2 * (k + 1), 2 * others),
    };
    Estimate { value: Some(successes as f64 / n as f64), low: Some(low), high: Some(high), n }
}

/// Returns the mean of `values` with its percentile bootstrap interval.
///
/// Resamples the values with replacement 2000 times. The bounds of the interval are the 2.5 % and
/// 97.5 % quantiles of the means, with linear interpolation. The resamples depend on `seed` only,
/// so the order of the values does not change the interval. The time is 2000 draws per value: about
/// 0.3 s for 10,000 values, and about 3 minutes for a million, which do not fit into the cache.
///
/// The coverage depends on the distribution (simulated, in `tests/coverage.rs`): for n = 100 it is
/// 94 % for uniform and exponential values, for n = 10 it is 90 % and 86 %. The interval knows
/// nothing of values that it did not see: if one of 100 simulations takes much longer than the
/// others, it covers the mean in 63 % of all samples with n = 100. For numbers in [0, 1],
/// [`betting_mean`](crate::betting_mean) has no such gap.
///
/// A degenerate sample has no interval, because the bootstrap would overstate its precision:
///
/// - **Fewer than 10 values.** The nominal 95 % interval is too narrow. For normal values its
///   coverage is 0.50 for n = 2, 0.74 for n = 3, 0.83 for n = 5 and 0.90 for n = 10 (simulated; n =
///   2 is exact, because the interval extends from the smaller to the larger value).
/// - **All values equal.** Every resample has the same mean, so the interval would have width 0 for
///   every n.
///
/// # Example
/// ```
/// use mishandle_evaluation::bootstrap_mean;
/// use mishandle_rollout::Seed;
/// let values: Vec<f64> = (1..=20).map(f64::from).collect();
/// let estimate = bootstrap_mean(&values, Seed(0));
/// assert_eq!(estimate.value, Some(10.5));
/// // The normal approximation is 10.5 ± 1.96 · 5.77 / sqrt(20), which is 8.0 to 13.0.
/// assert!((estimate.low.unwrap() - 8.0).abs() < 0.3 && (estimate.high.unwrap() - 13.0).abs() < 0.3);
/// assert_eq!(bootstrap_mean(&[40.0, 50.0, 60.0], Seed(0)).low, None);
/// ```
///
/// # Reference
/// Efron and Tibshirani, "An Introduction to the Bootstrap", 1993, chapter 13. Small samples:
/// Hesterberg, "What teachers should know about the bootstrap", The American Statistician 69, 2015.
pub fn bootstrap_mean(values: &[f64], seed: Seed) -> Estimate {
    let value = (!values.is_empty()).then(|| mean(values));
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let bounds = bootstrap_bounds(&sorted, seed);
    let [low, high] = [0, 1].map(|end| bounds.map(|bounds| bounds[end]));
    Estimate { value, low, high, n: values.len() as u64 }
}

/// Returns the bounds of [`bootstrap_mean`] of sorted values; `None` for a degenerate sample.
pub(crate) fn bootstrap_bounds(sorted: &[f64], seed: Seed) -> Option<[f64; 2]> {
    if sorted.len() < SMALLEST_SAMPLE || are_equal(sorted) {
        return None;
    }
    let n = sorted.len() as u64;
    let resampled = |resample: u64| {
        let mut sequence = Sequence::new(seed.child(resample).0, 0);
        (0..n).map(move |_| sorted[sequence.below(n) as usize])
    };
    let mut means: Vec<f64> =
        (0..RESAMPLES).map(|resample| mean_of(sorted.len(), || resampled(resample))).collect();
    means.sort_by(f64::total_cmp);
    Some([quantile(&means, 0.025), quantile(&means, 0.975)])
}

/// Returns the mean of numbers, which is finite if they are: also if their sum overflows.
pub fn mean(values: &[f64]) -> f64 {
    mean_of(values.len(), || values.iter().copied())
}

fn mean_of<I: Iterator<Item = f64>>(n: usize, values: impl Fn() -> I) -> f64 {
    let n = n as f64;
    let sum = values().sum::<f64>();
    if !sum.is_finite() && values().all(f64::is_finite) {
        // Rounded parts of the largest number can have an infinite sum, too.
        values().map(|value| value / n).sum::<f64>().clamp(-f64::MAX, f64::MAX)
    } else {
        sum / n
    }
}

fn are_equal(values: &[f64]) -> bool {
    values.windows(2).all(|pair| pair[0] == pair[1])
}

/// Returns the `p` quantile of sorted numbers, with linear interpolation between the order
/// statistics around p (n - 1) (type 7 of Hyndman and Fan, "Sample Quantiles in Statistical
/// Packages", The American Statistician 50, 1996).
pub(crate) fn quantile(sorted: &[f64], p: f64) -> f64 {
    let position = p * (sorted.len() - 1) as f64;
    let below = position.floor() as usize;
    let above = position.ceil() as usize;
    let share = position - below as f64;
    let step = sorted[above] - sorted[below];
    if step.is_finite() {
        sorted[below] + share * step
    } else {
        // The difference of two finite numbers overflows.
        sorted[below] * (1.0 - share) + sorted[above] * share
    }
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
    fn wilson_intervals_match_published_values() {
        check_wilson(85, 100, 0.77, 0.91, 0.005);
        check_wilson(92, 100, 0.85, 0.96, 0.005);
        check_wilson(98, 100, 0.93, 0.994, 0.0005);
        check_wilson(100, 100, 0.963, 1.0, 0.0005);
        check_wilson(950, 1000, 0.935, 0.962, 0.0005);
        check_wilson(1000, 1000, 0.996, 1.0, 0.0005);
        // Newcombe, "Two-sided confidence intervals for the single proportion", Stat. Med. 17,
        // 1998, table I, method 3.
        check_wilson(81, 263, 0.2553, 0.3662, 0.00005);
        check_wilson(15, 148, 0.0624, 0.1605, 0.00005);
        check_wilson(0, 20, 0.0, 0.1611, 0.00005);
        check_wilson(1, 29, 0.0061, 0.1718, 0.00005);
    }

    #[test]
    fn wilson_intervals_are_symmetric_and_contain_the_rate() {
        for n in 1..60 {
            for k in 0..=n {
                let rate = wilson(k, n);
                let mirror = wilson(n - k, n);
                let low = rate.low.unwrap();
                let value = rate.value.unwrap();
                let high = rate.high.unwrap();
                assert!(0.0 <= low && low <= value && value <= high && high <= 1.0, "{k}/{n}: {rate:?}");
                assert!((low - (1.0 - mirror.high.unwrap())).abs() < 1e-12, "{k}/{n}: {rate:?} {mirror:?}");
            }
        }
    }

    #[test]
    fn an_empty_sample_has_no_mean() {
        assert_eq!(wilson(0, 0), Estimate { value: None, low: None, high: None, n: 0 });
        assert_eq!(bootstrap_mean(&[], Seed(0)), Estimate { value: None, low: None, high: None, n: 0 });
    }

    #[test]
    fn the_bootstrap_interval_of_a_rate_matches_the_binomial_quantiles() {
        // Means of n draws from zeros and ones have the distribution Binomial(n, p) / n. Its 2.5 %
        // and 97.5 % quantiles for n = 100 are 40 and 60 at p = 0.5, and 5 and 16 (4 at 0.0237) at
        // p = 0.1. The tolerance of one count allows for the finite number of resamples.
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
    fn the_bootstrap_depends_on_its_seed_only() {
        let values: Vec<f64> = (0..50).map(|i| f64::from(i).sin()).collect();
        assert_eq!(bootstrap_mean(&values, Seed(4)), bootstrap_mean(&values, Seed(4)));
        assert_ne!(bootstrap_mean(&values, Seed(4)), bootstrap_mean(&values, Seed(5)));
    }

    #[test]
    fn a_degenerate_sample_has_a_mean_but_no_bootstrap_interval() {
        for (values, mean) in [(vec![0.25; 9], 0.25), (vec![0.25; 5000], 0.25), (vec![3.0, 5.0], 4.0)] {
            let n = values.len() as u64;
            let expected = Estimate { value: Some(mean), low: None, high: None, n };
            assert_eq!(bootstrap_mean(&values, Seed(0)), expected, "{n} values");
        }
        let rising: Vec<f64> = (0..10).map(f64::from).collect();
        assert_eq!(bootstrap_mean(&rising[..9], Seed(0)).low, None);
        assert!(bootstrap_mean(&rising, Seed(0)).low.is_some());
    }

    /// SciPy 1.17.1, with t = (1 - c) / 2: `beta.ppf(t, k, n - k + 1)` and
    /// `beta.ppf(1 - t, k + 1, n - k)`.
    #[test]
    fn exact_intervals_match_scipy() {
        for (k, n, confidence, low, high) in [
            (0, 1000, 0.95, 0.0, 0.003_682_083_896_865_671),
            (3, 5000, 0.95, 0.000_123_751_520_469_312_9, 0.001_752_443_603_396_047_1),
            (20, 12_500, 0.99, 0.000_828_548_066_331_153_5, 0.002_771_812_680_727_355_4),
            (112, 60_000, 0.95, 0.001_537_248_235_175_438_3, 0.002_245_658_812_611_499),
            (5, 5, 0.95, 0.478_176_249_895_018_56, 1.0),
        ] {
            let found = clopper_pearson(k, n, confidence);
            let is_close =
                |found: Option<f64>, expected: f64| (found.unwrap() - expected).abs() < 1e-9 * expected;
            assert!(found.low == Some(low) || is_close(found.low, low), "{k} of {n}: {found:?}");
            assert!(is_close(found.high, high), "{k} of {n}: {found:?}");
        }
        assert_eq!(clopper_pearson(0, 0, 0.95), Estimate::default());
    }

    /// Five standard errors of a rate of 0.9 in 2000 samples are 0.034.
    #[test]
    fn the_bootstrap_interval_of_10_normal_values_has_a_coverage_of_90_percent() {
        const SAMPLES: u64 = 2000;
        let covers = |sample: &u64| {
            let mut values = [0.0; SMALLEST_SAMPLE];
            Seed(*sample).normals(mishandle_rollout::Stream::ActionNoise, 0, &mut values);
            let found = bootstrap_mean(&values, Seed(*sample));
            found.low.unwrap() <= 0.0 && found.high.unwrap() >= 0.0
        };
        let coverage = (0..SAMPLES).filter(covers).count() as f64 / SAMPLES as f64;
        assert!((coverage - 0.9).abs() < 0.034, "{coverage}");
    }

    #[test]
    fn quantiles_interpolate_linearly_between_order_statistics() {
        assert_eq!(quantile(&[0.0, 1.0, 2.0, 3.0, 4.0], 0.5), 2.0);
        assert_eq!(quantile(&[0.0, 10.0], 0.25), 2.5);
    }
}
