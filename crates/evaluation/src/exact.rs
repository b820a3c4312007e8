//! Exact tests of counts: the sign test of pairs (exact McNemar test), and Fisher's test of two
//! rates.

/// Relative difference below which two probabilities count as equal. It is the one of R and SciPy.
const EQUAL: f64 = 1e-7;

/// Returns the two-sided p-value of the exact sign test, which on pairs of successes is the exact
/// McNemar test.
///
/// `first` and `second` are the numbers of pairs in which only the first, or only the second, has a
/// property. If neither is favored, `first` has a binomial distribution with probability one half.
/// Pairs without a difference do not matter.
///
/// # Example
/// ```
/// use mishandle_evaluation::sign_test;
/// // 0 of 5: twice (1/2)^5.
/// assert_eq!((sign_test(0, 5), sign_test(3, 3)), (0.0625, 1.0));
/// ```
///
/// # Reference
/// McNemar, "Note on the sampling error of the difference between correlated proportions or
/// percentages", Psychometrika 12, 1947.
pub fn sign_test(first: u64, second: u64) -> f64 {
    let n = first + second;
    let fewer = first.min(second);
    let logs = ln_factorials(n);
    let log_binomial = |k: u64| logs[n as usize] - logs[k as usize] - logs[(n - k) as usize];
    let tail: f64 = (0..=fewer).map(|k| (log_binomial(k) - n as f64 * std::f64::consts::LN_2).exp()).sum();
    (2.0 * tail).min(1.0)
}

/// Returns the two-sided p-value of Fisher's exact test that two independent rates are equal. The
/// rows of the table are the two groups, its columns the numbers of successes and of failures.
///
/// It sums the probabilities of all tables with the same margins that are at most as probable as
/// this one.
///
/// # Example
/// ```
/// use mishandle_evaluation::fisher_test;
/// // 3 of 3 against 0 of 3: the two extreme ones of C(6, 3) = 20 equally probable arrangements.
/// assert!((fisher_test([[3, 0], [0, 3]]) - 0.1).abs() < 1e-12);
/// ```
///
/// # Reference
/// Fisher, "Statistical Methods for Research Workers", 1934, section 21.02.
pub fn fisher_test([first, second]: [[u64; 2]; 2]) -> f64 {
    let n_first = first[0] + first[1];
    let n_second = second[0] + second[1];
    let total = n_first + n_second;
    let successes = first[0] + second[0];
    let logs = ln_factorials(total);
    let log_choose = |n: u64, k: u64| logs[n as usize] - logs[k as usize] - logs[(n - k) as usize];
    let log_probability =
        |k: u64| log_choose(n_first, k) + log_choose(n_second, successes - k) - log_choose(total, successes);
    let observed = log_probability(first[0]).exp();
    let possible = successes.saturating_sub(n_second)..=successes.min(n_first);
    let p: f64 = possible
        .map(|k| log_probability(k).exp())
        .filter(|probability| *probability <= observed * (1.0 + EQUAL))
        .sum();
    p.min(1.0)
}

/// Returns ln 0! to ln n!.
fn ln_factorials(n: u64) -> Vec<f64> {
    let mut sum = 0.0;
    std::iter::once(0.0)
        .chain((1..=n).map(|k| {
            sum += (k as f64).ln();
            sum
        }))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// statsmodels: `mcnemar([[0, b], [c, 0]], exact=True)`, in `tests/reference/statistics.py`.
    #[test]
    fn sign_tests_match_statsmodels() {
        for (b, c, expected) in [
            (9, 2, 0.065_429_687_5),
            (5, 0, 0.0625),
            (6, 6, 1.0),
            (40, 18, 0.005_354_859_650_800_294),
            (600, 500, 0.002_819_544_991_436_428_4),
            (0, 0, 1.0),
        ] {
            let found = sign_test(b, c);
            assert!((found / expected - 1.0).abs() < 1e-9, "{b}, {c}: {found}, not {expected}");
        }
    }

    /// SciPy: `fisher_exact`, in `tests/reference/statistics.py`.
    #[test]
    fn fisher_tests_match_scipy() {
        for (table, expected) in [
            ([[8, 2], [1, 5]], 0.034_965_034_965_034_975),
            ([[30, 0], [7, 23]], 1.741_091_350_220_271_5e-10),
            ([[3, 27], [9, 21]], 0.104_164_736_603_072_04),
            ([[0, 30], [0, 30]], 1.0),
            ([[930, 70], [93, 7]], 1.0),
            ([[100, 0], [97, 3]], 0.246_231_155_778_894_48),
        ] {
            let found = fisher_test(table);
            assert!((found / expected - 1.0).abs() < 1e-9, "{table:?}: {found}, not {expected}");
        }
    }
}
