//! Exact interval of a rate whose number of trials depends on the first of them.

use crate::beta::Beta;
use crate::{Estimate, clopper_pearson};

/// Bisections, each of which halves the error of a bound.
const BISECTIONS: usize = 100;

/// The decision of a measurement with two stages: with at least `threshold` successes in the first
/// `first` trials, it continues with more trials than without.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TwoStage {
    /// Number of trials of the first stage.
    pub first: u64,
    /// Number of successes that the decision needs.
    pub threshold: u64,
    /// Whether the first stage has them.
    pub is_reached: bool,
}

/// Returns the rate `successes` / `n` of a measurement with two stages, with an interval that
/// contains the true rate with a probability of at least `confidence`, whatever the decision was.
/// `n` counts the trials of both stages; it must not depend on them otherwise.
///
/// [`clopper_pearson`] assumes that n was fixed before. Here it misses too often around threshold /
/// first: an n that is large after many successes misses above, and one that is small after few
/// misses below. This interval orders all outcomes, those without the threshold before those with
/// it, and each group by its successes. Its bounds are the rates at which the outcomes up to the
/// observed one, or from it on, have the probability (1 - `confidence`) / 2. With the threshold,
/// only the upper bound differs from Clopper and Pearson's, and without it only the lower one, if n
/// is larger than the first stage.
///
/// # Example
/// ```
/// use mishandle_evaluation::{TwoStage, clopper_pearson, two_stage};
/// // 20 successes in the first 100 trials were enough to go on.
/// let stages = TwoStage { first: 100, threshold: 20, is_reached: true };
/// let (rate, fixed) = (two_stage(30, 400, stages, 0.95), clopper_pearson(30, 400, 0.95));
/// assert!(rate.low == fixed.low && rate.high > fixed.high);
/// // Far from the decision, the intervals are equal.
/// let (rate, fixed) = (two_stage(200, 400, stages, 0.95), clopper_pearson(200, 400, 0.95));
/// assert!((rate.high.unwrap() - fixed.high.unwrap()).abs() < 1e-9);
/// ```
///
/// # Reference
/// Jennison and Turnbull, "Group Sequential Methods with Applications to Clinical Trials", 2000,
/// section 12.1 (stage-wise ordering).
pub fn two_stage(successes: u64, n: u64, stages: TwoStage, confidence: f64) -> Estimate {
    let fixed = clopper_pearson(successes, n, confidence);
    let (Some(low), Some(high)) = (fixed.low, fixed.high) else { return fixed };
    if n <= stages.first {
        return fixed;
    }
    let tail = 0.5 * (1.0 - confidence);
    if stages.is_reached {
        let joint = Joint::new(stages, n, successes);
        // Falls with the rate.
        let high = bisect(high, 1.0, |p| joint.below_threshold(p) + joint.reached_and_at_most(p) > tail);
        Estimate { high: Some(high), ..fixed }
    } else if successes > 0 {
        let joint = Joint::new(stages, n, successes - 1);
        // Rises with the rate.
        let low = bisect(0.0, low, |p| 1.0 - joint.below_threshold_and_at_most(p) < tail);
        Estimate { low: Some(low), ..fixed }
    } else {
        fixed
    }
}

/// Returns the end of the part of an interval in which `is_before` holds.
fn bisect(mut low: f64, mut high: f64, is_before: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..BISECTIONS {
        let middle = f64::midpoint(low, high);
        if is_before(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    high
}

/// Successes of the first stage, of the second one, and of both up to a count.
struct Joint {
    stages: TwoStage,
    both: Binomial,
    second: Binomial,
    count: u64,
}

impl Joint {
    fn new(stages: TwoStage, n: u64, count: u64) -> Joint {
        Joint {
            stages,
            both: Binomial::new(n, count),
            second: Binomial::new(n - stages.first, count.min(n - stages.first)),
            count,
        }
    }

    /// Returns the probability that the first stage does not reach the threshold.
    fn below_threshold(&self, p: f64) -> f64 {
        self.first(p).sum()
    }

    /// Returns the probability that it does not, and both stages have at most `count` successes.
    fn below_threshold_and_at_most(&self, p: f64) -> f64 {
        // P(second <= count - k) for k = 0, 1, ..., from that for the largest of these numbers.
        let mut at_most = self.second.at_most(p);
        let mut probability = self.second.probability(p);
        let mut next = self.second.count;
        let mut sum = 0.0;
        for (k, first) in (0..=self.count).zip(self.first(p)) {
            let limit = self.count - k;
            if limit < next {
                at_most -= probability;
                probability *= next as f64 / (self.second.n - limit) as f64 * (1.0 - p) / p;
                next = limit;
            }
            sum += first * at_most.max(0.0);
        }
        sum
    }

    fn reached_and_at_most(&self, p: f64) -> f64 {
        (self.both.at_most(p) - self.below_threshold_and_at_most(p)).max(0.0)
    }

    /// Returns the probabilities of 0 successes in the first stage, of 1, and so on up to the
    /// threshold.
    fn first(&self, p: f64) -> impl Iterator<Item = f64> {
        let TwoStage { first: n, threshold, .. } = self.stages;
        let odds = p / (1.0 - p);
        let none = (n as f64 * (-p).ln_1p()).exp();
        let next = move |before: &mut f64, k: u64| {
            let own = *before;
            *before *= (n - k) as f64 / (k + 1) as f64 * odds;
            Some(own)
        };
        (0..threshold.min(n + 1)).scan(none, next)
    }
}

/// The number of successes in n trials, at one count.
struct Binomial {
    n: u64,
    count: u64,
    /// The beta distribution with the parameters n - count and count + 1, which is below 1 - p with
    /// the probability of at most `count` successes; `None` if `count` is n.
    beta: Option<Beta>,
}

impl Binomial {
    fn new(n: u64, count: u64) -> Binomial {
        let beta = (count < n).then(|| Beta::new(2 * (n - count) as u32, 2 * (count + 1) as u32));
        Binomial { n, count, beta }
    }

    /// Returns the probability of at most `count` successes.
    fn at_most(&self, p: f64) -> f64 {
        self.beta.as_ref().map_or(1.0, |beta| beta.below(1.0 - p))
    }

    /// Returns the probability of `count` successes.
    fn probability(&self, p: f64) -> f64 {
        let count = self.count as f64;
        let Some(beta) = &self.beta else { return p.powf(count) };
        let others = (self.n - self.count) as f64;
        (count * p.ln() + others * (-p).ln_1p() - beta.ln_beta).exp() / others
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STAGES: TwoStage = TwoStage { first: 12_500, threshold: 20, is_reached: true };

    /// SciPy 1.17.1: `brentq` of
    /// `binom.cdf(f, n, p) + sum(binom.pmf(k, first, p) * binom.sf(f - k, n - first, p) for k in range(20)) - 0.025`
    /// for the upper bounds, and of
    /// `binom.sf(19, first, p) + sum(binom.pmf(k, first, p) * binom.sf(f - 1 - k, n - first, p) for k in range(20)) - 0.025`
    /// for the lower ones.
    #[test]
    fn bounds_are_those_of_scipy() {
        let check = |found: Option<f64>, expected: f64| {
            let found = found.unwrap();
            assert!((found / expected - 1.0).abs() < 1e-6, "{found} and {expected}");
        };
        for (failures, expected) in [
            (20, 0.002_372_655_050_274_237),
            (60, 0.002_372_655_051_541_004_5),
            (100, 0.002_490_840_320_124_251),
            (150, 0.003_519_467_780_398_251_3),
            (400, 0.008_820_092_584_170_153),
        ] {
            check(two_stage(failures, 50_000, STAGES, 0.95).high, expected);
        }
        let passed = TwoStage { is_reached: false, ..STAGES };
        for (failures, expected) in [
            (1, 7.790_091_730_118_866e-7),
            (19, 0.000_352_012_185_698_939_9),
            (40, 0.000_865_190_297_236_957_4),
            (60, 0.000_977_583_536_672_864_3),
        ] {
            check(two_stage(failures, 32_500, passed, 0.95).low, expected);
        }
    }

    #[test]
    fn the_first_stage_alone_and_impossible_decisions_have_the_interval_of_clopper_and_pearson() {
        for is_reached in [true, false] {
            let stages = TwoStage { is_reached, ..STAGES };
            assert_eq!(two_stage(30, 12_500, stages, 0.95), clopper_pearson(30, 12_500, 0.95));
        }
        // No threshold: every outcome continues.
        let always = TwoStage { first: 100, threshold: 0, is_reached: true };
        let found = two_stage(7, 400, always, 0.95);
        let fixed = clopper_pearson(7, 400, 0.95);
        assert!((found.high.unwrap() - fixed.high.unwrap()).abs() < 1e-9);
        assert_eq!(two_stage(0, 0, STAGES, 0.95), Estimate::default());
        assert_eq!(two_stage(400, 400, TwoStage { first: 100, ..STAGES }, 0.95).high, Some(1.0));
    }

    /// Sums the outcomes exactly: no simulation.
    #[test]
    fn the_interval_covers_every_rate_where_that_of_a_fixed_number_does_not() {
        let fixed = Rule::new(|f, n, _| clopper_pearson(f, n, 0.95));
        let ordered = Rule::new(|f, n, stages| two_stage(f, n, stages, 0.95));
        for step in 0..60 {
            let p = 0.01 * 30.0_f64.powf(f64::from(step) / 59.0);
            for less in 0..LESS.len() {
                let covered = ordered.coverage(p, less);
                assert!(covered >= 0.95, "{covered} at {p}, {less}");
            }
        }
        // SciPy 1.17.1: the same sums of `binom.pmf`, with bounds from `beta.ppf`.
        for (p, expected) in [(0.1, 0.949_130_439), (0.116, 0.941_516_393), (0.13, 0.948_190_704)] {
            assert!((fixed.coverage(p, 0) - expected).abs() < 1e-8, "{p}");
        }
    }

    /// 20 failures in 25 % of 1000 simulations decide that the others are run. Without them, these
    /// numbers are run.
    const FIRST: u64 = 250;
    const THRESHOLD: u64 = 20;
    const WHOLE: u64 = 1000;
    const LESS: [u64; 3] = [250, 550, 900];

    /// Intervals by number of failures: with the threshold, and without it for each of [`LESS`].
    struct Rule {
        reached: Vec<[f64; 2]>,
        passed: Vec<Vec<[f64; 2]>>,
    }

    impl Rule {
        fn new(interval: impl Fn(u64, u64, TwoStage) -> Estimate) -> Rule {
            let all = |n: u64, is_reached| {
                let stages = TwoStage { first: FIRST, threshold: THRESHOLD, is_reached };
                let bounds = |f| {
                    let found = interval(f, n, stages);
                    [found.low.unwrap(), found.high.unwrap()]
                };
                // More than 500 failures of 1000 have a negligible probability.
                (0..=n.min(500)).map(bounds).collect::<Vec<_>>()
            };
            Rule { reached: all(WHOLE, true), passed: LESS.iter().map(|n| all(*n, false)).collect() }
        }

        /// Returns the probability that the interval contains p.
        fn coverage(&self, p: f64, less: usize) -> f64 {
            let stage = probabilities(FIRST, p);
            let sum = |intervals: &[[f64; 2]], ks: std::ops::Range<u64>, n: u64| {
                let second = probabilities(n - FIRST, p);
                let contains =
                    |f: u64| intervals.get(f as usize).is_some_and(|[low, high]| (*low..=*high).contains(&p));
                let of_rest = |k: u64| {
                    let rest = (0..).zip(&second).filter(|(rest, _)| contains(k + rest));
                    rest.map(|(_, probability)| probability).sum::<f64>()
                };
                ks.map(|k| stage[k as usize] * of_rest(k)).sum::<f64>()
            };
            sum(&self.reached, THRESHOLD..FIRST + 1, WHOLE)
                + sum(&self.passed[less], 0..THRESHOLD, LESS[less])
        }
    }

    /// Returns the probabilities of 0 to n successes, from the logarithms of factorials.
    fn probabilities(n: u64, p: f64) -> Vec<f64> {
        let mut logs = vec![0.0];
        logs.extend((1..=n).scan(0.0, |sum, k| {
            *sum += (k as f64).ln();
            Some(*sum)
        }));
        let log = |k: u64| logs[n as usize] - logs[k as usize] - logs[(n - k) as usize];
        (0..=n).map(|k| (log(k) + k as f64 * p.ln() + (n - k) as f64 * (-p).ln_1p()).exp()).collect()
    }
}
