//! Repeated simulations of one scenario with other random seeds: failure probability, quantiles and shares of variance.

use crate::{Estimate, wilson};

/// The probabilities of [`RepeatReport::quantiles`].
pub const QUANTILES: [f64; 5] = [0.0, 0.05, 0.5, 0.95, 1.0];

/// Results of repeated simulations of one scenario.
#[derive(Clone, Debug, PartialEq)]
pub struct RepeatReport {
    /// Number of simulations, with or without a verdict.
    pub simulations: u64,
    /// Number of simulations that violate the requirement.
    pub failures: u64,
    /// Failure rate of the simulations with a verdict, with its Wilson interval.
    pub failure_rate: Estimate,
    /// Quantiles of the robustness at the probabilities [`QUANTILES`], linearly interpolated; `None` without a verdict.
    pub quantiles: Option<[f64; QUANTILES.len()]>,
}

impl RepeatReport {
    /// Makes the report of simulations with these robustness values; `None` is a simulation without a verdict.
    ///
    /// # Example
    /// ```
    /// use mishandle_evaluation::RepeatReport;
    /// let report = RepeatReport::new(&[Some(1.0), Some(-1.0), None, Some(2.0)]);
    /// assert_eq!((report.simulations, report.failures, report.failure_rate.n), (4, 1, 3));
    /// assert_eq!(report.quantiles.unwrap()[2], 1.0); // the median
    /// ```
    pub fn new(robustness: &[Option<f64>]) -> RepeatReport {
        let mut decided: Vec<f64> = robustness.iter().flatten().copied().collect();
        decided.sort_by(f64::total_cmp);
        let failures = decided.iter().filter(|rho| **rho < 0.0).count() as u64;
        let quantiles = (!decided.is_empty()).then(|| QUANTILES.map(|p| quantile(&decided, p)));
        RepeatReport {
            simulations: robustness.len() as u64,
            failures,
            failure_rate: wilson(failures, decided.len() as u64),
            quantiles,
        }
    }
}

/// Returns the quantile of sorted values. Two infinities of one sign are not interpolated.
fn quantile(sorted: &[f64], p: f64) -> f64 {
    let position = p * (sorted.len() - 1) as f64;
    let (below, above) = (sorted[position.floor() as usize], sorted[position.ceil() as usize]);
    if below == above { below } else { below + (above - below) * position.fract() }
}

/// Returns the share of the variance of the robustness that comes from the scenario; the rest comes from the noise of repeated
/// simulations. Each group holds the robustness of one scenario.
///
/// ```text
/// share = max(0, (M_b - M_w) / (M_b + (n - 1) M_w))
/// ```
///
/// with the mean squares M_b between and M_w within k groups of n values: the intraclass correlation of a one-way analysis of
/// variance with random effects. Returns `None` unless there are at least two groups, of equal size of at least two, with
/// finite values that are not all equal.
///
/// # Example
/// ```
/// use mishandle_evaluation::variance_share;
/// // The scenario is all: repeats agree.
/// assert_eq!(variance_share(&[vec![1.0, 1.0], vec![3.0, 3.0]]), Some(1.0));
/// // The noise is all: the scenarios have the same mean.
/// assert_eq!(variance_share(&[vec![1.0, 3.0], vec![3.0, 1.0]]), Some(0.0));
/// ```
///
/// # Reference
/// Shrout and Fleiss, "Intraclass correlations: uses in assessing rater reliability", Psychological Bulletin 86, 1979:
/// ICC(1,1).
pub fn variance_share(groups: &[Vec<f64>]) -> Option<f64> {
    let n = groups.first()?.len();
    let is_usable = |group: &Vec<f64>| group.len() == n && group.iter().all(|x| x.is_finite());
    if groups.len() < 2 || n < 2 || !groups.iter().all(is_usable) {
        return None;
    }
    let (k, n) = (groups.len() as f64, n as f64);
    let means: Vec<f64> = groups.iter().map(|group| group.iter().sum::<f64>() / n).collect();
    let mean = means.iter().sum::<f64>() / k;
    let between = n * means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (k - 1.0);
    let deviation = |(group, m): (&Vec<f64>, &f64)| group.iter().map(|x| (x - m).powi(2)).sum::<f64>();
    let within = groups.iter().zip(&means).map(deviation).sum::<f64>() / (k * (n - 1.0));
    let whole = between + (n - 1.0) * within;
    (whole > 0.0).then(|| ((between - within) / whole).max(0.0))
}

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
        let share = variance_share(&ratings.map(Vec::from)).unwrap();
        assert!((share - 0.17).abs() < 0.005, "{share}");
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
            assert_eq!(variance_share(&groups), None, "{groups:?}");
        }
    }

    #[test]
    fn quantiles_interpolate_and_keep_infinities() {
        let values = [Some(f64::NEG_INFINITY), Some(f64::NEG_INFINITY), Some(0.0), Some(1.0), Some(2.0)];
        let quantiles = RepeatReport::new(&values).quantiles.unwrap();
        assert_eq!(
            [quantiles[0], quantiles[1], quantiles[2], quantiles[4]],
            [f64::NEG_INFINITY, f64::NEG_INFINITY, 0.0, 2.0]
        );
        assert!((quantiles[3] - 1.8).abs() < 1e-12);
        assert_eq!(RepeatReport::new(&[None]).quantiles, None);
    }
}
