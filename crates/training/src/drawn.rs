//! Numbers of actions drawn from a Gaussian whose range is cut to [-1, 1], the logarithms of their densities, and how both
//! move with the policy's outputs.

use std::f64::consts::LN_2;

use mishandle_controllers::squashed::{log_std, log_std_slope};

use crate::gaussian::HALF_LOG_TAU;

/// Between which log σ of a clipped number is kept, as skrl does.
pub const CLIPPED_LOG_STD_RANGE: (f64, f64) = (-20.0, 2.0);

/// One number of an action, drawn with a fixed standard normal number z.
///
/// ```text
/// squashed:  u = μ + σ(h) z,   a = tanh u,            log π(a) = -½ z² - log σ - ½ log 2π - log(1 - a²)
/// clipped:   u = μ + σ z,      a = clip(u, -1, 1),    log π(a) = -½ ((a - μ) / σ)² - log σ - ½ log 2π
/// ```
///
/// Squashed, μ and h are outputs of the policy's network, and σ(h) is that of [`mishandle_controllers::squashed`]. The last
/// term, the Jacobian's, is computed as log(1 - tanh² u) = 2 (log 2 - |u| - log(1 + t)), t = e^(-2|u|), which is exact where
/// a is ±1 to the last bit.
///
/// Clipped, the density is that of the normal distribution before clipping, at the clipped number: no density of a, but what
/// skrl's SAC learns with.
///
/// # Example
/// ```
/// use mishandle_training::drawn::Drawn;
/// // μ = 0, z = 0: a = 0, and the density is that of the normal distribution, squashed with σ = e^-1.5.
/// let half_log_tau = 0.5 * std::f64::consts::TAU.ln();
/// let squashed = Drawn::squashed(0.0, 0.0, 0.0);
/// assert_eq!(squashed.action, 0.0);
/// assert!((squashed.log_prob - (1.5 - half_log_tau)).abs() < 1e-15);
/// // μ = 0.5, σ = 1, z = 3: a = 1, half a deviation from μ.
/// let clipped = Drawn::clipped(0.5, 0.0, 3.0);
/// assert_eq!(clipped.action, 1.0);
/// assert!((clipped.log_prob - (-0.125 - half_log_tau)).abs() < 1e-15);
/// ```
///
/// # Reference
/// Haarnoja et al., "Soft Actor-Critic Algorithms and Applications", 2018, appendix C.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drawn {
    /// a
    pub action: f64,
    /// log π(a)
    pub log_prob: f64,
    /// ∂a/∂u
    slope: f64,
    /// ∂log π(a)/∂μ
    log_prob_slope: f64,
    /// u - μ squashed, a - μ clipped
    deviation: f64,
    /// Derivative of log σ by what it is made of.
    log_std_slope: f64,
}

impl Drawn {
    /// The squashed number for the network's outputs `mean` and `output`, and `z`.
    pub fn squashed(mean: f64, output: f64, z: f64) -> Drawn {
        let log_std = log_std(output);
        let deviation = log_std.exp() * z;
        let u = mean + deviation;
        let t_minus_1 = (-2.0 * u.abs()).exp_m1();
        let t = t_minus_1 + 1.0;
        let log_slope = 2.0 * (LN_2 - u.abs() - t.ln_1p());
        let action = (-t_minus_1 / (1.0 + t)).copysign(u);
        Drawn {
            action,
            log_prob: -0.5 * z * z - log_std - HALF_LOG_TAU - log_slope,
            slope: 4.0 * t / ((1.0 + t) * (1.0 + t)),
            log_prob_slope: 2.0 * action,
            deviation,
            log_std_slope: log_std_slope(output),
        }
    }

    /// The clipped number for `mean`, log σ before it is kept in its [range](CLIPPED_LOG_STD_RANGE), and `z`.
    pub fn clipped(mean: f64, log_std: f64, z: f64) -> Drawn {
        let (low, high) = CLIPPED_LOG_STD_RANGE;
        let kept = log_std.clamp(low, high);
        let u = mean + kept.exp() * z;
        let action = u.clamp(-1.0, 1.0);
        let free = action == u;
        let deviation = action - mean;
        let score = deviation * (-kept).exp();
        Drawn {
            action,
            log_prob: -0.5 * score * score - kept - HALF_LOG_TAU,
            slope: f64::from(u8::from(free)),
            log_prob_slope: if free { 0.0 } else { score * (-kept).exp() },
            deviation,
            log_std_slope: f64::from(u8::from(kept == log_std)),
        }
    }

    /// Derivatives by μ, and by h or log σ, of a loss that has the derivatives `by_action` and `by_log_prob`, z held.
    ///
    /// ```text
    /// squashed:             ∂a/∂μ = 1 - a²,   ∂a/∂log σ = (1 - a²) σ z,   ∂log π/∂μ = 2 a,            ∂log π/∂log σ = 2 a σ z - 1
    /// clipped, |u| ≤ 1:     ∂a/∂μ = 1,        ∂a/∂log σ = σ z,            ∂log π/∂μ = 0,              ∂log π/∂log σ = -1
    /// clipped, |u| > 1:     ∂a/∂μ = 0,        ∂a/∂log σ = 0,              ∂log π/∂μ = (a - μ) / σ²,   ∂log π/∂log σ = (a - μ)² / σ² - 1
    /// ```
    pub fn gradient(&self, by_action: f64, by_log_prob: f64) -> (f64, f64) {
        let by_mean = by_action * self.slope + by_log_prob * self.log_prob_slope;
        let by_log_std = by_mean * self.deviation - by_log_prob;
        (by_mean, by_log_std * self.log_std_slope)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn densities_integrate_to_one() {
        // Simpson's rule over u, on which a = tanh u: ∫ p(a) da = ∫ p(tanh u) (1 - tanh² u) du.
        for (mean, output) in [(0.0, 0.0), (0.8, 0.3), (-2.0, -0.4), (0.1, 1.5)] {
            let std = log_std(output).exp();
            let (steps, reach) = (4000, 12.0 * std);
            let width = 2.0 * reach / f64::from(steps);
            let mut sum = 0.0;
            for i in 0..=steps {
                let u = mean - reach + f64::from(i) * width;
                let drawn = Drawn::squashed(mean, output, (u - mean) / std);
                let weight = if i == 0 || i == steps { 1.0 } else { f64::from(2 + 2 * (i % 2)) };
                // In logarithms: far out, 1 - tanh² u underflows and the density overflows.
                sum +=
                    weight * (drawn.log_prob + 2.0 * (LN_2 - u.abs() - (-2.0 * u.abs()).exp().ln_1p())).exp();
            }
            assert!((sum * width / 3.0 - 1.0).abs() < 1e-9, "{mean} {output}: {}", sum * width / 3.0);
        }
    }

    #[test]
    fn densities_of_an_interval_of_actions_integrate_to_its_share_of_draws() {
        // The share of a < 0 is that of z < -μ/σ; with μ = σ it is 0.15866 of any table.
        let output = 0.2;
        let std = log_std(output).exp();
        let steps = 200_000;
        let width = 1.0 / f64::from(steps);
        let density = |a: f64| Drawn::squashed(std, output, (a.atanh() - std) / std).log_prob.exp();
        let sum: f64 = (0..steps).map(|i| density(-1.0 + (f64::from(i) + 0.5) * width)).sum();
        assert!((sum * width - 0.158_655_25).abs() < 1e-7, "{}", sum * width);
    }

    #[test]
    fn far_out_nothing_is_infinite() {
        for mean in [-400.0, 30.0] {
            let drawn = Drawn::squashed(mean, 0.0, 0.5);
            assert!(drawn.log_prob.is_finite() && drawn.action.abs() <= 1.0);
            let (by_mean, by_output) = drawn.gradient(1.0, 1.0);
            assert!(by_mean.is_finite() && by_output.is_finite());
        }
    }

    #[test]
    fn gradients_are_slopes() {
        // Inside, clipped on both sides, σ at its largest.
        let clipped = [(0.3, -0.5, -0.7), (0.9, 0.1, 1.2), (-0.4, 0.3, -2.0), (0.0, 2.5, 0.1)];
        check_slopes(Drawn::clipped, &clipped);
        check_slopes(Drawn::squashed, &[(0.3, 0.2, -0.7), (-1.5, -0.8, 1.2), (4.0, 0.9, 2.0)]);
    }

    #[track_caller]
    fn check_slopes(draw: fn(f64, f64, f64) -> Drawn, points: &[(f64, f64, f64)]) {
        let h = 1e-6;
        for &(mean, output, z) in points {
            for (by_action, by_log_prob) in [(1.0, 0.0), (0.0, 1.0), (0.7, -0.2)] {
                let at = |mean, output| {
                    let drawn = draw(mean, output, z);
                    by_action * drawn.action + by_log_prob * drawn.log_prob
                };
                let found = draw(mean, output, z).gradient(by_action, by_log_prob);
                let by_mean = (at(mean + h, output) - at(mean - h, output)) / (2.0 * h);
                let by_output = (at(mean, output + h) - at(mean, output - h)) / (2.0 * h);
                assert!((found.0 - by_mean).abs() < 1e-7, "{found:?} {by_mean}");
                assert!(
                    (found.1 - by_output).abs() < 1e-6 * (1.0 + by_output.abs()),
                    "{found:?} {by_output}"
                );
            }
        }
    }
}
