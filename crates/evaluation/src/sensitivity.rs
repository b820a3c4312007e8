//! Total effects of axes on a result (Sobol indices).

use mishandle_rollout::Seed;

use crate::Estimate;
use crate::interval::quantile;

/// Number of bootstrap samples of an interval.
const RESAMPLES: usize = 1000;

/// The results of a sample of n random scenarios.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SensitivitySample {
    /// Results of the scenarios.
    pub first: Vec<f64>,
    /// Results of the same scenarios with another seed: equal if the target is not random.
    pub again: Vec<f64>,
    /// For each axis the results of the same scenarios with another random value of this axis.
    pub moved: Vec<Vec<f64>>,
}

/// Returns the total effect of each axis: the share of the variance of the result that remains on
/// average if all other axes are known, with a 95 % bootstrap interval. Axes with effects that
/// depend on each other count in each, so the sum can be larger than 1. The share is that of the
/// variance that scenarios cause: the noise of seeds, which the sample measures, is subtracted.
///
/// Returns no estimates if the scenarios cause no variance.
///
/// # Example
/// ```
/// use mishandle_evaluation::{SensitivitySample, total_effects};
/// use mishandle_rollout::Seed;
/// // The result is the first axis alone.
/// let x: Vec<f64> = (0..100).map(|i| f64::from(i) / 100.0).collect();
/// let moved: Vec<f64> = (0..100).map(|i| f64::from(i * 37 % 100) / 100.0).collect();
/// let sample = SensitivitySample { first: x.clone(), again: x.clone(), moved: vec![moved, x] };
/// let found = total_effects(&sample, Seed(0));
/// assert!((found[0].value.unwrap() - 1.0).abs() < 0.1 && found[1].value == Some(0.0));
/// ```
///
/// # Reference
/// Jansen, "Analysis of variance designs for model output", Computer Physics Communications 117,
/// 1999: the estimator of the total effect.
pub fn total_effects(sample: &SensitivitySample, seed: Seed) -> Vec<Estimate> {
    let n = sample.first.len();
    let all: Vec<usize> = (0..n).collect();
    let Some(values) = effects(sample, &all) else { return Vec::new() };
    let mut drawn: Vec<Vec<f64>> = vec![Vec::with_capacity(RESAMPLES); sample.moved.len()];
    let mut random = mishandle_random::Sequence::new(seed.0, 0);
    for _ in 0..RESAMPLES {
        let rows: Vec<usize> = (0..n).map(|_| ((random.uniform() * n as f64) as usize).min(n - 1)).collect();
        for (drawn, value) in drawn.iter_mut().zip(effects(sample, &rows).into_iter().flatten()) {
            drawn.push(value);
        }
    }
    let estimate = |(value, mut drawn): (f64, Vec<f64>)| {
        drawn.sort_by(f64::total_cmp);
        let bound = |p: f64| (!drawn.is_empty()).then(|| quantile(&drawn, p));
        Estimate { value: Some(value), low: bound(0.025), high: bound(0.975), n: n as u64 }
    };
    values.into_iter().zip(drawn).map(estimate).collect()
}

/// Returns the total effects in these rows; `None` without variance.
///
/// The variance is that of both samples that are compared, so that a rare large value in one of
/// them makes no share above 1.
fn effects(sample: &SensitivitySample, rows: &[usize]) -> Option<Vec<f64>> {
    let n = rows.len() as f64;
    let half_mean_square = |other: &[f64]| {
        rows.iter().map(|row| (sample.first[*row] - other[*row]).powi(2)).sum::<f64>() / (2.0 * n)
    };
    let variance = |other: &[f64]| {
        let both = || rows.iter().flat_map(|row| [sample.first[*row], other[*row]]);
        let mean = both().sum::<f64>() / (2.0 * n);
        both().map(|value| (value - mean).powi(2)).sum::<f64>() / (2.0 * n - 1.0)
    };
    let noise = half_mean_square(&sample.again);
    let own = variance(&sample.again);
    (own.is_finite() && own - noise > 1e-12 * own.max(f64::MIN_POSITIVE)).then(|| {
        let effect = |moved: &Vec<f64>| {
            let caused = variance(moved) - noise;
            if caused > 0.0 { ((half_mean_square(moved) - noise) / caused).clamp(0.0, 1.0) } else { 0.0 }
        };
        sample.moved.iter().map(effect).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Samples `f` of three uniform axes, with noise of the standard deviation `noise`.
    fn sample(n: usize, noise: f64, f: impl Fn(&[f64; 3]) -> f64) -> SensitivitySample {
        let mut random = mishandle_random::Sequence::new(7, 0);
        let mut found = SensitivitySample { moved: vec![Vec::new(); 3], ..SensitivitySample::default() };
        for _ in 0..n {
            let mut uniform = || random.uniform();
            let x = [uniform(), uniform(), uniform()];
            let other = [uniform(), uniform(), uniform()];
            // A uniform number has the standard deviation 1 / √12.
            let mut seen = |x: &[f64; 3]| f(x) + noise * 12_f64.sqrt() * (uniform() - 0.5);
            found.first.push(seen(&x));
            found.again.push(seen(&x));
            for axis in 0..3 {
                let mut moved = x;
                moved[axis] = other[axis];
                found.moved[axis].push(seen(&moved));
            }
        }
        found
    }

    /// y = 4 a + 2 b has the variances 16 / 12 and 4 / 12: the shares 0.8 and 0.2, also under
    /// noise.
    #[test]
    fn total_effects_of_a_sum_are_its_shares_of_the_variance_also_under_noise() {
        for noise in [0.0, 1.0] {
            let found = total_effects(&sample(4000, noise, |[a, b, _]| 4.0 * a + 2.0 * b), Seed(1));
            for (found, expected) in found.iter().zip([0.8, 0.2, 0.0]) {
                let value = found.value.unwrap();
                let low = found.low.unwrap();
                let high = found.high.unwrap();
                assert!((value - expected).abs() < 0.08, "{noise}: {value} is not {expected}");
                assert!(low <= expected + 0.03 && expected <= high + 0.03, "{noise}: {low} to {high}");
            }
        }
    }

    /// Each of two axes that act only together has more than its own share.
    #[test]
    fn effects_of_two_axes_together_count_in_both() {
        let found = total_effects(&sample(4000, 0.0, |[a, b, _]| (a - 0.5) * (b - 0.5)), Seed(1));
        assert!(found[0].value.unwrap() > 0.9 && found[1].value.unwrap() > 0.9, "{found:?}");
        assert_eq!(found[2].value, Some(0.0));
    }

    #[test]
    fn a_constant_result_has_no_effects() {
        assert_eq!(total_effects(&sample(50, 0.0, |_| 1.0), Seed(1)), []);
    }
}
