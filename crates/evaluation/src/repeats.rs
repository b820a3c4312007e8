//! Repeated simulations of one scenario with other random seeds: failure probability, quantiles and
//! shares of variance.

use mishandle_results::{Estimate, QUANTILES, Quantile, Repeats};
use mishandle_stl::is_violated;

use crate::f_distribution::f_upper_quantile;
use crate::wilson;

/// Returns the results of simulations with these robustness values; `None` is a simulation without
/// a verdict.
///
/// # Example
/// ```
/// use mishandle_evaluation::repeats;
/// let found = repeats(&[Some(1.0), Some(-1.0), None, Some(2.0)]);
/// assert_eq!((found.simulations, found.failures, found.failure_rate.n), (4, 1, 3));
/// assert_eq!(found.quantiles.unwrap()[2].robustness.0, 1.0); // the median
/// ```
pub fn repeats(robustness: &[Option<f64>]) -> Repeats {
    let mut decided: Vec<f64> = robustness.iter().flatten().copied().collect();
    decided.sort_by(f64::total_cmp);
    let failures = decided.iter().filter(|rho| is_violated(**rho)).count() as u64;
    let at = |p: f64| Quantile { p, robustness: quantile(&decided, p).into() };
    Repeats {
        simulations: robustness.len() as u64,
        failures,
        failure_rate: wilson(failures, decided.len() as u64),
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
/// correlation of a one-way analysis of variance with random effects. The 95 % interval follows
/// from the F distribution of M_b / M_w, so it assumes normal values; its bounds are at least 0,
/// too. There is no value unless there are at least two groups, of equal size of at least two, with
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
/// Bulletin 86, 1979: ICC(1,1) and its interval.
pub fn variance_share(groups: &[Vec<f64>]) -> Estimate {
    let unknown = Estimate { n: groups.len() as u64, ..Estimate::default() };
    let n = groups.first().map_or(0, Vec::len);
    let is_usable = |group: &Vec<f64>| group.len() == n && group.iter().all(|x| x.is_finite());
    if groups.len() < 2 || n < 2 || !groups.iter().all(is_usable) {
        return unknown;
    }
    let first = (groups.len() - 1) as u32;
    let second = (groups.len() * (n - 1)) as u32;
    let k = groups.len() as f64;
    let n = n as f64;
    // The share does not depend on the unit of the values, but squares of huge ones overflow.
    let largest = groups.iter().flatten().fold(0.0, |largest: f64, x| largest.max(x.abs()));
    let unit = if largest > 1e100 { largest } else { 1.0 };
    let groups: Vec<Vec<f64>> = groups.iter().map(|group| group.iter().map(|x| x / unit).collect()).collect();
    let means: Vec<f64> = groups.iter().map(|group| group.iter().sum::<f64>() / n).collect();
    let mean = means.iter().sum::<f64>() / k;
    let between = n * means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (k - 1.0);
    let deviation = |(group, m): (&Vec<f64>, &f64)| group.iter().map(|x| (x - m).powi(2)).sum::<f64>();
    let within = groups.iter().zip(&means).map(deviation).sum::<f64>() / (k * (n - 1.0));
    if between + (n - 1.0) * within <= 0.0 {
        return unknown;
    }
    // (M_b - M_w) / (M_b + (n - 1) M_w), with M_b and M_w multiplied by the quantiles of their
    // ratio.
    let share = |between: f64, within: f64| ((between - within) / (between + (n - 1.0) * within)).max(0.0);
    Estimate {
        value: Some(share(between, within)),
        low: Some(share(between, within * f_upper_quantile(TAIL, first, second))),
        high: Some(share(between * f_upper_quantile(TAIL, second, first), within)),
        ..unknown
    }
}

/// Probability of each tail outside a 95 % interval.
const TAIL: f64 = 0.025;

#[cfg(test)]
mod tests {
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
        // By hand: M_b / M_w = 11.2417 / 6.2639 = 1.7947. The upper 2.5 % points of F are 3.3820
        // for (5, 18) and 6.3619 for (18, 5) degrees of freedom, so the bounds are (0.5307 - 1) /
        // (0.5307 + 3) = -0.133, which is cut at 0, and (11.418 - 1) / (11.418 + 3) = 0.723. The R
        // package psych prints -0.133 and 0.72 for these data.
        assert_eq!(share.low, Some(0.0));
        assert!((share.high.unwrap() - 0.723).abs() < 0.001, "{share:?}");
    }

    #[test]
    fn the_interval_of_a_large_share_is_that_of_a_hand_calculation() {
        // Three groups of two: M_b = 2 * 100 = 200, M_w = (0.5 + 0.5 + 0.5) / 3 = 0.5, ratio 400; F
        // is 16.044 for (2, 3) and 39.165 for (3, 2) degrees of freedom: (24.93 - 1) / (24.93 + 1)
        // and (15666 - 1) / (15666 + 1).
        let share = variance_share(&[vec![9.5, 10.5], vec![-0.5, 0.5], vec![-10.5, -9.5]]);
        assert!((share.value.unwrap() - 399.0 / 401.0).abs() < 1e-12);
        assert!((share.low.unwrap() - 0.9229).abs() < 2e-4, "{share:?}");
        assert!((share.high.unwrap() - 0.99987).abs() < 1e-5, "{share:?}");
    }

    #[test]
    fn a_share_needs_two_groups_of_two_different_finite_values() {
        for groups in [
            vec![],
            vec![vec![1.0, 2.0]],
            vec![vec![1.0], vec![2.0]],
            vec![vec![1.0, 2.0], vec![1.0]],
            vec![vec![1.0, 1.0], vec![1.0, 1.0]],
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
