use super::{Remaining, times_ln};
use crate::Estimate;

/// The confidence sequence of a rate: an interval of 95 % that holds at all looks together.
///
/// The capital against the rate p after s successes and f failures is the likelihood ratio of the
/// mixture over Beta(1/2, 1/2) and p:
///
/// ```text
/// K(p) = B(s + 1/2, f + 1/2) / (B(1/2, 1/2) pˢ (1 - p)ᶠ)
/// ```
///
/// The order of the values has no effect on K. The interval is that of the looks so far, so it
/// never widens but to contain the observed rate.
///
/// # Example
/// ```
/// use mishandle_evaluation::RateSequence;
/// let mut rate = RateSequence::default();
/// (0..1000).for_each(|i| rate.add(i % 20 != 0));
/// rate.look();
/// let found = rate.estimate();
/// assert_eq!((found.value, found.n), (Some(0.95), 1000));
/// // Wider than Wilson's interval [0.935, 0.962], which holds for one look only.
/// assert!((found.low.unwrap() - 0.9208).abs() < 1e-4 && (found.high.unwrap() - 0.9713).abs() < 1e-4);
/// ```
///
/// # Reference
/// Robbins, "Statistical methods related to the law of the iterated logarithm", The Annals of
/// Mathematical Statistics 41, 1970. The prior is that of Krichevsky and Trofimov, "The performance
/// of universal encoding", IEEE Transactions on Information Theory 27, 1981.
#[derive(Clone, Debug, PartialEq)]
pub struct RateSequence {
    successes: u64,
    failures: u64,
    /// Logarithm of B(s + 1/2, f + 1/2) / B(1/2, 1/2).
    log_mixture: f64,
    remaining: Remaining,
}

impl Default for RateSequence {
    fn default() -> Self {
        RateSequence {
            successes: 0,
            failures: 0,
            log_mixture: 0.0,
            remaining: Remaining { low: 0.0, high: 1.0 },
        }
    }
}

impl RateSequence {
    /// Adds a value.
    pub fn add(&mut self, is_success: bool) {
        let count = if is_success { &mut self.successes } else { &mut self.failures };
        let earlier = *count as f64;
        *count += 1;
        self.log_mixture += ((earlier + 0.5) / self.n() as f64).ln();
    }

    /// Returns the number of values.
    pub fn n(&self) -> u64 {
        self.successes + self.failures
    }

    /// Returns the logarithm of the capital against the rate `p`.
    pub fn log_capital(&self, p: f64) -> f64 {
        self.log_mixture - times_ln(self.successes, p) - times_ln(self.failures, 1.0 - p)
    }

    /// Excludes the rates against which the capital exceeds 1 / α now.
    pub fn look(&mut self) {
        if self.n() > 0 {
            let mean = self.mean();
            let mut remaining = self.remaining;
            remaining.narrow(mean, |p| self.log_capital(p));
            self.remaining = remaining;
        }
    }

    /// Returns the rate with its interval after the looks so far.
    pub fn estimate(&self) -> Estimate {
        if self.n() == 0 { Estimate::default() } else { self.remaining.estimate(self.mean(), self.n()) }
    }

    fn mean(&self) -> f64 {
        self.successes as f64 / self.n() as f64
    }
}

/// Returns the rate `successes` / `n` with the interval of a [`RateSequence`] that one looks at
/// now: it holds at any time, and needs no history.
///
/// # Example
/// ```
/// use mishandle_evaluation::{anytime_rate, wilson};
/// let (anytime, fixed) = (anytime_rate(95, 100), wilson(95, 100));
/// assert!(anytime.low < fixed.low && anytime.high > fixed.high);
/// assert_eq!(anytime_rate(0, 0).value, None);
/// ```
pub fn anytime_rate(successes: u64, n: u64) -> Estimate {
    let mut rate = RateSequence::default();
    for i in 0..n {
        rate.add(i < successes);
    }
    rate.look();
    rate.estimate()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Integrates the likelihood ratio over the prior on a fine grid: with p = sin²(t), the density
    /// of Beta(1/2, 1/2) is uniform in t.
    fn integrated(successes: u64, failures: u64, p: f64) -> f64 {
        let cells = 20_000;
        let ratio = |cell: u32| {
            let t = std::f64::consts::FRAC_PI_2 * (f64::from(cell) + 0.5) / f64::from(cells);
            let q = t.sin().powi(2);
            (times_ln(successes, q / p) + times_ln(failures, (1.0 - q) / (1.0 - p))).exp()
        };
        (0..cells).map(ratio).sum::<f64>() / f64::from(cells)
    }

    fn sequence(successes: u64, failures: u64) -> RateSequence {
        let mut rate = RateSequence::default();
        (0..successes).for_each(|_| rate.add(true));
        (0..failures).for_each(|_| rate.add(false));
        rate
    }

    #[test]
    fn the_capital_is_the_integral_of_the_likelihood_ratio() {
        for (successes, failures, p) in
            [(0, 1, 0.5), (3, 2, 0.5), (95, 5, 0.9), (1, 40, 0.2), (300, 0, 0.999)]
        {
            let expected = integrated(successes, failures, p);
            let found = sequence(successes, failures).log_capital(p).exp();
            assert!((found / expected - 1.0).abs() < 1e-6, "{successes} and {failures}: {found}, {expected}");
        }
    }

    #[test]
    fn the_expected_capital_stays_1_at_every_time() {
        // The expectation over all sequences of n values with success probability p.
        for p in [0.1, 0.5, 0.97] {
            for n in 1..=14_u64 {
                let mean: f64 = (0..1_u32 << n)
                    .map(|bits| {
                        let successes = u64::from(bits.count_ones());
                        let rate = sequence(successes, n - successes);
                        let chance = times_ln(successes, p) + times_ln(n - successes, 1.0 - p);
                        (rate.log_capital(p) + chance).exp()
                    })
                    .sum();
                assert!((mean - 1.0).abs() < 1e-9, "p = {p}, n = {n}: {mean}");
            }
        }
    }

    #[test]
    fn the_bounds_are_where_the_capital_is_20() {
        for (successes, failures) in [(1, 1), (19, 1), (500, 500), (990, 10)] {
            let mut rate = sequence(successes, failures);
            rate.look();
            let found = rate.estimate();
            for bound in [found.low, found.high].map(|bound| bound.expect("a bound")) {
                let capital = rate.log_capital(bound).exp();
                assert!((capital - 20.0).abs() < 1e-3, "{successes} and {failures}: {capital}");
            }
        }
        // Without a failure, 1 cannot be excluded.
        let found = anytime_rate(300, 300);
        assert_eq!(found.high, Some(1.0));
    }

    #[test]
    fn looks_only_narrow_the_interval_and_it_contains_the_observed_rate() {
        let mut rate = RateSequence::default();
        let mut last = rate.estimate();
        // Values that drift: first failures only, then successes.
        for i in 0..400 {
            rate.add(i >= 40);
            rate.look();
            let found = rate.estimate();
            let value = found.value.expect("a rate");
            assert!(found.low <= Some(value) && Some(value) <= found.high, "{found:?}");
            let is_inside = last.low.is_none_or(|low| found.low >= Some(low.min(value)));
            assert!(is_inside, "{last:?}, then {found:?}");
            last = found;
        }
        assert!(last.high.expect("a bound") < 1.0);
    }
}
