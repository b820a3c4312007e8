//! The Kruskal-Wallis test.

use crate::chi_squared_tail;

/// Result of the Kruskal-Wallis test.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KruskalWallis {
    /// The statistic H, corrected for ties.
    pub statistic: f64,
    /// Probability of an H at least this large if all groups have the same distribution. It is that
    /// of the chi-squared distribution with k - 1 degrees of freedom, which is accurate from about
    /// five values in each of the k groups.
    pub p_value: f64,
    /// Share of the variance of the ranks that the groups explain, from 0 to 1: (H - k + 1) / (n -
    /// k), where n is the number of values. Its mean is about 0 if the groups have the same
    /// distribution.
    pub share: f64,
}

/// Tests whether several groups of values have the same distribution; `None` if fewer than two
/// groups have values, if each has one value, or if all values are equal. Values must not be NaN.
///
/// The test sees any change of the location between the groups. If the groups are intervals of a
/// variable, it sees effects of that variable that are not monotone, which a rank correlation
/// misses.
///
/// # Example
/// ```
/// use mishandle_evaluation::kruskal_wallis;
/// let found = kruskal_wallis(&[vec![1.0, 2.0], vec![3.0, 4.0], vec![5.0, 6.0]]).unwrap();
/// // Rank sums 3, 7 and 11: 12 / (6 * 7) * (9 + 49 + 121) / 2 - 3 * 7.
/// assert!((found.statistic - 32.0 / 7.0).abs() < 1e-12);
/// assert!((found.share - (32.0 / 7.0 - 2.0) / 3.0).abs() < 1e-12);
/// ```
///
/// # Reference
/// Kruskal and Wallis, "Use of ranks in one-criterion variance analysis", Journal of the American
/// Statistical Association 47,
/// 1952. The share: Tomczak and Tomczak, "The need to report effect size estimates revisited",
///       Trends in Sport Sciences 21, 2014.
pub fn kruskal_wallis(groups: &[Vec<f64>]) -> Option<KruskalWallis> {
    let groups: Vec<&Vec<f64>> = groups.iter().filter(|group| !group.is_empty()).collect();
    let values: Vec<f64> = groups.iter().flat_map(|group| group.iter().copied()).collect();
    let n = values.len();
    let k = groups.len();
    if k < 2 || n <= k {
        return None;
    }
    let ranks = ranks(&values);
    let mut first = 0;
    let mut squares = 0.0;
    for group in &groups {
        let sum: f64 = ranks[first..first + group.len()].iter().sum();
        squares += sum * sum / group.len() as f64;
        first += group.len();
    }
    let size = n as f64;
    let correction = 1.0 - ties(values) / (size * size * size - size);
    if correction <= 0.0 {
        return None;
    }
    let statistic = (12.0 / (size * (size + 1.0)) * squares - 3.0 * (size + 1.0)) / correction;
    let degrees_of_freedom = (k - 1) as f64;
    Some(KruskalWallis {
        statistic,
        p_value: chi_squared_tail(statistic, k as u32 - 1),
        share: ((statistic - degrees_of_freedom) / (n - k) as f64).clamp(0.0, 1.0),
    })
}

/// Returns the ranks of values, from 1; equal values share the mean of their ranks.
fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    let mut ranks = vec![0.0; values.len()];
    let mut first = 0;
    for equal in order.chunk_by(|a, b| values[*a] == values[*b]) {
        let mean = first as f64 + f64::midpoint(1.0, equal.len() as f64);
        equal.iter().for_each(|index| ranks[*index] = mean);
        first += equal.len();
    }
    ranks
}

/// Returns the sum of t³ - t over the groups of t equal values.
fn ties(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let cube = |equal: &[f64]| (equal.len() as f64).powi(3) - equal.len() as f64;
    values.chunk_by(|a, b| a == b).map(cube).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// SciPy: `scipy.stats.kruskal`, in `tests/reference/statistics.py`.
    #[test]
    fn statistics_match_scipy() {
        check(
            &[vec![2.9, 3.0, 2.5, 2.6, 3.2], vec![3.8, 2.7, 4.0, 2.4], vec![2.8, 3.4, 3.7, 2.2, 2.0]],
            [0.771_428_571_428_572_2, 0.679_964_773_578_893_6],
        );
        check(
            &[vec![1.0, 1.0, 2.0, 5.0], vec![2.0, 2.0, 3.0], vec![7.0, 7.0, 8.0, 9.0], vec![5.0, 1.0]],
            [8.137_005_649_717_509, 0.043_263_466_973_642_48],
        );
    }

    #[track_caller]
    fn check(groups: &[Vec<f64>], [statistic, p_value]: [f64; 2]) {
        let found = kruskal_wallis(groups).unwrap();
        assert!((found.statistic - statistic).abs() < 1e-10, "{found:?}");
        assert!((found.p_value - p_value).abs() < 1e-10, "{found:?}");
    }

    #[test]
    fn groups_without_a_difference_to_see_have_no_result() {
        assert_eq!(kruskal_wallis(&[vec![1.0, 2.0], Vec::new()]), None);
        assert_eq!(kruskal_wallis(&[vec![1.0], vec![2.0]]), None);
        assert_eq!(kruskal_wallis(&[vec![3.0, 3.0], vec![3.0]]), None);
        assert_eq!(kruskal_wallis(&[]), None);
    }

    #[test]
    fn equal_groups_explain_nothing_and_infinities_are_values() {
        let found = kruskal_wallis(&[vec![1.0, 2.0, 3.0], vec![1.0, 2.0, 3.0]]).unwrap();
        assert!(found.p_value > 0.999 && found.share == 0.0, "{found:?}");
        let found = kruskal_wallis(&[vec![1.0, 2.0, 3.0], vec![f64::INFINITY; 3]]).unwrap();
        assert!(found.p_value < 0.05 && found.share > 0.5, "{found:?}");
    }
}
