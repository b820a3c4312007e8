//! Statistics that hold at any time: one may look after every simulation, and stop when one likes.
//!
//! An interval for a fixed number of simulations misses the true value in 5 % of all samples. Who
//! looks after each batch and stops when the interval is convenient misses it more often. The
//! interval of a confidence sequence contains the true value **at all looks together** with a
//! probability of at least 95 %.
//!
//! All sequences here come from capitals. For each candidate value m, somebody bets against m with
//! capital 1. If m is the true value, the capital is a nonnegative martingale, so it ever exceeds
//! 1 / α with a probability of at most α (Ville's inequality). The interval consists of the m
//! against which the capital never exceeded 1 / α at a look, and 1 / (largest capital at a look) is
//! a p-value that holds at any time.
//!
//! | sequence | values | bets |
//! |---|---|---|
//! | [`RateSequence`] | 0 or 1 | mixture over Beta(1/2, 1/2): the beta-binomial |
//! | [`DifferenceSequence`] | -1, 0 or 1: pairs of verdicts | mixture over an arcsine grid of fixed bets |
//! | [`ClippedDifferences`] | differences of numbers in stated bounds | predictable bets, hedged |
//!
//! # References
//! - Ville, "Étude critique de la notion de collectif", 1939.
//! - Robbins, "Statistical methods related to the law of the iterated logarithm", The Annals of
//!   Mathematical Statistics 41, 1970: mixtures.
//! - Howard, Ramdas, McAuliffe and Sekhon, "Time-uniform, nonparametric, nonasymptotic confidence
//!   sequences", The Annals of Statistics 49, 2021.
//! - Waudby-Smith and Ramdas, "Estimating means of bounded random variables by betting", Journal of
//!   the Royal Statistical Society B 86, 2024.

mod clipped;
mod difference;
mod rate;
mod rule;
mod size;

pub use clipped::ClippedDifferences;
pub use difference::DifferenceSequence;
pub use rate::{RateSequence, anytime_rate};
pub use rule::StopRule;
pub use size::{SizeSettings, Sizes, pair_size, rate_size};

use crate::Estimate;

/// Error probability α of all intervals and tests here.
const ALPHA: f64 = 0.05;

/// Number of bisections of each bound; it is then too wide by at most 2^-27.
const BISECTIONS: u32 = 28;

/// Returns ln(1 / α): a capital whose logarithm exceeds it excludes its candidate.
fn log_threshold() -> f64 {
    -ALPHA.ln()
}

/// The candidates that no look has excluded: the running intersection of the intervals of all
/// looks.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Remaining {
    low: f64,
    high: f64,
}

impl Remaining {
    /// Removes the candidates against which the capital exceeds 1 / α now. `log_capital` must be
    /// convex with a minimum of at most 0 at the observed mean.
    fn narrow(&mut self, mean: f64, log_capital: impl Fn(f64) -> f64) {
        let is_excluded = |m: f64| log_capital(m) >= log_threshold();
        let edge = |mut excluded: f64| {
            let mut included = mean;
            for _ in 0..BISECTIONS {
                let m = 0.5 * (excluded + included);
                if is_excluded(m) { excluded = m } else { included = m }
            }
            excluded
        };
        if mean > self.low && is_excluded(self.low) {
            self.low = edge(self.low).min(self.high);
        }
        if mean < self.high && is_excluded(self.high) {
            // A drift of the values can exclude everything. One point remains then.
            self.high = edge(self.high).max(self.low);
        }
    }

    /// Returns the interval, widened to the observed mean where early looks have excluded that.
    fn estimate(self, mean: f64, n: u64) -> Estimate {
        Estimate { value: Some(mean), low: Some(self.low.min(mean)), high: Some(self.high.max(mean)), n }
    }
}

/// Returns `count` times the logarithm of `x`; 0 if `count` is 0, also for x = 0.
fn times_ln(count: u64, x: f64) -> f64 {
    if count == 0 { 0.0 } else { count as f64 * x.ln() }
}
