//! One normal distribution in the latent space.

use mishandle_random::Sequence;

use crate::scenarios::normals;

/// A covariance from fewer points per dimension is diagonal.
const POINTS_PER_DIMENSION: f64 = 10.0;

/// Few points underestimate variances and overestimate correlations. This number of points without
/// correlations, and with [`WIDER`] times the variances, are added to them.
const PRIOR: f64 = 2.0;
const WIDER: f64 = 4.0;

/// Smallest variance, for points that are equal.
const SMALLEST: f64 = 1e-8;

/// A normal distribution N(m, L Lᵀ).
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Gaussian {
    mean: Vec<f64>,
    /// The Cholesky factor L: d rows of the lower triangle, row i with i + 1 numbers.
    factor: Vec<Vec<f64>>,
}

impl Gaussian {
    /// Fits mean and covariance to weighted points. The covariance is shrunk toward its diagonal,
    /// and enlarged by 1 + 1/d, because a proposal that is too wide costs less than one that is too
    /// narrow. Returns `None` if no weight is positive.
    pub(crate) fn fit<'a>(points: impl Iterator<Item = (&'a [f64], f64)> + Clone) -> Option<Gaussian> {
        let mut total = 0.0;
        let mut squares = 0.0;
        let mut mean: Vec<f64> = Vec::new();
        for (point, weight) in points.clone() {
            mean.resize(point.len(), 0.0);
            total += weight;
            squares += weight * weight;
            mean.iter_mut().zip(point).for_each(|(sum, z)| *sum += weight * z);
        }
        if total <= 0.0 || !total.is_finite() {
            return None;
        }
        mean.iter_mut().for_each(|sum| *sum /= total);
        let d = mean.len();
        let effective = total * total / squares;
        let is_diagonal = effective < POINTS_PER_DIMENSION * d as f64;
        let mut covariance: Vec<Vec<f64>> = (0..d).map(|i| vec![0.0; i + 1]).collect();
        for (point, weight) in points {
            for i in 0..d {
                let first = if is_diagonal { i } else { 0 };
                for j in first..=i {
                    covariance[i][j] += weight / total * (point[i] - mean[i]) * (point[j] - mean[j]);
                }
            }
        }
        let enlarged = 1.0 + 1.0 / d.max(1) as f64;
        for (i, row) in covariance.iter_mut().enumerate() {
            let variance = row[i] * (effective + WIDER * PRIOR) / (effective + PRIOR);
            row.iter_mut().for_each(|value| *value *= enlarged * effective / (effective + PRIOR));
            row[i] = (enlarged * variance).max(SMALLEST);
        }
        if is_diagonal {
            forget_noise(&mut mean, &mut covariance, effective);
        }
        cholesky(&mut covariance);
        Some(Gaussian { mean, factor: covariance })
    }

    /// Draws a point.
    pub(crate) fn draw(&self, random: &mut Sequence) -> Vec<f64> {
        let normal = normals(self.mean.len(), random);
        let coordinate =
            |(mean, row): (&f64, &Vec<f64>)| mean + row.iter().zip(&normal).map(|(l, x)| l * x).sum::<f64>();
        self.mean.iter().zip(&self.factor).map(coordinate).collect()
    }

    /// Returns the logarithm of the density divided by that of the standard normal distribution.
    pub(crate) fn log_ratio(&self, point: &[f64]) -> f64 {
        // The solution x of L x = point - mean.
        let mut x: Vec<f64> = Vec::with_capacity(point.len());
        let mut log = 0.0;
        for ((row, mean), z) in self.factor.iter().zip(&self.mean).zip(point) {
            let i = x.len();
            let known: f64 = row.iter().zip(&x).map(|(l, x)| l * x).sum();
            x.push((z - mean - known) / row[i]);
            log += 0.5 * (z * z - x[i] * x[i]) - row[i].ln();
        }
        log
    }
}

/// Sets means that are within two standard errors of 0 to 0, and variances that are within two
/// standard errors of 1 to 1. Few points in many dimensions would otherwise move the coordinates
/// that do not matter, each a little, and together far from the distribution.
fn forget_noise(mean: &mut [f64], covariance: &mut [Vec<f64>], points: f64) {
    for (i, (mean, row)) in mean.iter_mut().zip(covariance).enumerate() {
        if (row[i] - 1.0).abs() < 2.0 * (2.0 / points).sqrt() {
            row[i] = 1.0;
        }
        if mean.abs() < 2.0 * (row[i] / points).sqrt() {
            *mean = 0.0;
        }
    }
}

/// Replaces a positive definite matrix by its Cholesky factor.
fn cholesky(rows: &mut [Vec<f64>]) {
    for i in 0..rows.len() {
        for j in 0..=i {
            let sum: f64 = (0..j).map(|k| rows[i][k] * rows[j][k]).sum();
            let rest = rows[i][j] - sum;
            // The diagonal is positive except for rounding errors.
            rows[i][j] = if i == j { rest.max(f64::MIN_POSITIVE).sqrt() } else { rest / rows[j][j] };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The density of N((1, -1), [[4, 1], [1, 2]]) by hand: det = 7, inverse [[2, -1], [-1, 4]]
    /// / 7.
    #[test]
    fn the_density_ratio_is_that_of_a_hand_calculation() {
        let mut factor = vec![vec![4.0], vec![1.0, 2.0]];
        cholesky(&mut factor);
        let gaussian = Gaussian { mean: vec![1.0, -1.0], factor };
        let a = 0.5 - 1.0;
        let b = 2.0 + 1.0;
        let quadratic = (2.0 * a * a - 2.0 * a * b + 4.0 * b * b) / 7.0;
        let expected = -0.5 * quadratic - 0.5 * 7.0_f64.ln() + 0.5 * (0.5 * 0.5 + 2.0 * 2.0);
        assert!((gaussian.log_ratio(&[0.5, 2.0]) - expected).abs() < 1e-12);
    }

    #[test]
    fn a_fit_to_many_points_has_their_mean_and_covariance() {
        let mut random = Sequence::new(1, 0);
        let points: Vec<Vec<f64>> = (0..20_000)
            .map(|_| {
                let (a, b) = random.normal_pair();
                vec![1.0 + 2.0 * a, 3.0 + a + b]
            })
            .collect();
        let fitted = Gaussian::fit(points.iter().map(|point| (point.as_slice(), 0.5))).unwrap();
        // The covariance [[4, 2], [2, 2]] times 3/2 has the factor √1.5 [[2, 0], [1, 1]]. Five
        // standard errors are below 0.1.
        let expected = [[2.0, 0.0], [1.0, 1.0]].map(|row| row.map(|x| x * 1.5_f64.sqrt()));
        assert!((fitted.mean[0] - 1.0).abs() < 0.1 && (fitted.mean[1] - 3.0).abs() < 0.1);
        for (i, row) in fitted.factor.iter().enumerate() {
            for (j, l) in row.iter().enumerate() {
                assert!((l - expected[i][j]).abs() < 0.1, "{:?}", fitted.factor);
            }
        }
        assert!(Gaussian::fit(std::iter::empty()).is_none());
    }
}
