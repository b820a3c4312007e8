//! Survival analysis: Kaplan-Meier curve, restricted mean and log-rank test of simulations to
//! failure.

use mishandle_results::{Trial, TrialEnd};

use crate::interval::Z;
use crate::{Estimate, chi_squared_tail};

/// Number of simulations of a trial until its first failure, possibly censored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lifetime {
    /// Number of simulations, including the failing one.
    pub simulations: u32,
    /// Whether the last simulation failed. Otherwise the lifetime is censored: the first failure
    /// would come later.
    pub failed: bool,
}

impl Lifetime {
    /// Returns the lifetime of a trial whose last of `simulations` failed.
    pub fn failed(simulations: u32) -> Lifetime {
        Lifetime { simulations, failed: true }
    }

    /// Returns the lifetime of a trial without a failure in `simulations`.
    ///
    /// Censoring must not depend on what the trial would have found. A budget meets this; a search
    /// that gives up does not, because it gives up where it expects no failure. To ask for the
    /// simulations that a user waits for within a budget, censor such a trial at the budget: it
    /// finds nothing until then.
    pub fn censored(simulations: u32) -> Lifetime {
        Lifetime { simulations, failed: false }
    }
}

/// Returns the lifetimes of the trials that ended. A search that gave up finds nothing within its
/// budget, so its trial is censored at the budget.
pub fn lifetimes(trials: &[Trial], budget: u32) -> Vec<Lifetime> {
    let lifetime = |trial: &Trial| match (trial.first_violation, trial.end?) {
        (Some(number), _) => Some(Lifetime::failed(number)),
        (None, TrialEnd::SearchEnded) => Some(Lifetime::censored(trial.simulations.max(budget))),
        (None, _) => Some(Lifetime::censored(trial.simulations)),
    };
    trials.iter().filter_map(lifetime).collect()
}

/// A step of a [`SurvivalCurve`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurvivalStep {
    /// Number of simulations.
    pub simulations: u32,
    /// Number of trials that are still without a failure and not censored before this simulation.
    pub at_risk: u64,
    /// Number of trials whose first failure is this simulation.
    pub failures: u64,
    /// Estimated probability of no failure up to and including this simulation, with its log-log
    /// interval. No bounds at 0.
    pub survival: Estimate,
}

/// Kaplan-Meier estimate of the probability that a trial has no failure within a number of
/// simulations.
///
/// # Example
/// ```
/// use mishandle_evaluation::{Lifetime, SurvivalCurve};
/// // Two of four trials fail, after 20 and 40 simulations. The budget is 300.
/// let trials = [Lifetime::failed(20), Lifetime::failed(40), Lifetime::censored(300), Lifetime::censored(300)];
/// let curve = SurvivalCurve::new(&trials);
/// assert_eq!((curve.at(19), curve.at(20), curve.at(300)), (1.0, 0.75, 0.5));
/// assert_eq!(curve.restricted_mean(300).unwrap().value, Some((20.0 + 40.0 + 300.0 + 300.0) / 4.0));
/// ```
///
/// # Reference
/// Kaplan and Meier, "Nonparametric estimation from incomplete observations", JASA 53, 1958.
/// Intervals: Kalbfleisch and Prentice, "The Statistical Analysis of Failure Time Data", 2002,
/// section 1.4.
#[derive(Clone, Debug, PartialEq)]
pub struct SurvivalCurve {
    /// Number of trials.
    pub n: u64,
    /// The steps, by number of simulations. Before the first one the probability is 1.
    pub steps: Vec<SurvivalStep>,
    /// Largest lifetime. Behind it the curve is unknown, unless it is 0.
    pub last: u32,
}

impl SurvivalCurve {
    /// Makes the curve of these trials.
    pub fn new(trials: &[Lifetime]) -> SurvivalCurve {
        let mut survival = 1.0;
        let mut hazard_variance = 0.0;
        let n = trials.len() as u64;
        let steps = failure_times(trials.iter()).into_iter().map(|time| {
            let (at_risk, failures) = counts(trials, time);
            let risk = at_risk as f64;
            let failed = failures as f64;
            survival *= (risk - failed) / risk;
            hazard_variance += failed / (risk * (risk - failed));
            let bound = |sign: f64| {
                let log = f64::ln(survival);
                (survival > 0.0).then(|| survival.powf((sign * Z * hazard_variance.sqrt() / log).exp()))
            };
            // ln of a probability is negative, so the positive sign gives the upper bound.
            let low = bound(-1.0);
            let high = bound(1.0);
            SurvivalStep {
                simulations: time,
                at_risk,
                failures,
                survival: Estimate { value: Some(survival), low, high, n },
            }
        });
        let steps = steps.collect();
        SurvivalCurve { n, steps, last: trials.iter().map(|trial| trial.simulations).max().unwrap_or(0) }
    }

    /// Returns the estimated probability that a trial has no failure within `simulations`.
    pub fn at(&self, simulations: u32) -> f64 {
        let passed = self.steps.iter().take_while(|step| step.simulations <= simulations);
        passed.last().and_then(|step| step.survival.value).unwrap_or(1.0)
    }

    /// Returns the smallest number of simulations within which at least half of the trials fail;
    /// `None` if fewer do.
    pub fn median(&self) -> Option<u32> {
        // A product of fractions can miss one half by its rounding errors.
        let is_passed = |step: &&SurvivalStep| step.survival.value.is_some_and(|value| value <= 0.5 + 1e-12);
        self.steps.iter().find(is_passed).map(|step| step.simulations)
    }

    /// Returns the restricted mean: the mean of min(simulations to failure, `horizon`), which is
    /// the area under the curve up to `horizon`, with its normal interval from Greenwood's
    /// variance. `None` without trials, or if the curve is unknown at the horizon.
    ///
    /// The interval is cut at 0 and `horizon`. Without a failure before the horizon it has no
    /// bounds, because the variance is then 0 whatever the number of trials; the interval of the
    /// failure rate says what is known.
    ///
    /// # Reference
    /// Klein and Moeschberger, "Survival Analysis", 2003, section 4.5.
    pub fn restricted_mean(&self, horizon: u32) -> Option<Estimate> {
        let is_known = self.last >= horizon || self.at(self.last) == 0.0;
        if self.n == 0 || !is_known {
            return None;
        }
        let before: Vec<&SurvivalStep> =
            self.steps.iter().filter(|step| step.simulations < horizon).collect();
        // From the last step to the first: the area behind each step.
        let mut area = 0.0;
        let mut variance = 0.0;
        let mut end = f64::from(horizon);
        for step in before.iter().rev() {
            let time = f64::from(step.simulations);
            let risk = step.at_risk as f64;
            let failed = step.failures as f64;
            area += step.survival.value.unwrap_or(0.0) * (end - time);
            end = time;
            if risk > failed {
                variance += area * area * failed / (risk * (risk - failed));
            }
        }
        let mean = area + end;
        let half = Z * variance.sqrt();
        let bound = |bound: f64| (variance > 0.0).then_some(bound.clamp(0.0, horizon.into()));
        Some(Estimate { value: Some(mean), low: bound(mean - half), high: bound(mean + half), n: self.n })
    }
}

/// Returns the times of all failures, in order.
fn failure_times<'a>(trials: impl Iterator<Item = &'a Lifetime>) -> Vec<u32> {
    let mut times: Vec<u32> = trials.filter(|trial| trial.failed).map(|trial| trial.simulations).collect();
    times.sort_unstable();
    times.dedup();
    times
}

/// Returns the number of trials at risk before a simulation, and of those that fail in it. A trial
/// that is censored at the same simulation is still at risk.
fn counts(trials: &[Lifetime], time: u32) -> (u64, u64) {
    let at_risk = trials.iter().filter(|trial| trial.simulations >= time).count();
    let failures = trials.iter().filter(|trial| trial.failed && trial.simulations == time).count();
    (at_risk as u64, failures as u64)
}

/// Result of a log-rank test.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LogRank {
    /// Test statistic.
    pub chi_squared: f64,
    /// Degrees of freedom: number of groups minus 1.
    pub degrees_of_freedom: u32,
    /// Probability of at least this statistic if all groups have the same curve. The approximation
    /// needs a few failures in each group.
    pub p_value: f64,
}

/// Tests whether groups of trials have the same survival curve. Returns `None` with fewer than two
/// groups, an empty group, or without failures at which several groups are at risk.
///
/// # Example
/// ```
/// use mishandle_evaluation::{Lifetime, log_rank};
/// let fast: Vec<Lifetime> = (1..=20).map(Lifetime::failed).collect();
/// let slow = vec![Lifetime::censored(300); 20];
/// let found = log_rank(&[&fast, &slow]).unwrap();
/// assert!(found.degrees_of_freedom == 1 && found.p_value < 1e-6);
/// assert_eq!(log_rank(&[&slow, &slow]), None);
/// ```
///
/// # Reference
/// Mantel, "Evaluation of survival data and two new rank order statistics arising in its
/// consideration", Cancer Chemotherapy Reports 50, 1966. Several groups: Klein and Moeschberger,
/// "Survival Analysis", 2003, section 7.3.
pub fn log_rank(groups: &[&[Lifetime]]) -> Option<LogRank> {
    if groups.len() < 2 || groups.iter().any(|group| group.is_empty()) {
        return None;
    }
    // The last group is determined by the others.
    let free = groups.len() - 1;
    let mut surplus = vec![0.0; free];
    let mut covariance = vec![vec![0.0; free]; free];
    for time in failure_times(groups.iter().flat_map(|group| group.iter())) {
        let of_groups: Vec<(u64, u64)> = groups.iter().map(|group| counts(group, time)).collect();
        let risk = of_groups.iter().map(|(risk, _)| *risk).sum::<u64>() as f64;
        let failed = of_groups.iter().map(|(_, failed)| *failed).sum::<u64>() as f64;
        // Hypergeometric: with one trial left, its failure says nothing.
        let scale = if risk > 1.0 { failed * (risk - failed) / (risk - 1.0) } else { 0.0 };
        for i in 0..free {
            let share = of_groups[i].0 as f64 / risk;
            surplus[i] += of_groups[i].1 as f64 - failed * share;
            for (j, entry) in covariance[i].iter_mut().enumerate() {
                let other = of_groups[j].0 as f64 / risk;
                *entry += scale * share * (if i == j { 1.0 } else { 0.0 } - other);
            }
        }
    }
    let solved = solve(covariance, surplus.clone())?;
    let chi_squared: f64 = surplus.iter().zip(&solved).map(|(a, b)| a * b).sum();
    let degrees_of_freedom = free as u32;
    Some(LogRank {
        chi_squared,
        degrees_of_freedom,
        p_value: chi_squared_tail(chi_squared, degrees_of_freedom),
    })
}

/// Solves a linear system by Gaussian elimination with pivots; `None` if it is singular.
fn solve(mut matrix: Vec<Vec<f64>>, mut right: Vec<f64>) -> Option<Vec<f64>> {
    let n = right.len();
    for column in 0..n {
        let pivot =
            (column..n).max_by(|a, b| matrix[*a][column].abs().total_cmp(&matrix[*b][column].abs()))?;
        matrix.swap(column, pivot);
        right.swap(column, pivot);
        if matrix[column][column].abs() < 1e-12 {
            return None;
        }
        for row in column + 1..n {
            let factor = matrix[row][column] / matrix[column][column];
            let pivot_row = matrix[column].clone();
            for (entry, above) in matrix[row].iter_mut().zip(&pivot_row).skip(column) {
                *entry -= factor * above;
            }
            right[row] -= factor * right[column];
        }
    }
    for row in (0..n).rev() {
        let known: f64 = (row + 1..n).map(|k| matrix[row][k] * right[k]).sum();
        right[row] = (right[row] - known) / matrix[row][row];
    }
    Some(right)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lifetimes(times: &[u32], failed: &[u8]) -> Vec<Lifetime> {
        times
            .iter()
            .zip(failed)
            .map(|(time, failed)| Lifetime { simulations: *time, failed: *failed == 1 })
            .collect()
    }

    /// Weeks of remission of leukemia patients with 6-mercaptopurine: Freireich et al., Blood
    /// 21, 1963.
    fn treated() -> Vec<Lifetime> {
        lifetimes(
            &[6, 6, 6, 6, 7, 9, 10, 10, 11, 13, 16, 17, 19, 20, 22, 23, 25, 32, 32, 34, 35],
            &[1, 1, 1, 0, 1, 0, 1, 0, 0, 1, 1, 0, 0, 0, 1, 1, 0, 0, 0, 0, 0],
        )
    }

    /// The same with placebo.
    fn placebo() -> Vec<Lifetime> {
        lifetimes(&[1, 1, 2, 2, 3, 4, 4, 5, 5, 8, 8, 8, 8, 11, 11, 12, 12, 15, 17, 22, 23], &[1; 21])
    }

    /// Censored at a common budget.
    fn with_budget() -> Vec<Lifetime> {
        lifetimes(&[3, 9, 9, 14, 30, 30, 30, 30], &[1, 1, 1, 1, 0, 0, 0, 0])
    }

    #[track_caller]
    fn check(found: Option<f64>, expected: f64) {
        let found = found.unwrap();
        assert!((found - expected).abs() < 1e-9 * expected.abs(), "{found}, not {expected}");
    }

    /// lifelines, in `tests/reference/statistics.py`.
    #[test]
    fn curves_match_lifelines() {
        let first = SurvivalCurve::new(&treated());
        let second = SurvivalCurve::new(&with_budget());
        check(Some(first.at(10)), 0.752_941_176_470_587_8);
        check(Some(first.at(23)), 0.448_179_271_708_683_27);
        check(Some(second.at(10)), 0.625);
        let step =
            |curve: &SurvivalCurve, time| *curve.steps.iter().find(|step| step.simulations == time).unwrap();
        check(step(&first, 10).survival.low, 0.503_199_510_799_956_4);
        check(step(&first, 10).survival.high, 0.889_361_835_169_265_1);
        check(step(&second, 9).survival.low, 0.229_333_322_429_131_65);
        check(step(&second, 9).survival.high, 0.860_698_276_913_538_7);
        assert_eq!(
            (first.median(), second.median(), SurvivalCurve::new(&placebo()).median()),
            (Some(23), Some(14), Some(8))
        );
    }

    #[test]
    fn restricted_means_match_lifelines_and_greenwood() {
        for (trials, mean, error) in [
            (treated(), 21.046_498_599_439_8, 2.243_801_951_559_455_6),
            (with_budget(), 19.375, 3.880_792_042_225_402),
        ] {
            let found = SurvivalCurve::new(&trials).restricted_mean(30).unwrap();
            check(found.value, mean);
            check(found.low, mean - Z * error);
            check(found.high, (mean + Z * error).min(30.0));
        }
    }

    #[test]
    fn a_restricted_mean_needs_a_known_curve_and_a_failure_for_its_interval() {
        let budget = [Lifetime::censored(300); 30];
        let found = SurvivalCurve::new(&budget).restricted_mean(300).unwrap();
        assert_eq!((found.value, found.low, found.high, found.n), (Some(300.0), None, None, 30));
        let short = SurvivalCurve::new(&[Lifetime::failed(3), Lifetime::censored(40)]);
        assert_eq!(short.restricted_mean(300), None);
        assert!(short.restricted_mean(40).is_some());
        let all_failed =
            SurvivalCurve::new(&[Lifetime::failed(3), Lifetime::failed(5)]).restricted_mean(300).unwrap();
        assert_eq!(all_failed.value, Some(4.0));
        assert_eq!(SurvivalCurve::new(&[]).restricted_mean(300), None);
    }

    /// lifelines; the first value, 16.79, is also in Kleinbaum and Klein, "Survival Analysis",
    /// chapter 2.
    #[test]
    fn log_rank_tests_match_lifelines() {
        let a = treated();
        let b = placebo();
        let c = with_budget();
        let two = log_rank(&[&a, &b]).unwrap();
        check(Some(two.chi_squared), 16.792_940_989_216_547);
        check(Some(two.p_value), 4.168_809_109_334_511e-5);
        let three = log_rank(&[&a, &b, &c]).unwrap();
        assert_eq!(three.degrees_of_freedom, 2);
        check(Some(three.chi_squared), 19.706_653_565_492_71);
        check(Some(three.p_value), 5.257_200_612_979_867e-5);
    }

    #[test]
    fn a_log_rank_test_does_not_depend_on_the_order_of_groups_and_needs_two() {
        let a = treated();
        let b = placebo();
        let c = with_budget();
        let first = log_rank(&[&a, &b, &c]).unwrap();
        let second = log_rank(&[&c, &a, &b]).unwrap();
        assert!((first.chi_squared - second.chi_squared).abs() < 1e-9);
        assert_eq!((log_rank(&[&a]), log_rank(&[&a, &[]])), (None, None));
    }
}
