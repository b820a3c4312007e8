//! The curve of missed failures and false alarms over all thresholds, and the choice on it.

use mishandle_evaluation::vargha_delaney;
use mishandle_results::{Estimate, GuardCurvePoint};

use super::alarm::Watched;

/// Largest number of digits of a chosen threshold. 17 digits tell all numbers apart.
const DIGITS: usize = 17;

/// The least robustness of a guard's formula in failures, until each is certain, and in successes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Least {
    /// One number per failure.
    pub failures: Vec<f64>,
    /// One number per success.
    pub successes: Vec<f64>,
}

impl Least {
    /// Collects the numbers of simulations.
    pub(super) fn of(watched: &[Watched]) -> Least {
        let least = |fails: bool| {
            let of_kind = watched.iter().filter(|found| found.fails == fails);
            of_kind.map(|found| found.least).collect()
        };
        Least { failures: least(true), successes: least(false) }
    }

    /// Returns the curve from the threshold without an alarm to that with an alarm in every
    /// simulation: one point between each two neighbors of the observed values. `threshold` is
    /// in the middle between them, -∞ in the first point.
    pub fn curve(&self) -> Vec<GuardCurvePoint> {
        let mut observed: Vec<f64> = self.failures.iter().chain(&self.successes).copied().collect();
        observed.sort_by(f64::total_cmp);
        observed.dedup();
        let failures = sorted(&self.failures);
        let successes = sorted(&self.successes);
        let below = |values: &[f64], limit: f64| values.partition_point(|value| *value <= limit) as u64;
        let point = |threshold: f64, last: f64| GuardCurvePoint {
            threshold: threshold.into(),
            missed: self.failures.len() as u64 - below(&failures, last),
            false_alarms: below(&successes, last),
        };
        let mut points = vec![point(f64::NEG_INFINITY, f64::NEG_INFINITY)];
        for (index, value) in observed.iter().enumerate() {
            let next = observed.get(index + 1).copied().unwrap_or(value + value.abs().max(1.0));
            let threshold = between(*value, next);
            // Neighbors among the floating-point numbers have nothing between them.
            points.extend(threshold.map(|threshold| point(threshold, *value)));
        }
        points
    }

    /// Returns the point of the curve with the fewest missed failures among those whose share of
    /// successes with an alarm is at most `false_alarms`; of equal ones the lowest threshold.
    pub fn choose(&self, false_alarms: f64) -> GuardCurvePoint {
        let allowed = false_alarms * self.successes.len() as f64;
        let curve = self.curve();
        let best = curve.iter().filter(|point| point.false_alarms as f64 <= allowed);
        // `min_by_key` returns the first of equal points. The first point has no false alarm.
        best.min_by_key(|point| point.missed).copied().unwrap_or(curve[0])
    }

    /// Returns the probability that a failure has a lower value than a success: the area under the
    /// curve of caught failures over false alarms.
    pub fn area(&self) -> Estimate {
        vargha_delaney(&self.successes, &self.failures)
    }
}

fn sorted(values: &[f64]) -> Vec<f64> {
    let mut values = values.to_vec();
    values.sort_by(f64::total_cmp);
    values
}

/// Returns a sum of short numbers without the digits of its rounding error.
pub(super) fn short(sum: f64) -> f64 {
    format!("{sum:.12e}").parse().unwrap_or(sum)
}

/// Returns the middle between two numbers, with as few digits as it takes to be strictly between
/// them; `None` if no number is.
fn between(low: f64, high: f64) -> Option<f64> {
    let middle = low + 0.5 * (high - low);
    (0..DIGITS)
        .filter_map(|digits| format!("{middle:.digits$e}").parse::<f64>().ok())
        .find(|rounded| low < *rounded && *rounded < high)
}

#[cfg(test)]
mod tests {
    use mishandle_random::Sequence;

    use super::*;

    fn least(failures: &[f64], successes: &[f64]) -> Least {
        Least { failures: failures.to_vec(), successes: successes.to_vec() }
    }

    fn counts(least: &Least, threshold: f64) -> (u64, u64) {
        let count = |values: &[f64], has: fn(f64, f64) -> bool| {
            values.iter().filter(|value| has(**value, threshold)).count() as u64
        };
        (count(&least.failures, |value, t| value >= t), count(&least.successes, |value, t| value < t))
    }

    #[test]
    fn a_perfect_predictor_misses_nothing_without_a_false_alarm() {
        let found = least(&[-3.0, -1.0, -2.0], &[0.5, 2.0]).choose(0.0);
        assert_eq!((found.missed, found.false_alarms), (0, 0));
        assert!(-1.0 < found.threshold.0 && found.threshold.0 < 0.5);
    }

    #[test]
    fn a_useless_predictor_has_no_alarm() {
        let useless = least(&[2.0, 3.0], &[0.5, 1.0]);
        let found = useless.choose(0.2);
        assert_eq!((found.threshold.0, found.missed, found.false_alarms), (f64::NEG_INFINITY, 2, 0));
        assert_eq!(useless.area().value, Some(0.0));
    }

    #[test]
    fn every_point_of_the_curve_has_the_counts_of_its_threshold_and_the_choice_is_the_best_one() {
        let mut sequence = Sequence::new(4, 0);
        for sample in 0..200 {
            // Ties within and between both groups.
            let mut values = |count: u64| -> Vec<f64> {
                (0..count).map(|_| sequence.below(12) as f64 / 8.0 - 0.5).collect()
            };
            let least = Least { failures: values(sample % 7 + 1), successes: values(sample % 11 + 1) };
            for point in least.curve() {
                assert_eq!(
                    counts(&least, point.threshold.0),
                    (point.missed, point.false_alarms),
                    "{least:?}"
                );
            }
            let allowed = 0.3;
            let found = least.choose(allowed);
            for step in -100..=200 {
                let threshold = f64::from(step) / 100.0 + 0.001;
                let (missed, false_alarms) = counts(&least, threshold);
                if false_alarms as f64 <= allowed * least.successes.len() as f64 {
                    assert!(found.missed <= missed, "{threshold}: {least:?}");
                    let observed = least.failures.iter().chain(&least.successes);
                    // A lower threshold as good as the chosen one has the same alarms.
                    let is_equal = threshold >= found.threshold.0
                        || missed > found.missed
                        || observed.into_iter().all(|x| (*x < threshold) == (*x < found.threshold.0));
                    assert!(is_equal, "{threshold}: {least:?}");
                }
            }
        }
    }

    #[test]
    fn a_threshold_has_few_digits_and_is_between() {
        assert_eq!(between(0.0, 1.0), Some(0.5));
        assert_eq!(between(0.1234, 0.1238), Some(0.1236));
        let next = f64::from_bits(1.0_f64.to_bits() + 1);
        assert_eq!(between(1.0, next), None);
        assert!(between(-1e9, -1e9 + 1e-3).is_some_and(|x| -1e9 < x && x < -1e9 + 1e-3));
    }
}
