/// Returns the p-values adjusted for several tests by Holm's method, in the order of `p_values`.
///
/// Rejecting every hypothesis with an adjusted p-value below 0.05 makes any wrong rejection among
/// all of them at most 5 % probable, whatever the dependence of the tests.
///
/// # Example
/// ```
/// use mishandle_evaluation::holm;
/// // The smallest times 4, the next ones times 3, 2 and 1, and none below the one before it.
/// let adjusted = holm(&[0.01, 0.04, 0.03, 0.005]);
/// for (found, expected) in adjusted.iter().zip([0.03, 0.06, 0.06, 0.02]) {
///     assert!((found - expected).abs() < 1e-12);
/// }
/// ```
///
/// # Reference
/// Holm, "A simple sequentially rejective multiple test procedure", Scandinavian Journal of
/// Statistics 6, 1979.
pub fn holm(p_values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..p_values.len()).collect();
    order.sort_by(|a, b| p_values[*a].total_cmp(&p_values[*b]));
    let mut adjusted = vec![0.0; p_values.len()];
    let mut largest = 0.0_f64;
    for (rank, index) in order.into_iter().enumerate() {
        let factor = (p_values.len() - rank) as f64;
        largest = largest.max((factor * p_values[index]).min(1.0));
        adjusted[index] = largest;
    }
    adjusted
}

#[cfg(test)]
mod tests {
    use super::*;

    /// statsmodels: `multipletests(p, method="holm")`, in `tests/reference/statistics.py`.
    #[test]
    fn ties_and_large_values_match_statsmodels() {
        let found = holm(&[0.5, 0.02, 0.3, 0.02, 0.9]);
        for (found, expected) in found.iter().zip([1.0, 0.1, 0.9, 0.1, 1.0]) {
            assert!((found - expected).abs() < 1e-12, "{found}, not {expected}");
        }
        assert!(holm(&[]).is_empty());
    }
}
