//! The search distribution of CMA-ES and its update.

use nalgebra::{DMatrix, SymmetricEigen};

use super::parameters::Parameters;
use crate::categories::Normals;

/// A restart is due if the covariance matrix has a larger condition number.
const MAX_CONDITION: f64 = 1e14;
/// More iterations than the eigenvalues of any finite matrix need.
const MAX_EIGEN_ITERATIONS: usize = 100_000;
/// The largest standard deviation of a coordinate. A wider distribution would fold over the box
/// several times.
const MAX_DEVIATION: f64 = 1.0;

/// A normal distribution with mean m, step size σ and covariance σ² C, and the evolution paths of
/// its mean.
#[derive(Debug, Clone)]
pub(super) struct Gaussian {
    parameters: Parameters,
    pub(super) mean: Vec<f64>,
    sigma: f64,
    covariance: DMatrix<f64>,
    /// Eigenvectors in columns, and the square roots of the eigenvalues.
    eigenvectors: DMatrix<f64>,
    scales: Vec<f64>,
    path_sigma: Vec<f64>,
    path_c: Vec<f64>,
    /// Least standard deviations; positive for integers.
    least: Vec<f64>,
    generation: usize,
    is_degenerate: bool,
}

impl Gaussian {
    /// Creates an isotropic distribution. `mean` has at least one number.
    pub(super) fn new(mean: Vec<f64>, sigma: f64, least: Vec<f64>, population: usize) -> Self {
        let n = mean.len();
        Self {
            parameters: Parameters::new(n, population),
            sigma,
            covariance: DMatrix::identity(n, n),
            eigenvectors: DMatrix::identity(n, n),
            scales: vec![1.0; n],
            path_sigma: vec![0.0; n],
            path_c: vec![0.0; n],
            least,
            generation: 0,
            is_degenerate: false,
            mean,
        }
    }

    /// Writes a sample to `x`: m + σ B D z with standard normal z.
    pub(super) fn sample(&self, normals: &mut Normals, x: &mut Vec<f64>) {
        x.clone_from(&self.mean);
        for (column, scale) in self.eigenvectors.column_iter().zip(&self.scales) {
            let length = self.sigma * scale * normals.next();
            x.iter_mut().zip(column.iter()).for_each(|(x, b)| *x += length * b);
        }
    }

    /// Returns C^(-1/2) y.
    fn whitened(&self, y: &[f64]) -> Vec<f64> {
        let mut white = vec![0.0; y.len()];
        for (column, scale) in self.eigenvectors.column_iter().zip(&self.scales) {
            let length = column.iter().zip(y).map(|(b, y)| b * y).sum::<f64>() / scale;
            white.iter_mut().zip(column.iter()).for_each(|(w, b)| *w += length * b);
        }
        white
    }

    /// Updates the distribution with the samples `x`, best first.
    pub(super) fn update(&mut self, x: &[&[f64]]) {
        let n = self.mean.len();
        self.generation += 1;
        let steps: Vec<Vec<f64>> =
            x.iter().map(|x| x.iter().zip(&self.mean).map(|(x, m)| (x - m) / self.sigma).collect()).collect();
        let p = &self.parameters;
        let mut mean_step = vec![0.0; n];
        for (step, weight) in steps.iter().zip(&p.weights[..p.mu]) {
            mean_step.iter_mut().zip(step).for_each(|(m, y)| *m += weight * y);
        }
        let white = self.whitened(&mean_step);
        let factor = (p.c_sigma * (2.0 - p.c_sigma) * p.mu_eff).sqrt();
        follow(&mut self.path_sigma, p.c_sigma, factor, &white);
        let length = norm(&self.path_sigma);
        let settled = (1.0 - (1.0 - p.c_sigma).powf(2.0 * self.generation as f64)).sqrt();
        let is_short = length / settled < (1.4 + 2.0 / (n as f64 + 1.0)) * p.chi;
        let factor = if is_short { (p.c_c * (2.0 - p.c_c) * p.mu_eff).sqrt() } else { 0.0 };
        follow(&mut self.path_c, p.c_c, factor, &mean_step);
        let kept = if is_short { 0.0 } else { p.c_c * (2.0 - p.c_c) };
        self.update_covariance(&steps, kept);
        self.mean.iter_mut().zip(&mean_step).for_each(|(m, y)| *m += self.sigma * y);
        let p = &self.parameters;
        self.sigma *= ((p.c_sigma / p.d_sigma) * (length / p.chi - 1.0)).min(1.0).exp();
        self.limit_deviations();
        if self.generation.is_multiple_of(self.parameters.eigen_interval) {
            self.decompose();
        }
    }

    /// Adds the rank-one and rank-μ updates to the covariance matrix.
    fn update_covariance(&mut self, steps: &[Vec<f64>], kept: f64) {
        let n = self.mean.len();
        let squared: Vec<f64> =
            steps.iter().map(|y| self.whitened(y).iter().map(|w| w * w).sum::<f64>()).collect();
        let p = &self.parameters;
        let sum: f64 = p.weights.iter().sum();
        self.covariance *= 1.0 + p.c_1 * kept - p.c_1 - p.c_mu * sum;
        let weights = p.weights.iter().zip(&squared).map(|(w, squared)| {
            // Negative weights are scaled so that the matrix stays positive definite.
            let scale = if *w < 0.0 { n as f64 / squared.max(f64::MIN_POSITIVE) } else { 1.0 };
            p.c_mu * w * scale
        });
        let terms = weights.zip(steps).chain([(p.c_1, &self.path_c)]);
        for (weight, y) in terms {
            for (j, mut column) in self.covariance.column_iter_mut().enumerate() {
                let scaled = weight * y[j];
                column.iter_mut().zip(y).skip(j).for_each(|(c, y)| *c += scaled * y);
            }
        }
        self.covariance.fill_upper_triangle_with_lower_triangle();
    }

    /// Returns the standard deviations of the coordinates.
    fn deviations(&self) -> impl Iterator<Item = f64> {
        (0..self.mean.len()).map(|i| self.sigma * self.covariance[(i, i)].sqrt())
    }

    /// Limits the standard deviations from above for all coordinates together, and from below for
    /// each integer.
    fn limit_deviations(&mut self) {
        let largest = self.deviations().fold(0.0, f64::max);
        if largest > MAX_DEVIATION {
            self.sigma *= MAX_DEVIATION / largest;
        }
        for i in 0..self.mean.len() {
            let deviation = self.sigma * self.covariance[(i, i)].sqrt();
            if deviation < self.least[i] {
                let factor = self.least[i] / deviation;
                self.covariance.row_mut(i).scale_mut(factor);
                self.covariance.column_mut(i).scale_mut(factor);
                self.path_c[i] *= factor;
            }
        }
    }

    /// Computes eigenvectors and scales. A matrix with a number that is not finite has no
    /// decomposition.
    fn decompose(&mut self) {
        let eigen = SymmetricEigen::try_new(self.covariance.clone(), f64::EPSILON, MAX_EIGEN_ITERATIONS);
        let Some(eigen) = eigen.filter(|eigen| eigen.eigenvalues.iter().all(|value| value.is_finite()))
        else {
            self.is_degenerate = true;
            return;
        };
        self.scales.clear();
        self.scales.extend(eigen.eigenvalues.iter().map(|value| value.max(f64::MIN_POSITIVE).sqrt()));
        self.eigenvectors = eigen.eigenvectors;
    }

    /// Increases the step size if the best values are equal.
    pub(super) fn escape(&mut self) {
        let p = &self.parameters;
        self.sigma *= (0.2 + p.c_sigma / p.d_sigma).exp();
        self.limit_deviations();
    }

    /// Returns whether the standard deviations of all coordinates are below `tolerance` or, for
    /// integers, at their least value; or the covariance matrix is nearly singular.
    pub(super) fn is_exhausted(&self, tolerance: f64) -> bool {
        let is_narrow = |(deviation, least): (f64, &f64)| deviation <= tolerance.max(1.001 * least);
        let largest = self.scales.iter().fold(0.0, |a, b| f64::max(a, *b));
        let smallest = self.scales.iter().fold(f64::INFINITY, |a, b| f64::min(a, *b));
        let is_singular = self.is_degenerate || largest > MAX_CONDITION.sqrt() * smallest;
        is_singular || self.deviations().zip(&self.least).all(is_narrow)
    }
}

/// Moves an evolution path: p ← (1 - c) p + factor · step.
fn follow(path: &mut [f64], c: f64, factor: f64, step: &[f64]) {
    path.iter_mut().zip(step).for_each(|(p, y)| *p = (1.0 - c) * *p + factor * y);
}

fn norm(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}
