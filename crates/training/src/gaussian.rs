//! Diagonal Gaussian distribution: log-probability, its derivatives, KL divergence, entropy.

/// ½ log 2π
pub(crate) const HALF_LOG_TAU: f64 = 0.918_938_533_204_672_8;

/// Standard deviations of a diagonal Gaussian over actions; the mean is an argument of the methods.
///
/// ```text
/// log p(a) = Σ_i -½ z_i² - log σ_i - ½ log 2π,   z_i = (a_i - μ_i) / σ_i
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct DiagonalGaussian {
    std: Vec<f64>,
    inverse: Vec<f64>,
    /// Σ log σ_i + ½ log 2π
    log_normalizer: f64,
}

impl DiagonalGaussian {
    /// Creates the distribution with σ = e^`log_std`.
    pub fn new(log_std: &[f32]) -> DiagonalGaussian {
        let log_std = || log_std.iter().map(|x| f64::from(*x));
        DiagonalGaussian {
            std: log_std().map(f64::exp).collect(),
            inverse: log_std().map(|x| (-x).exp()).collect(),
            log_normalizer: log_std().map(|x| x + HALF_LOG_TAU).sum(),
        }
    }

    /// Returns σ of each action dimension.
    pub fn std(&self) -> &[f64] {
        &self.std
    }

    /// Returns the log-probability of `action` for the mean `mean`.
    ///
    /// # Example
    /// ```
    /// use mishandle_training::gaussian::DiagonalGaussian;
    /// // The standard normal density at 1: e^(-1/2) / √(2π).
    /// let expected = ((-0.5_f64).exp() / std::f64::consts::TAU.sqrt()).ln();
    /// assert!((DiagonalGaussian::new(&[0.0]).log_prob(&[1.0], &[2.0]) - expected).abs() < 1e-15);
    /// ```
    pub fn log_prob(&self, mean: &[f32], action: &[f32]) -> f64 {
        let squares: f64 = self.standardized(mean, action).map(|z| z * z).sum();
        -0.5 * squares - self.log_normalizer
    }

    /// Returns z of each action dimension.
    fn standardized(&self, mean: &[f32], action: &[f32]) -> impl Iterator<Item = f64> {
        let rows = mean.iter().zip(action).zip(&self.inverse);
        rows.map(|((mean, action), inverse)| (f64::from(*action) - f64::from(*mean)) * inverse)
    }

    /// Computes `factor` times the gradient of the log-probability: writes the derivative with
    /// respect to the mean to `mean_gradient` and adds the derivative with respect to log σ to
    /// `log_std_gradient`.
    ///
    /// ```text
    /// ∂ log p / ∂ μ_i = z_i / σ_i,   ∂ log p / ∂ log σ_i = z_i² - 1
    /// ```
    pub fn log_prob_gradient(
        &self,
        mean: &[f32],
        action: &[f32],
        factor: f64,
        mean_gradient: &mut [f32],
        log_std_gradient: &mut [f32],
    ) {
        let gradients = mean_gradient.iter_mut().zip(log_std_gradient);
        for ((z, inverse), (mean_gradient, log_std_gradient)) in
            self.standardized(mean, action).zip(&self.inverse).zip(gradients)
        {
            *mean_gradient = (factor * z * inverse) as f32;
            *log_std_gradient += (factor * (z * z - 1.0)) as f32;
        }
    }

    /// Returns KL(p ‖ q) of this Gaussian p with mean `mean` and `other`, q, with mean
    /// `other_mean`.
    ///
    /// ```text
    /// KL(p ‖ q) = Σ_i log(σ_q / σ_p) + (σ_p² + (μ_p - μ_q)²) / (2 σ_q²) - ½
    /// ```
    pub fn kl_divergence(&self, mean: &[f32], other: &DiagonalGaussian, other_mean: &[f32]) -> f64 {
        let stds = self.std.iter().zip(&other.inverse);
        let rows = stds.zip(mean.iter().zip(other_mean));
        rows.map(|((std, inverse), (mean, other_mean))| {
            let ratio = std * inverse;
            let shift = (f64::from(*mean) - f64::from(*other_mean)) * inverse;
            0.5 * (ratio * ratio + shift * shift - 1.0) - ratio.ln()
        })
        .sum()
    }

    /// Returns the entropy Σ log σ_i + ½ log 2π + ½. Its derivative with respect to each log σ_i
    /// is 1.
    pub fn entropy(&self) -> f64 {
        self.log_normalizer + 0.5 * self.std.len() as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gradient_matches_finite_differences() {
        let mean = [0.3_f32, -0.2];
        let action = [0.1_f32, 0.9];
        let log_std = [-0.5_f32, 0.25];
        let mut mean_gradient = [0.0; 2];
        let mut log_std_gradient = [1.0, 1.0];
        DiagonalGaussian::new(&log_std).log_prob_gradient(
            &mean,
            &action,
            2.0,
            &mut mean_gradient,
            &mut log_std_gradient,
        );
        // f32 represents this step exactly, and it is large compared with rounding errors.
        let step = 1.0 / 1024.0_f32;
        for i in 0..2 {
            let moved = |by: f32, values: [f32; 2]| {
                let mut moved = values;
                moved[i] += by;
                moved
            };
            let width = 2.0 * f64::from(step);
            let at_mean = |by| DiagonalGaussian::new(&log_std).log_prob(&moved(by, mean), &action);
            let slope = 2.0 * (at_mean(step) - at_mean(-step)) / width;
            assert!(
                (slope - f64::from(mean_gradient[i])).abs() < 1e-4,
                "mean {i}: {slope} {}",
                mean_gradient[i]
            );
            let at_log_std = |by| DiagonalGaussian::new(&moved(by, log_std)).log_prob(&mean, &action);
            let slope = 1.0 + 2.0 * (at_log_std(step) - at_log_std(-step)) / width;
            assert!(
                (slope - f64::from(log_std_gradient[i])).abs() < 1e-4,
                "log σ {i}: {slope} {}",
                log_std_gradient[i]
            );
        }
    }

    #[test]
    fn the_kl_divergence_matches_a_calculation_by_hand() {
        // σ 1 to σ 2: log 2 + 1/8 - 1/2; a shift by 1 adds 1/8.
        let p = DiagonalGaussian::new(&[0.0]);
        let q = DiagonalGaussian::new(&[2.0_f32.ln()]);
        let expected = 2.0_f64.ln() + 0.25 - 0.5;
        assert!((p.kl_divergence(&[0.0], &q, &[1.0]) - expected).abs() < 1e-7);
        assert_eq!(p.kl_divergence(&[0.3], &p, &[0.3]), 0.0);
    }

    #[test]
    fn the_entropy_is_the_mean_negative_log_probability() {
        // E[z²] = 1, so -log p is the entropy where z² = 1 in each dimension.
        let gaussian = DiagonalGaussian::new(&[-1.0, 0.5]);
        let action = [(-1.0_f64).exp() as f32, -(0.5_f64.exp()) as f32];
        assert!((gaussian.entropy() + gaussian.log_prob(&[0.0, 0.0], &action)).abs() < 1e-6);
    }
}
