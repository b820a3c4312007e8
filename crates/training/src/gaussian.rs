//! A diagonal Gaussian: logarithms of densities, their derivatives, entropy.

/// ½ log 2π
pub(crate) const HALF_LOG_TAU: f64 = 0.918_938_533_204_672_8;

/// The deviations of a Gaussian over actions, in the forms that its formulas need.
///
/// ```text
/// log p(a) = Σ_i -½ z_i² - log σ_i - ½ log 2π,   z_i = (a_i - μ_i) / σ_i
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Deviations {
    std: Vec<f64>,
    inverse: Vec<f64>,
    /// Σ log σ_i + ½ log 2π
    log_normalizer: f64,
}

impl Deviations {
    /// σ = e^`log_std`.
    pub fn new(log_std: &[f32]) -> Deviations {
        let log_std = || log_std.iter().map(|x| f64::from(*x));
        Deviations {
            std: log_std().map(f64::exp).collect(),
            inverse: log_std().map(|x| (-x).exp()).collect(),
            log_normalizer: log_std().map(|x| x + HALF_LOG_TAU).sum(),
        }
    }

    /// σ, one for each action.
    pub fn std(&self) -> &[f64] {
        &self.std
    }

    /// The logarithm of the density at `action`, around `mean`.
    ///
    /// # Example
    /// ```
    /// use mishandle_training::gaussian::Deviations;
    /// // The standard normal density at 1: e^(-1/2) / √(2π).
    /// let expected = ((-0.5_f64).exp() / std::f64::consts::TAU.sqrt()).ln();
    /// assert!((Deviations::new(&[0.0]).log_prob(&[1.0], &[2.0]) - expected).abs() < 1e-15);
    /// ```
    pub fn log_prob(&self, mean: &[f32], action: &[f32]) -> f64 {
        let squares: f64 = self.scores(mean, action).map(|z| z * z).sum();
        -0.5 * squares - self.log_normalizer
    }

    /// z, one for each action.
    fn scores(&self, mean: &[f32], action: &[f32]) -> impl Iterator<Item = f64> {
        let rows = mean.iter().zip(action).zip(&self.inverse);
        rows.map(|((mean, action), inverse)| (f64::from(*action) - f64::from(*mean)) * inverse)
    }

    /// Derivatives of the logarithm of the density, times `factor`: by the mean, written to `mean_gradient`, and by
    /// log σ, added to `log_std_gradient`.
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
        for ((z, inverse), (by_mean, by_log_std)) in
            self.scores(mean, action).zip(&self.inverse).zip(gradients)
        {
            *by_mean = (factor * z * inverse) as f32;
            *by_log_std += (factor * (z * z - 1.0)) as f32;
        }
    }

    /// How far the Gaussian `other` around `other_mean` is from this one around `mean`.
    ///
    /// ```text
    /// KL(p ‖ q) = Σ_i log(σ_q / σ_p) + (σ_p² + (μ_p - μ_q)²) / (2 σ_q²) - ½
    /// ```
    pub fn divergence(&self, mean: &[f32], other: &Deviations, other_mean: &[f32]) -> f64 {
        let deviations = self.std.iter().zip(&other.inverse);
        let rows = deviations.zip(mean.iter().zip(other_mean));
        rows.map(|((std, inverse), (mean, other_mean))| {
            let ratio = std * inverse;
            let shift = (f64::from(*mean) - f64::from(*other_mean)) * inverse;
            0.5 * (ratio * ratio + shift * shift - 1.0) - ratio.ln()
        })
        .sum()
    }

    /// The entropy, Σ log σ_i + ½ log 2π + ½; its derivative by each log σ_i is 1.
    pub fn entropy(&self) -> f64 {
        self.log_normalizer + 0.5 * self.std.len() as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gradient_is_the_slope() {
        let (mean, action, log_std) = ([0.3_f32, -0.2], [0.1_f32, 0.9], [-0.5_f32, 0.25]);
        let (mut by_mean, mut by_log_std) = ([0.0; 2], [1.0, 1.0]);
        Deviations::new(&log_std).log_prob_gradient(&mean, &action, 2.0, &mut by_mean, &mut by_log_std);
        // Steps that f32 holds exactly, large against its rounding: the slope is that of the formula in f64.
        let step = 1.0 / 1024.0_f32;
        for i in 0..2 {
            let moved = |by: f32, values: [f32; 2]| {
                let mut moved = values;
                moved[i] += by;
                moved
            };
            let width = 2.0 * f64::from(step);
            let at_mean = |by| Deviations::new(&log_std).log_prob(&moved(by, mean), &action);
            let slope = 2.0 * (at_mean(step) - at_mean(-step)) / width;
            assert!((slope - f64::from(by_mean[i])).abs() < 1e-4, "mean {i}: {slope} {}", by_mean[i]);
            let at_log_std = |by| Deviations::new(&moved(by, log_std)).log_prob(&mean, &action);
            let slope = 1.0 + 2.0 * (at_log_std(step) - at_log_std(-step)) / width;
            assert!((slope - f64::from(by_log_std[i])).abs() < 1e-4, "log σ {i}: {slope} {}", by_log_std[i]);
        }
    }

    #[test]
    fn the_divergence_worked_out_by_hand() {
        // σ 1 to σ 2: log 2 + 1/8 - 1/2; a shift by 1 adds 1/8.
        let (p, q) = (Deviations::new(&[0.0]), Deviations::new(&[2.0_f32.ln()]));
        let expected = 2.0_f64.ln() + 0.25 - 0.5;
        assert!((p.divergence(&[0.0], &q, &[1.0]) - expected).abs() < 1e-7);
        assert_eq!(p.divergence(&[0.3], &p, &[0.3]), 0.0);
    }

    #[test]
    fn the_entropy_is_the_mean_of_minus_the_logarithm() {
        // E[z²] = 1: with z² = 1 in each action, -log p is the entropy.
        let deviations = Deviations::new(&[-1.0, 0.5]);
        let action = [(-1.0_f64).exp() as f32, -(0.5_f64.exp()) as f32];
        assert!((deviations.entropy() + deviations.log_prob(&[0.0, 0.0], &action)).abs() < 1e-6);
    }
}
