//! Samples of a Gaussian restricted to [-1, 1] by tanh or by clipping: log-probability and
//! gradient.

use std::f64::consts::LN_2;

use mishandle_controllers::squashed::{log_std, log_std_slope};

use crate::gaussian::HALF_LOG_TAU;

/// Bounds of log σ of a clipped Gaussian, those of skrl.
pub const CLIPPED_LOG_STD_RANGE: (f64, f64) = (-20.0, 2.0);

/// Sample of one action dimension for a given standard normal number z (reparameterization).
///
/// ```text
/// tanh:      u = μ + σ(h) z,   a = tanh u,            log π(a) = -½ z² - log σ - ½ log 2π - log(1 - a²)
/// clipped:   u = μ + σ z,      a = clip(u, -1, 1),    log π(a) = -½ ((a - μ) / σ)² - log σ - ½ log 2π
/// ```
///
/// With tanh, μ and h are outputs of the policy network, and σ(h) is that of
/// [`mishandle_controllers::squashed`]. The last term comes from the Jacobian. It is computed as
/// log(1 - tanh² u) = 2 (log 2 - |u| - log(1 + t)), t = e^(-2|u|), which stays accurate where a
/// rounds to ±1.
///
/// With clipping, the formula is the density of the unclipped Gaussian at the clipped action. This
/// is not the density of a, but skrl's SAC uses it.
///
/// # Example
/// ```
/// use mishandle_training::sac::SquashedSample;
/// // μ = 0, z = 0: a = 0, and the density is that of the Gaussian with σ = e^-1.5.
/// let half_log_tau = 0.5 * std::f64::consts::TAU.ln();
/// let squashed = SquashedSample::tanh(0.0, 0.0, 0.0);
/// assert_eq!(squashed.action, 0.0);
/// assert!((squashed.log_prob - (1.5 - half_log_tau)).abs() < 1e-15);
/// // μ = 0.5, σ = 1, z = 3: a = 1, half a standard deviation from μ.
/// let clipped = SquashedSample::clipped(0.5, 0.0, 3.0);
/// assert_eq!(clipped.action, 1.0);
/// assert!((clipped.log_prob - (-0.125 - half_log_tau)).abs() < 1e-15);
/// ```
///
/// # Reference
/// Haarnoja et al., "Soft Actor-Critic Algorithms and Applications", 2018, appendix C.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SquashedSample {
    /// Action a.
    pub action: f64,
    /// Log-probability log π(a).
    pub log_prob: f64,
    /// ∂a/∂u
    slope: f64,
    /// ∂log π(a)/∂μ
    log_prob_slope: f64,
    /// u - μ with tanh, a - μ with clipping.
    deviation: f64,
    /// Derivative of log σ with respect to h, or to log σ before clamping.
    log_std_slope: f64,
}

impl SquashedSample {
    /// Returns the tanh sample for the network outputs μ = `mean` and h = `output`, and `z`.
    pub fn tanh(mean: f64, output: f64, z: f64) -> SquashedSample {
        let log_std = log_std(output);
        let deviation = log_std.exp() * z;
        let u = mean + deviation;
        let t_minus_1 = (-2.0 * u.abs()).exp_m1();
        let t = t_minus_1 + 1.0;
        let log_slope = 2.0 * (LN_2 - u.abs() - t.ln_1p());
        let action = (-t_minus_1 / (1.0 + t)).copysign(u);
        SquashedSample {
            action,
            log_prob: -0.5 * z * z - log_std - HALF_LOG_TAU - log_slope,
            slope: 4.0 * t / ((1.0 + t) * (1.0 + t)),
            log_prob_slope: 2.0 * action,
            deviation,
            log_std_slope: log_std_slope(output),
        }
    }

    /// Returns the clipped sample for μ = `mean`, log σ before clamping to its
    /// [bounds](CLIPPED_LOG_STD_RANGE), and `z`.
    pub fn clipped(mean: f64, log_std: f64, z: f64) -> SquashedSample {
        let (low, high) = CLIPPED_LOG_STD_RANGE;
        let clamped = log_std.clamp(low, high);
        let u = mean + clamped.exp() * z;
        let action = u.clamp(-1.0, 1.0);
        let unclipped = action == u;
        let deviation = action - mean;
        let score = deviation * (-clamped).exp();
        SquashedSample {
            action,
            log_prob: -0.5 * score * score - clamped - HALF_LOG_TAU,
            slope: f64::from(u8::from(unclipped)),
            log_prob_slope: if unclipped { 0.0 } else { score * (-clamped).exp() },
            deviation,
            log_std_slope: f64::from(u8::from(clamped == log_std)),
        }
    }

    /// Returns the derivatives of a loss with respect to μ and to h or log σ, for constant z.
    /// `action_gradient` and `log_prob_gradient` are the derivatives of the loss with respect to a
    /// and log π(a).
    ///
    /// ```text
    /// tanh:                 ∂a/∂μ = 1 - a²,   ∂a/∂log σ = (1 - a²) σ z,   ∂log π/∂μ = 2 a,            ∂log π/∂log σ = 2 a σ z - 1
    /// clipped, |u| ≤ 1:     ∂a/∂μ = 1,        ∂a/∂log σ = σ z,            ∂log π/∂μ = 0,              ∂log π/∂log σ = -1
    /// clipped, |u| > 1:     ∂a/∂μ = 0,        ∂a/∂log σ = 0,              ∂log π/∂μ = (a - μ) / σ²,   ∂log π/∂log σ = (a - μ)² / σ² - 1
    /// ```
    pub fn gradient(&self, action_gradient: f64, log_prob_gradient: f64) -> (f64, f64) {
        let mean_gradient = action_gradient * self.slope + log_prob_gradient * self.log_prob_slope;
        let log_std_gradient = mean_gradient * self.deviation - log_prob_gradient;
        (mean_gradient, log_std_gradient * self.log_std_slope)
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
            let steps = 4000;
            let reach = 12.0 * std;
            let width = 2.0 * reach / f64::from(steps);
            let mut sum = 0.0;
            for i in 0..=steps {
                let u = mean - reach + f64::from(i) * width;
                let sample = SquashedSample::tanh(mean, output, (u - mean) / std);
                let weight = if i == 0 || i == steps { 1.0 } else { f64::from(2 + 2 * (i % 2)) };
                // In logarithms: for large |u|, 1 - tanh² u underflows and the density overflows.
                sum += weight
                    * (sample.log_prob + 2.0 * (LN_2 - u.abs() - (-2.0 * u.abs()).exp().ln_1p())).exp();
            }
            assert!((sum * width / 3.0 - 1.0).abs() < 1e-9, "{mean} {output}: {}", sum * width / 3.0);
        }
    }

    #[test]
    fn the_density_over_an_interval_integrates_to_its_probability() {
        // P(a < 0) = P(z < -μ/σ), which is 0.15866 for μ = σ.
        let output = 0.2;
        let std = log_std(output).exp();
        let steps = 200_000;
        let width = 1.0 / f64::from(steps);
        let density = |a: f64| SquashedSample::tanh(std, output, (a.atanh() - std) / std).log_prob.exp();
        let sum: f64 = (0..steps).map(|i| density(-1.0 + (f64::from(i) + 0.5) * width)).sum();
        assert!((sum * width - 0.158_655_25).abs() < 1e-7, "{}", sum * width);
    }

    #[test]
    fn samples_with_large_means_are_finite() {
        for mean in [-400.0, 30.0] {
            let sample = SquashedSample::tanh(mean, 0.0, 0.5);
            assert!(sample.log_prob.is_finite() && sample.action.abs() <= 1.0);
            let (mean_gradient, output_gradient) = sample.gradient(1.0, 1.0);
            assert!(mean_gradient.is_finite() && output_gradient.is_finite());
        }
    }

    #[test]
    fn gradients_match_finite_differences() {
        // Unclipped, clipped on both sides, and with log σ at its upper bound.
        let clipped = [(0.3, -0.5, -0.7), (0.9, 0.1, 1.2), (-0.4, 0.3, -2.0), (0.0, 2.5, 0.1)];
        check_slopes(SquashedSample::clipped, &clipped);
        check_slopes(SquashedSample::tanh, &[(0.3, 0.2, -0.7), (-1.5, -0.8, 1.2), (4.0, 0.9, 2.0)]);
    }

    #[track_caller]
    fn check_slopes(draw: fn(f64, f64, f64) -> SquashedSample, points: &[(f64, f64, f64)]) {
        let h = 1e-6;
        for &(mean, output, z) in points {
            for (action_gradient, log_prob_gradient) in [(1.0, 0.0), (0.0, 1.0), (0.7, -0.2)] {
                let at = |mean, output| {
                    let sample = draw(mean, output, z);
                    action_gradient * sample.action + log_prob_gradient * sample.log_prob
                };
                let found = draw(mean, output, z).gradient(action_gradient, log_prob_gradient);
                let mean_gradient = (at(mean + h, output) - at(mean - h, output)) / (2.0 * h);
                let output_gradient = (at(mean, output + h) - at(mean, output - h)) / (2.0 * h);
                assert!((found.0 - mean_gradient).abs() < 1e-7, "{found:?} {mean_gradient}");
                assert!(
                    (found.1 - output_gradient).abs() < 1e-6 * (1.0 + output_gradient.abs()),
                    "{found:?} {output_gradient}"
                );
            }
        }
    }
}
