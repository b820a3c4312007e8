//! A linear-Gaussian policy for one channel of disturbances.

use crate::features::packed;

/// Pseudo-counts of simulations without a tilt, of which a fit chooses the one with the largest
/// evidence.
const PRIORS: [f64; 9] = [0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 10_000.0];

/// Bounds of the fitted variance.
const VARIANCES: [f64; 2] = [0.6, 3.0];

/// The sums of weighted simulations that a policy is fitted to. Their weights add up to the number
/// of equally weighted simulations with the same precision.
#[derive(Clone, Debug)]
pub(crate) struct Sums {
    /// Number of draws.
    pub n: f64,
    /// Lower triangle of Σ f fᵀ, by rows.
    pub products: Vec<f64>,
    /// Σ z f.
    pub moments: Vec<f64>,
    /// Σ z².
    pub squares: f64,
}

/// Draws the latent number z of an axis from N(θᵀf, σ²), where f are the features of the control
/// step in which the axis begins to act.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Policy {
    theta: Vec<f64>,
    variance: f64,
}

impl Policy {
    /// Fits the policy to simulations that are worth `simulations` equally weighted ones: ridge
    /// regression of z on the features. The penalty is that of the largest evidence under unit
    /// variance, so features that explain nothing get no coefficients.
    ///
    /// # Reference
    /// MacKay, "Bayesian interpolation", Neural Computation 4, 1992.
    pub(crate) fn fit(sums: &Sums, simulations: f64) -> Policy {
        let size = sums.moments.len();
        let diagonal: Vec<f64> =
            (0..size).map(|i| (sums.products[packed(i + 1) - 1] / simulations.max(1.0)).max(1e-9)).collect();
        // Without coefficients, the logarithm of the evidence is 0.
        let mut best: (f64, Vec<f64>) = (0.0, vec![0.0; size]);
        for prior in PRIORS {
            let mut matrix = sums.products.clone();
            (0..size).for_each(|i| matrix[packed(i + 1) - 1] += prior * diagonal[i]);
            let log_determinant = cholesky(&mut matrix, size);
            let theta = solve(&matrix, &sums.moments);
            let explained: f64 = theta.iter().zip(&sums.moments).map(|(t, b)| t * b).sum();
            let before: f64 = diagonal.iter().map(|d| (prior * d).ln()).sum();
            let evidence = 0.5 * (explained - log_determinant + before);
            if evidence > best.0 {
                best = (evidence, theta);
            }
        }
        let theta = best.1;
        let variance = (residual(&theta, &sums.products, &sums.moments, sums.squares) / sums.n.max(1.0))
            .clamp(VARIANCES[0], VARIANCES[1]);
        // Within two standard errors, it is that of the distribution.
        let is_noise = (variance - 1.0).abs() < 2.0 * (2.0 / sums.n.max(1.0)).sqrt();
        Policy { theta, variance: if is_noise { 1.0 } else { variance } }
    }

    /// Returns a draw for the features, from a standard normal number.
    pub(crate) fn draw(&self, features: &[f64], noise: f64) -> f64 {
        let mean: f64 = self.theta.iter().zip(features).map(|(t, f)| t * f).sum();
        mean + self.variance.sqrt() * noise
    }

    /// Returns the logarithm of the density of `n` draws divided by that of standard normal ones.
    pub(crate) fn log_ratio(&self, n: f64, products: &[f64], moments: &[f64], squares: f64) -> f64 {
        let residual = residual(&self.theta, products, moments, squares);
        0.5 * (squares - residual / self.variance) - 0.5 * n * self.variance.ln()
    }
}

/// Returns Σ (z - θᵀf)².
fn residual(theta: &[f64], products: &[f64], moments: &[f64], squares: f64) -> f64 {
    let mut sum = squares;
    for (i, (a, moment)) in theta.iter().zip(moments).enumerate() {
        let entries = &products[packed(i)..packed(i + 1)];
        let before: f64 = entries.iter().zip(&theta[..i]).map(|(entry, b)| entry * b).sum();
        sum += a * (2.0 * before + entries[i] * a - 2.0 * moment);
    }
    sum
}

/// Replaces the lower triangle of a positive definite matrix by its Cholesky factor. Returns the
/// logarithm of the determinant.
fn cholesky(matrix: &mut [f64], size: usize) -> f64 {
    let mut log_determinant = 0.0;
    for i in 0..size {
        for j in 0..=i {
            let a = packed(i);
            let b = packed(j);
            let sum: f64 = (0..j).map(|k| matrix[a + k] * matrix[b + k]).sum();
            let rest = matrix[a + j] - sum;
            // The diagonal is positive except for rounding errors.
            matrix[a + j] = if i == j { rest.max(1e-12).sqrt() } else { rest / matrix[b + j] };
        }
        log_determinant += 2.0 * matrix[packed(i + 1) - 1].ln();
    }
    log_determinant
}

/// Solves L Lᵀ x = b.
fn solve(factor: &[f64], b: &[f64]) -> Vec<f64> {
    let mut x = b.to_vec();
    for i in 0..x.len() {
        let known: f64 = (0..i).map(|k| factor[packed(i) + k] * x[k]).sum();
        x[i] = (x[i] - known) / factor[packed(i) + i];
    }
    for i in (0..x.len()).rev() {
        let known: f64 = (i + 1..x.len()).map(|k| factor[packed(k) + i] * x[k]).sum();
        x[i] = (x[i] - known) / factor[packed(i) + i];
    }
    x
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use mishandle_random::Sequence;

    use super::*;

    fn sums(draws: &[(Vec<f64>, f64)]) -> Sums {
        let size = draws[0].0.len();
        let entry = |i: usize, j: usize| draws.iter().map(|(f, _)| f[i] * f[j]).sum::<f64>();
        Sums {
            n: draws.len() as f64,
            products: (0..size)
                .flat_map(|i| (0..=i).map(move |j| (i, j)))
                .map(|(i, j)| entry(i, j))
                .collect(),
            moments: (0..size).map(|i| draws.iter().map(|(f, z)| f[i] * z).sum()).collect(),
            squares: draws.iter().map(|(_, z)| z * z).sum(),
        }
    }

    /// 50 simulations of 100 draws with the mean 0.3 - 0.5 x; the third feature has no effect.
    #[test]
    fn a_fit_finds_the_coefficients_and_its_density_is_the_product_of_normal_ones() {
        let mut random = Sequence::new(3, 0);
        let draws: Vec<(Vec<f64>, f64)> = (0..5000)
            .map(|_| {
                let (x, other) = random.normal_pair();
                let (noise, _) = random.normal_pair();
                (vec![1.0, x, other], 0.3 - 0.5 * x + noise)
            })
            .collect();
        let sums = sums(&draws);
        let policy = Policy::fit(&sums, 50.0);
        // Four standard errors are 0.06.
        for (found, expected) in policy.theta.iter().zip([0.3, -0.5, 0.0]) {
            assert!((found - expected).abs() < 0.06, "{:?}", policy.theta);
        }
        let normal = |z: f64, mean: f64, variance: f64| {
            -0.5 * (z - mean).powi(2) / variance - 0.5 * (std::f64::consts::TAU * variance).ln()
        };
        let expected: f64 = draws
            .iter()
            .map(|(f, z)| normal(*z, policy.draw(f, 0.0), policy.variance) - normal(*z, 0.0, 1.0))
            .sum();
        let found = policy.log_ratio(sums.n, &sums.products, &sums.moments, sums.squares);
        assert!((found - expected).abs() < 1e-8 * expected.abs(), "{found}, not {expected}");
    }

    #[test]
    fn pure_noise_leaves_the_distribution_unchanged() {
        let mut random = Sequence::new(4, 0);
        let draws: Vec<(Vec<f64>, f64)> = (0..2000)
            .map(|_| (vec![1.0, random.normal_pair().0, random.normal_pair().0], random.normal_pair().0))
            .collect();
        let policy = Policy::fit(&sums(&draws), 20.0);
        assert!(policy.theta.iter().all(|t| t.abs() < 0.05), "{policy:?}");
        assert!((policy.variance - 1.0).abs() < 0.1);
    }
}
