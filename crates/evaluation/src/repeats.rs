//! Repeated simulations of one scenario with other random seeds: failure probability, quantiles and
//! shares of variance.

use mishandle_results::{Estimate, QUANTILES, Quantile, Repeats};
use mishandle_stl::is_violated;

use crate::failure_rate;

/// Returns the results of simulations with these robustness values; `None` is a simulation without
/// a verdict.
///
/// # Example
/// ```
/// use mishandle_evaluation::repeats;
/// let found = repeats(&[Some(1.0), Some(-1.0), None, Some(2.0)]);
/// assert_eq!((found.simulations, found.failures, found.without_verdict), (4, 1, 1));
/// assert_eq!((found.failure_rate.value, found.failure_rate.n), (Some(0.25), 4));
/// assert_eq!(found.quantiles.unwrap()[2].robustness.0, 1.0); // the median
/// ```
pub fn repeats(robustness: &[Option<f64>]) -> Repeats {
    let mut decided: Vec<f64> = robustness.iter().flatten().copied().collect();
    decided.sort_by(f64::total_cmp);
    let failures = decided.iter().filter(|rho| is_violated(**rho)).count() as u64;
    let at = |p: f64| Quantile { p, robustness: quantile(&decided, p).into() };
    let simulations = robustness.len() as u64;
    let without_verdict = simulations - decided.len() as u64;
    Repeats {
        simulations,
        failures,
        without_verdict,
        failure_rate: failure_rate(failures, without_verdict, simulations),
        quantiles: (!decided.is_empty()).then(|| QUANTILES.map(at).to_vec()),
    }
}

/// Returns the quantile of sorted values. Two infinities of one sign are not interpolated.
fn quantile(sorted: &[f64], p: f64) -> f64 {
    let position = p * (sorted.len() - 1) as f64;
    let below = sorted[position.floor() as usize];
    let above = sorted[position.ceil() as usize];
    if below == above { below } else { below + (above - below) * position.fract() }
}

/// Returns the share of the variance of the robustness that comes from the scenario; the rest comes
/// from the noise of repeated simulations. Each group holds the robustness of one scenario.
///
/// ```text
/// share = max(0, (M_b - M_w) / (M_b + (n - 1) M_w))
/// ```
///
/// with the mean squares M_b between and M_w within k groups of n values: the intraclass
/// correlation of a one-way analysis of variance with random effects.
///
/// A jackknife over the groups gives the 95 % interval, which assumes no distribution of the
/// values. Failures in a small region decide the variance, and are in few groups or in none.
/// Therefore each bound allows for one more group with the most extreme value: once beside the mean
/// of all values for the lower one, in all n places for the upper one.
///
/// There is no value unless there are at least two groups, of equal size of at least two, with
/// finite values that are not all equal. `n` of the estimate is the number of groups.
///
/// # Example
/// ```
/// use mishandle_evaluation::variance_share;
/// // The scenario is all: repeats agree.
/// assert_eq!(variance_share(&[vec![1.0, 1.0], vec![3.0, 3.0]]).value, Some(1.0));
/// // The noise is all: the scenarios have the same mean.
/// assert_eq!(variance_share(&[vec![1.0, 3.0], vec![3.0, 1.0]]).value, Some(0.0));
/// ```
///
/// # Reference
/// Shrout and Fleiss, "Intraclass correlations: uses in assessing rater reliability", Psychological
/// Bulletin 86, 1979: ICC(1,1). Miller, "The jackknife: a review", Biometrika 61, 1974.
pub fn variance_share(groups: &[Vec<f64>]) -> Estimate {
    let unknown = Estimate { n: groups.len() as u64, ..Estimate::default() };
    let n = groups.first().map_or(0, Vec::len);
    let is_usable = |group: &Vec<f64>| group.len() == n && group.iter().all(|x| x.is_finite());
    if groups.len() < 2 || n < 2 || !groups.iter().all(is_usable) {
        return unknown;
    }
    // The share does not depend on origin and unit, but squares of huge values overflow.
    let values = || groups.iter().flatten().copied();
    let [low, high] = [values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max)];
    let range = 0.5 * high - 0.5 * low;
    if range <= 0.0 {
        return unknown;
    }
    let scaled = |x: &f64| (0.5 * x - 0.5 * low) / range;
    let mut groups: Vec<Vec<f64>> = groups.iter().map(|group| group.iter().map(scaled).collect()).collect();
    let mean = groups.iter().flatten().sum::<f64>() / (groups.len() * n) as f64;
    let extreme = if mean > 0.5 { 0.0 } else { 1.0 };
    let (value, _) = jackknife(&groups);
    let mut with = |group: Vec<f64>| {
        groups.push(group);
        let found = jackknife(&groups);
        groups.pop();
        found
    };
    let mut noise = vec![mean; n];
    noise[0] = extreme;
    let (lower, lower_error) = with(noise);
    let (upper, upper_error) = with(vec![extreme; n]);
    Estimate {
        value: Some(value.max(0.0)),
        low: Some((lower - Z * lower_error).max(0.0)),
        high: Some((upper + Z * upper_error).clamp(0.0, 1.0)),
        ..unknown
    }
}

/// Quantile of the standard normal distribution for a 95 % interval.
const Z: f64 = 1.959_963_984_540_054;

/// A variance of values from 0 to 1 below this is the rounding of a constant.
const ROUNDING: f64 = 1e-12;

/// Returns the share of the variance that is between groups of values from 0 to 1, which can be
/// negative, and its standard error, from the shares without one group each.
fn jackknife(groups: &[Vec<f64>]) -> (f64, f64) {
    let part = |group: &Vec<f64>| {
        let n = group.len() as f64;
        let mean = group.iter().sum::<f64>() / n;
        let squares: f64 = group.iter().map(|x| (x - mean).powi(2)).sum();
        [mean, mean * mean, squares / (n - 1.0)]
    };
    let parts: Vec<[f64; 3]> = groups.iter().map(part).collect();
    let sums = parts.iter().fold([0.0; 3], |sums, part| [0, 1, 2].map(|i| sums[i] + part[i]));
    let n = groups.first().map_or(0.0, |group| group.len() as f64);
    let share = |[mean, square, within]: [f64; 3], k: f64| {
        let between = n * (square - mean * mean / k).max(0.0) / (k - 1.0);
        let within = within.max(0.0) / k;
        let all = between + (n - 1.0) * within;
        if all > ROUNDING { (between - within) / all } else { 0.0 }
    };
    let k = groups.len() as f64;
    let without = |part: &[f64; 3]| share([0, 1, 2].map(|i| sums[i] - part[i]), k - 1.0);
    let others: Vec<f64> = parts.iter().map(without).collect();
    let mean = others.iter().sum::<f64>() / k;
    let squares: f64 = others.iter().map(|x| (x - mean).powi(2)).sum();
    (share(sums, k), (squares * (k - 1.0) / k).sqrt())
}

#[cfg(test)]
mod tests {
    use mishandle_random::Sequence;

    use super::*;

    #[test]
    fn the_share_of_variance_is_that_of_a_published_example() {
        // Shrout and Fleiss (1979), table 2: six targets, four judges; ICC(1,1) = 0.17.
        let ratings = [
            [9.0, 2.0, 5.0, 8.0],
            [6.0, 1.0, 3.0, 2.0],
            [8.0, 4.0, 6.0, 8.0],
            [7.0, 1.0, 2.0, 6.0],
            [10.0, 5.0, 6.0, 9.0],
            [6.0, 2.0, 4.0, 7.0],
        ];
        let share = variance_share(&ratings.map(Vec::from));
        assert!((share.value.unwrap() - 0.17).abs() < 0.005, "{share:?}");
    }

    /// Systems whose share is known: a scenario is a number from 0 to 1, and the share is the
    /// variance of its mean by the whole variance. Failures in a corner and rare ones decide it.
    #[test]
    fn the_interval_contains_the_share_also_if_failures_sit_in_a_corner() {
        const REPLICATIONS: u64 = 500;
        type Model = (&'static str, fn(f64, &mut Sequence) -> f64, f64);
        fn drop(is_failure: bool) -> f64 {
            if is_failure { -5.0 } else { 0.0 }
        }
        fn normal(random: &mut Sequence) -> f64 {
            random.normal_pair().0
        }
        // A drop of 5 in a share p of the scenarios, with the probability q: the means have the
        // variance 25 q² p (1 - p), and the noise 25 p q (1 - q) besides its own.
        let corner = |p: f64, q: f64, noise: f64| {
            let between = 25.0 * q * q * p * (1.0 - p);
            between / (between + 25.0 * p * q * (1.0 - q) + noise)
        };
        let models: [Model; 8] = [
            ("line", |x, r| x + 0.4 * normal(r), 1.0 / 12.0 / (1.0 / 12.0 + 0.16)),
            ("skewed noise", |x, r| x + 0.4 * r.uniform().ln(), 1.0 / 12.0 / (1.0 / 12.0 + 0.16)),
            ("no effect", |_, r| normal(r), 0.0),
            ("rare", |x, r| 0.1 * x + drop(r.uniform() < 0.01), 0.01 / 12.0 / (0.01 / 12.0 + 0.2475)),
            ("corner", |x, r| 0.2 + drop(x > 0.95 && r.uniform() < 0.5), corner(0.05, 0.5, 0.0)),
            ("rare corner", |x, r| 0.2 + drop(x > 0.95 && r.uniform() < 0.2), corner(0.05, 0.2, 0.0)),
            (
                "noisy corner",
                |x, r| 0.4 * normal(r) + drop(x > 0.95 && r.uniform() < 0.5),
                corner(0.05, 0.5, 0.16),
            ),
            ("certain corner", |x, r| 0.4 * normal(r) + drop(x > 0.98), corner(0.02, 1.0, 0.16)),
        ];
        for (name, robustness, truth) in models {
            let mut covered = 0;
            let mut width = 0.0;
            for replication in 0..REPLICATIONS {
                let mut random = Sequence::new(replication, 0);
                let mut group = || {
                    let x = random.uniform();
                    vec![robustness(x, &mut random), robustness(x, &mut random)]
                };
                let groups: Vec<Vec<f64>> = (0..200).map(|_| group()).collect();
                let share = variance_share(&groups);
                // Without a failure, a corner leaves nothing to measure.
                let [low, high] = [share.low, share.high].map(|bound| bound.unwrap_or(f64::NAN));
                covered += u64::from((low <= truth && truth <= high) || share.value.is_none());
                width += (high - low) / REPLICATIONS as f64;
            }
            // Four standard errors below 95 %.
            assert!(covered as f64 >= 0.911 * REPLICATIONS as f64, "{name}: {covered}");
            // An interval of all values would inform nobody.
            assert!(name != "line" || width < 0.35, "{width}");
        }
    }

    #[test]
    fn a_large_share_is_that_of_a_hand_calculation() {
        // Three groups of two: M_b = 2 * 100 = 200, M_w = (0.5 + 0.5 + 0.5) / 3 = 0.5, ratio 400.
        let share = variance_share(&[vec![9.5, 10.5], vec![-0.5, 0.5], vec![-10.5, -9.5]]);
        assert!((share.value.unwrap() - 399.0 / 401.0).abs() < 1e-12);
        assert!(share.low < share.value && share.high > share.value, "{share:?}");
    }

    #[test]
    fn a_share_needs_two_groups_of_two_different_finite_values() {
        for groups in [
            vec![],
            vec![vec![1.0, 2.0]],
            vec![vec![1.0], vec![2.0]],
            vec![vec![1.0, 2.0], vec![1.0]],
            vec![vec![1.0, 1.0], vec![1.0, 1.0]],
            // The mean of these is another number than 0.2.
            vec![vec![0.2; 20]; 20],
            vec![vec![f64::INFINITY, 1.0], vec![1.0, 2.0]],
        ] {
            assert_eq!(variance_share(&groups).value, None, "{groups:?}");
        }
    }

    #[test]
    fn quantiles_interpolate_and_keep_infinities() {
        let values = [Some(f64::NEG_INFINITY), Some(f64::NEG_INFINITY), Some(0.0), Some(1.0), Some(2.0)];
        let quantiles = repeats(&values).quantiles.unwrap();
        let quantiles: Vec<f64> = quantiles.iter().map(|quantile| quantile.robustness.0).collect();
        assert_eq!(
            [quantiles[0], quantiles[1], quantiles[2], quantiles[4]],
            [f64::NEG_INFINITY, f64::NEG_INFINITY, 0.0, 2.0]
        );
        assert!((quantiles[3] - 1.8).abs() < 1e-12);
        assert_eq!(repeats(&[None]).quantiles, None);
    }
}
