//! Confidence interval of the mean of numbers in [0, 1], valid for every distribution and every
//! sample size.

use crate::Estimate;

/// Error probability α of [`betting_mean`].
const ALPHA: f64 = 0.05;

/// Largest bet, as a fraction of the bet that can lose the whole capital.
const LARGEST_BET: f64 = 0.75;

/// Number of bisections of each bound; their error is at most 2^-40.
const BISECTIONS: u32 = 40;

/// Returns the mean of `fractions`, numbers in [0, 1], with its betting interval (hedged capital)
/// of 95 %.
///
/// The interval contains the mean of the distribution with a probability of at least 0.95
/// for **every** distribution on [0, 1] and every n, because it follows from Ville's inequality and
/// not from an approximation. In particular it holds if all values are 0, and if few simulations
/// contain all dangerous steps, where the percentile bootstrap fails: its interval has width 0 or
/// ends at the largest resample of what was seen.
///
/// For each candidate mean m, two players bet against m with capital 1/2 each. One wins if the mean
/// is above m, the other if it is below:
///
/// ```text
/// K⁺ₜ(m) = Π (1 + min(λᵢ, c / m) (xᵢ - m)),   K⁻ₜ(m) = Π (1 - min(λᵢ, c / (1 - m)) (xᵢ - m)),   i = 1 ... t
/// λᵢ     = sqrt(2 ln(2 / α) / (n σ²ᵢ₋₁)),      c = 3/4
/// σ²ᵢ    = (1/4 + Σ (xⱼ - μⱼ)²) / (i + 1),     μᵢ = (1/2 + Σ xⱼ) / (i + 1)
/// ```
///
/// If m is the mean, each capital is a nonnegative martingale, so it exceeds 2 / α at any time t
/// with a probability of at most α / 2. The interval consists of the m against which neither
/// capital ever exceeds 2 / α. K⁺ falls and K⁻ rises with m, so bisection finds both bounds.
///
/// The values are bets in the order of the slice, so the interval depends on the order (in an
/// evaluation, that of the simulations). It needs no random numbers. 10,000 values take a few
/// milliseconds.
///
/// # Example
/// ```
/// use mishandle_evaluation::betting_mean;
/// let estimate = betting_mean(&[0.0; 1000]);
/// assert_eq!((estimate.value, estimate.low), (Some(0.0), Some(0.0)));
/// // (1 + 3/4 m)^1000 = 2 / 0.05, about ln(40) / 750
/// assert!((estimate.high.unwrap() - 0.0049).abs() < 0.0001);
/// ```
///
/// # Reference
/// Waudby-Smith and Ramdas, "Estimating means of bounded random variables by betting", Journal of
/// the Royal Statistical Society B 86, 2024: hedged capital with the predictable plug-in bets for a
/// fixed n.
pub fn betting_mean(fractions: &[f64]) -> Estimate {
    betting_mean_at(fractions, 1.0 - ALPHA)
}

/// Returns the mean of `fractions` with its betting interval of another confidence: see
/// [`betting_mean`].
pub fn betting_mean_at(fractions: &[f64], confidence: f64) -> Estimate {
    let log_threshold = (2.0 / (1.0 - confidence)).ln();
    let n = fractions.len() as u64;
    if n == 0 {
        return Estimate::default();
    }
    interval(fractions, &bets(fractions, log_threshold, |_| n as f64), log_threshold)
}

/// Returns the mean of `fractions` with a betting interval of 95 % that holds at any time: the
/// number of values need not be fixed beforehand.
///
/// The bets are those of [`betting_mean`] with n σ² replaced by i ln(i + 1) σ², so that bet i does
/// not depend on n. The interval after more values is a part of it, but for an observed mean that
/// early values excluded.
pub(crate) fn anytime_mean(fractions: &[f64]) -> Estimate {
    let log_threshold = (2.0 / ALPHA).ln();
    if fractions.is_empty() {
        Estimate::default()
    } else {
        interval(fractions, &bets(fractions, log_threshold, any_time), log_threshold)
    }
}

/// Returns the logarithm of the largest capital that any of the two players of [`anytime_mean`]
/// ever had against the mean `m`.
pub(crate) fn log_capital_at_any_time(fractions: &[f64], m: f64) -> f64 {
    let bets = bets(fractions, (2.0 / ALPHA).ln(), any_time);
    let mirrored: Vec<f64> = fractions.iter().map(|x| 1.0 - x).collect();
    log_largest_capital(fractions, &bets, m).max(log_largest_capital(&mirrored, &bets, 1.0 - m))
}

/// Takes the place of n in bet i if n is not known: i ln(i + 1).
fn any_time(i: f64) -> f64 {
    i * i.ln_1p()
}

/// Returns the mean with the interval of the means against which no capital ever exceeds the
/// threshold.
fn interval(fractions: &[f64], bets: &[f64], log_threshold: f64) -> Estimate {
    let n = fractions.len() as u64;
    let mean = (fractions.iter().sum::<f64>() / n as f64).clamp(0.0, 1.0);
    let mirrored: Vec<f64> = fractions.iter().map(|x| 1.0 - x).collect();
    // The observed mean belongs to the interval even if an early drift of the values excludes it.
    let low = lower_bound(fractions, bets, log_threshold).min(mean);
    let high = (1.0 - lower_bound(&mirrored, bets, log_threshold)).max(mean);
    Estimate { value: Some(mean), low: Some(low), high: Some(high), n }
}

/// Returns the bets λᵢ before they are limited by c / m. `horizon` returns the number of values
/// that bet i prepares for, i counted from 1.
fn bets(fractions: &[f64], log_threshold: f64, horizon: impl Fn(f64) -> f64) -> Vec<f64> {
    let mut sum = 0.5;
    let mut squares = 0.25;
    let mut variance = 0.25;
    (2_u32..)
        .zip(fractions)
        .map(|(count, x)| {
            let bet = (2.0 * log_threshold / (horizon(f64::from(count - 1)) * variance)).sqrt();
            sum += x;
            squares += (x - sum / f64::from(count)).powi(2);
            variance = squares / f64::from(count);
            bet
        })
        .collect()
}

/// Returns the logarithm of the largest K⁺ against the mean `m`, at least that of the capital 1 at
/// the start.
fn log_largest_capital(fractions: &[f64], bets: &[f64], m: f64) -> f64 {
    let mut log_capital = 0.0_f64;
    let mut largest = 0.0_f64;
    for (x, bet) in fractions.iter().zip(bets) {
        log_capital += (bet.min(LARGEST_BET / m) * (x - m)).ln_1p();
        largest = largest.max(log_capital);
    }
    largest
}

/// Returns the largest m against which the capital K⁺ exceeds 2 / α at some time, or 0.
///
/// The upper bound of a mean is 1 minus the lower bound of the mirrored values 1 - x, because K⁻ of
/// x at m is K⁺ of 1 - x at 1 - m, and both have the same bets.
fn lower_bound(fractions: &[f64], bets: &[f64], log_threshold: f64) -> f64 {
    let is_excluded = |m: f64| {
        let mut log_capital = 0.0;
        fractions.iter().zip(bets).any(|(x, bet)| {
            log_capital += (bet.min(LARGEST_BET / m) * (x - m)).ln_1p();
            log_capital > log_threshold
        })
    };
    let mut excluded = 0.0;
    let mut included = 1.0;
    for _ in 0..BISECTIONS {
        let m = 0.5 * (excluded + included);
        if is_excluded(m) { excluded = m } else { included = m }
    }
    excluded
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(values: &[f64], low: f64, high: f64) {
        let found = betting_mean(values);
        let close = |found: Option<f64>, expected: f64| (found.unwrap() - expected).abs() < 1e-9;
        assert!(close(found.low, low) && close(found.high, high), "{found:?}, expected [{low}, {high}]");
    }

    #[test]
    fn the_interval_of_few_equal_values_matches_a_hand_calculation() {
        // Four zeros: the first bet sqrt(2 ln 40 / (4 / 4)) = 2.7 exceeds 3/4 / (1 - m) for m <
        // 0.72, later ones too. So (1 + 3/4 m / (1 - m))^4 = 40.
        let odds = (40.0_f64.powf(0.25) - 1.0) / 0.75;
        let high = odds / (1.0 + odds);
        check(&[0.0; 4], 0.0, high);
        check(&[1.0; 4], 1.0 - high, 1.0);
        // One zero: the bet sqrt(2 ln 40 / (1 / 4)) = 5.4 never multiplies the capital by 40.
        check(&[0.0], 0.0, 1.0);
    }

    /// The bounds come from a program in Python that multiplies the capitals on a grid of 20,000
    /// means, without logarithms, mirrored values or bisection.
    #[test]
    fn the_interval_matches_a_grid_search() {
        let grid = |values: &[f64], [low, high]: [f64; 2]| {
            let found = betting_mean(values);
            let close = |found: Option<f64>, expected: f64| (found.unwrap() - expected).abs() < 1e-4;
            assert!(close(found.low, low) && close(found.high, high), "{found:?}, expected [{low}, {high}]");
        };
        grid(
            &(1..=40).map(|i| f64::from(i * 7919 % 101) / 101.0 * 0.3).collect::<Vec<_>>(),
            [0.1061, 0.2495],
        );
        let clustered: Vec<f64> = (0..60).map(|i| if i % 9 == 4 { 0.5 } else { 0.02 }).collect();
        grid(&clustered, [0.02875, 0.15535]);
        grid(&[0.0; 100], [0.0, 0.0479]);
    }

    #[test]
    fn the_interval_of_zeros_is_close_to_the_exact_bound() {
        for n in [100, 1000, 10_000] {
            // No interval can end below 1 - 0.025^(1/n), about ln(40) / n. Bets of at most 3/4
            // reach 4/3 of it, and early bets are smaller.
            let exact = 1.0 - 0.025_f64.powf(1.0 / f64::from(n));
            let high = betting_mean(&vec![0.0; n as usize]).high.unwrap();
            assert!((1.0..1.4).contains(&(high / exact)), "{n}: {high}");
        }
    }

    #[test]
    fn the_interval_contains_the_mean_whatever_the_order() {
        for n in 1..60 {
            for ones in 0..=n {
                let rising: Vec<f64> = (0..n).map(|i| f64::from(u8::from(i >= n - ones))).collect();
                let falling: Vec<f64> = rising.iter().rev().copied().collect();
                for values in [rising, falling] {
                    let Estimate { value, low, high, .. } = betting_mean(&values);
                    let value = value.unwrap();
                    let low = low.unwrap();
                    let high = high.unwrap();
                    assert!(0.0 <= low && low <= value && value <= high && high <= 1.0, "{values:?}");
                    assert!(low < high, "{ones} of {n}");
                }
            }
        }
    }

    #[test]
    fn an_empty_sample_has_no_mean() {
        assert_eq!(betting_mean(&[]), Estimate::default());
    }
}
