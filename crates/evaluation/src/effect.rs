//! Effect size of two samples.

use crate::Estimate;
use crate::interval::Z;

/// Halvings of an interval inside [0, 1]: its ends are then neighboring numbers.
const HALVINGS: usize = 60;

/// Returns Vargha and Delaney's effect size A: the probability that a value of `first` is larger
/// than a value of `second`, where ties count as one half. 0.5 means no difference. The interval is
/// Newcombe's (method 5).
///
/// A counts which trial needs more simulations, not how many more, so trials without a failure may
/// have the value of the budget. `n` is the number of values in both samples. The interval assumes
/// few ties; with many it is too wide, not too narrow.
///
/// # Example
/// ```
/// use mishandle_evaluation::vargha_delaney;
/// let found = vargha_delaney(&[5.0, 6.0, 7.0], &[1.0, 2.0, 3.0, 4.0]);
/// assert_eq!((found.value, found.high, found.n), (Some(1.0), Some(1.0), 7));
/// assert!(found.low.unwrap() < 0.8);
/// assert_eq!(vargha_delaney(&[1.0, 2.0], &[2.0, 1.0]).value, Some(0.5));
/// ```
///
/// # Reference
/// Vargha and Delaney, "A critique and improvement of the CL common language effect size statistics
/// of McGraw and Wong", Journal of Educational and Behavioral Statistics 25, 2000. Newcombe,
/// "Confidence intervals for an effect size measure based on the Mann-Whitney statistic, part 2",
/// Statistics in Medicine 25, 2006.
pub fn vargha_delaney(first: &[f64], second: &[f64]) -> Estimate {
    let m = first.len() as f64;
    let n = second.len() as f64;
    if first.is_empty() || second.is_empty() {
        return Estimate::default();
    }
    let pairs = first.iter().flat_map(|a| second.iter().map(move |b| (a, b)));
    let wins: f64 = pairs
        .map(|(a, b)| {
            if a > b {
                1.0
            } else if a == b {
                0.5
            } else {
                0.0
            }
        })
        .sum();
    let value = wins / (m * n);
    let middle = (m + n) / 2.0 - 1.0;
    let deviation = |a: f64| {
        let variance = a * (1.0 - a) * (1.0 + middle * ((1.0 - a) / (2.0 - a) + a / (1.0 + a))) / (m * n);
        Z * variance.max(0.0).sqrt()
    };
    // The bounds are the values whose own deviation just reaches the observed one.
    let low = bisect(0.0, value, |a| value - a > deviation(a));
    let high = bisect(value, 1.0, |a| a - value <= deviation(a) && a < 1.0);
    let n = (first.len() + second.len()) as u64;
    Estimate { value: Some(value), low: Some(low), high: Some(if value == 1.0 { 1.0 } else { high }), n }
}

/// Returns the point between `low` and `high` where `is_left` changes from true to false.
fn bisect(mut low: f64, mut high: f64, is_left: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..HALVINGS {
        let middle = f64::midpoint(low, high);
        if is_left(middle) { low = middle } else { high = middle }
    }
    f64::midpoint(low, high)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// SciPy: `mannwhitneyu` and `brentq` on Newcombe's equation, in
    /// `tests/reference/statistics.py`.
    #[test]
    fn effect_sizes_match_scipy() {
        let found = vargha_delaney(&[1.0, 4.0, 7.0, 9.0, 9.0, 12.0], &[2.0, 4.0, 5.0, 6.0]);
        check(found, [0.729_166_666_666_666_6, 0.363_034_322_202_523_9, 0.921_698_956_298_685_3]);
        let first: Vec<f64> = [300.0; 20].into_iter().chain((1..=10).map(|i| 10.0 * f64::from(i))).collect();
        let second: Vec<f64> = [300.0; 5].into_iter().chain((1..=25).map(f64::from)).collect();
        let found = vargha_delaney(&first, &second);
        check(found, [0.865_555_555_555_555_5, 0.739_513_681_231_851_9, 0.932_695_485_875_328_7]);
    }

    #[track_caller]
    fn check(found: Estimate, expected: [f64; 3]) {
        for (found, expected) in [found.value, found.low, found.high].into_iter().zip(expected) {
            assert!((found.unwrap() - expected).abs() < 1e-9, "{found:?}, not {expected}");
        }
    }

    #[test]
    fn the_effect_size_is_antisymmetric_and_its_interval_inside_0_and_1() {
        let a = [1.0, 2.0, 2.0, 8.0, 9.0];
        let b = [2.0, 3.0, 3.0];
        let found = vargha_delaney(&a, &b);
        let mirror = vargha_delaney(&b, &a);
        assert!((found.value.unwrap() + mirror.value.unwrap() - 1.0).abs() < 1e-12);
        assert!((found.low.unwrap() + mirror.high.unwrap() - 1.0).abs() < 1e-9, "{found:?} {mirror:?}");
        let least = vargha_delaney(&[1.0], &[2.0]);
        let most = vargha_delaney(&[2.0], &[1.0]);
        assert_eq!((least.low, most.high), (Some(0.0), Some(1.0)));
        assert!((least.high.unwrap() - (1.0 - most.low.unwrap())).abs() < 1e-9, "{least:?} {most:?}");
        assert_eq!(vargha_delaney(&[], &[1.0]), Estimate::default());
    }
}
