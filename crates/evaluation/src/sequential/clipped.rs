use crate::Estimate;
use crate::betting::{anytime_mean, log_capital_at_any_time};

/// The confidence sequence of a mean difference of pairs of numbers, each clipped to the same
/// bounds: an interval of 95 % that holds at all times together, and a test of "no difference".
///
/// Without bounds there is no such interval: a value that is rare and large enough can move the
/// mean anywhere and be in no sample. So values beyond the bounds count as the bound, and the mean
/// is that of the clipped numbers.
///
/// # Example
/// ```
/// use mishandle_evaluation::ClippedDifferences;
/// let mut differences = ClippedDifferences::new([-1.0, 1.0]);
/// (0..400).for_each(|i| differences.add(f64::from(i % 7) / 10.0, f64::from(i % 7) / 10.0 + 0.2));
/// let found = differences.estimate();
/// assert!((found.value.unwrap() - 0.2).abs() < 1e-9);
/// assert!(found.low.unwrap() > 0.0 && differences.p_value() < 0.05);
/// ```
///
/// # Reference
/// Waudby-Smith and Ramdas, "Estimating means of bounded random variables by betting", Journal of
/// the Royal Statistical Society B 86, 2024: hedged capital with predictable plug-in bets.
#[derive(Clone, Debug, PartialEq)]
pub struct ClippedDifferences {
    bounds: [f64; 2],
    /// Differences, scaled to [0, 1]: 1/2 means that both are equal.
    fractions: Vec<f64>,
}

impl ClippedDifferences {
    /// Makes an empty sequence. The lower bound must be less than the upper one, and both finite.
    pub fn new(bounds: [f64; 2]) -> ClippedDifferences {
        ClippedDifferences { bounds, fractions: Vec::new() }
    }

    /// Adds a pair of numbers, which may be infinite.
    pub fn add(&mut self, first: f64, second: f64) {
        let [low, high] = self.bounds;
        let difference = second.clamp(low, high) - first.clamp(low, high);
        self.fractions.push((0.5 + 0.5 * difference / (high - low)).clamp(0.0, 1.0));
    }

    /// Returns the mean difference, second minus first, with its interval.
    pub fn estimate(&self) -> Estimate {
        let [low, high] = self.bounds;
        let difference = |fraction: f64| (2.0 * fraction - 1.0) * (high - low);
        let found = anytime_mean(&self.fractions);
        Estimate {
            value: found.value.map(difference),
            low: found.low.map(difference),
            high: found.high.map(difference),
            n: found.n,
        }
    }

    /// Returns the p-value of "no difference". It holds at any time, and is at most 0.05 exactly if
    /// the interval excludes 0.
    pub fn p_value(&self) -> f64 {
        (2.0 * (-log_capital_at_any_time(&self.fractions, 0.5)).exp()).min(1.0)
    }
}
