//! The posterior of a Gaussian process for given hyperparameters.

use nalgebra::{Cholesky, DMatrix, DVector};

use super::kernel::ScaledPoints;
use super::triangular::solve_lower;

/// The parameters of the correlation: one length per feature, and the variance of the noise as a
/// fraction of the variance of the process.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Correlation {
    pub lengths: Vec<f64>,
    pub noise: f64,
}

/// A Gaussian process with constant mean, conditioned on noisy targets.
///
/// # Reference
/// Rasmussen and Williams, "Gaussian Processes for Machine Learning", 2006, algorithm 2.1 and
/// section 5.4.2.
#[derive(Debug, Clone)]
pub(super) struct GaussianProcess {
    pub noise: f64,
    factors: Vec<f64>,
    points: ScaledPoints,
    /// The lower Cholesky factor L of the correlation matrix with the noise on its diagonal, R + λ
    /// I.
    factor: DMatrix<f64>,
    targets: DVector<f64>,
    /// (R + λ I)⁻¹ (targets - mean).
    weights: DVector<f64>,
    pub mean: f64,
    pub variance: f64,
}

/// Means and variances of the latent function at some points, with L⁻¹ k for each point as a
/// column.
pub(super) struct Posterior {
    pub means: Vec<f64>,
    pub variances: Vec<f64>,
    pub whitened: DMatrix<f64>,
}

impl GaussianProcess {
    /// Factors the correlation matrix of the points, which are the columns of `features`. `None` if
    /// it is not numerically positive definite.
    pub(super) fn new(features: &DMatrix<f64>, parameters: &Correlation) -> Option<Self> {
        let factors: Vec<f64> = parameters.lengths.iter().map(|length| length.recip()).collect();
        let points = ScaledPoints::new(features, &factors);
        let factor = factor_of(points.correlations(&points), parameters.noise)?;
        let n = features.ncols();
        Some(Self {
            noise: parameters.noise,
            factors,
            points,
            factor,
            targets: DVector::zeros(n),
            weights: DVector::zeros(n),
            mean: 0.0,
            variance: 1.0,
        })
    }

    /// Returns the number of points.
    pub(super) fn len(&self) -> usize {
        self.factor.nrows()
    }

    /// Adds points, and extends the factor by the rows of a blocked Cholesky factorization. Targets
    /// must be set again.
    ///
    /// Returns `false`, and changes nothing, if the extended matrix is not numerically positive
    /// definite.
    #[must_use]
    pub(super) fn extend(&mut self, features: &DMatrix<f64>) -> bool {
        let n = self.len();
        let added = features.ncols();
        let points = ScaledPoints::new(features, &self.factors);
        let mut across = self.points.correlations(&points);
        solve_lower(&self.factor, &mut across);
        let mut corner = points.correlations(&points);
        corner.gemm(-1.0, &across.transpose(), &across, 1.0);
        let Some(corner) = factor_of(corner, self.noise) else { return false };
        let factor = std::mem::replace(&mut self.factor, DMatrix::zeros(0, 0));
        self.factor = factor.resize(n + added, n + added, 0.0);
        self.factor.view_mut((n, 0), (added, n)).tr_copy_from(&across);
        self.factor.view_mut((n, n), (added, added)).copy_from(&corner);
        self.points.extend(&points);
        true
    }

    /// Conditions on targets. The mean is the generalized least-squares estimate, the variance that
    /// of [`posterior_variance`].
    pub(super) fn condition(&mut self, targets: &[f64]) {
        let ones = self.solve(&DVector::repeat(targets.len(), 1.0));
        let targets = DVector::from_column_slice(targets);
        self.mean = ones.dot(&targets) / ones.sum();
        self.condition_around(self.mean, &targets);
        let squares = self.weights.dot(&targets.add_scalar(-self.mean));
        self.variance = posterior_variance(squares, targets.len());
        self.targets = targets;
    }

    fn condition_around(&mut self, mean: f64, targets: &DVector<f64>) {
        self.weights = self.solve(&targets.add_scalar(-mean));
    }

    /// Conditions on targets with a known mean and variance.
    #[cfg(test)]
    pub(super) fn condition_with(&mut self, targets: &[f64], mean: f64, variance: f64) {
        (self.targets, self.mean, self.variance) = (DVector::from_column_slice(targets), mean, variance);
        self.condition_around(mean, &self.targets.clone());
    }

    /// Returns (R + λ I)⁻¹ `right`.
    pub(super) fn solve(&self, right: &DVector<f64>) -> DVector<f64> {
        let mut solution = right.clone();
        self.factor.solve_lower_triangular_unchecked_mut(&mut solution);
        self.factor.tr_solve_lower_triangular_unchecked(&solution)
    }

    /// Scales points, given as columns of features, for the other functions.
    pub(super) fn scaled(&self, features: &DMatrix<f64>) -> ScaledPoints {
        ScaledPoints::new(features, &self.factors)
    }

    /// Returns the correlations between the points of the model (rows) and others (columns).
    pub(super) fn correlations(&self, others: &ScaledPoints) -> DMatrix<f64> {
        self.points.correlations(others)
    }

    /// Returns the points of the model.
    pub(super) fn points(&self) -> &ScaledPoints {
        &self.points
    }

    /// Returns the factors that scale features.
    pub(super) fn factors(&self) -> &[f64] {
        &self.factors
    }

    /// Returns (R + λ I)⁻¹ (targets - mean).
    pub(super) fn weights(&self) -> &DVector<f64> {
        &self.weights
    }

    /// Returns the targets.
    pub(super) fn targets(&self) -> &DVector<f64> {
        &self.targets
    }

    /// Returns mean and variance of the latent function at others.
    pub(super) fn posterior(&self, others: &ScaledPoints) -> Posterior {
        let mut whitened = self.correlations(others);
        let means = whitened.tr_mul(&self.weights).iter().map(|value| self.mean + value).collect();
        solve_lower(&self.factor, &mut whitened);
        let explained = whitened.column_iter().map(|column| column.norm_squared());
        let variances = explained.map(|share| self.variance * (1.0 - share).max(0.0)).collect();
        Posterior { means, variances, whitened }
    }

    /// Returns the log marginal likelihood of the targets.
    #[cfg(test)]
    pub(super) fn log_likelihood(&self) -> f64 {
        let n = self.len() as f64;
        let squares = self.weights.dot(&self.targets.add_scalar(-self.mean));
        let log_determinant: f64 = 2.0 * self.factor.diagonal().iter().map(|x| x.ln()).sum::<f64>();
        -0.5 * (squares / self.variance + n * (std::f64::consts::TAU * self.variance).ln() + log_determinant)
    }

    /// Returns, for each point, the mean that the model of all other points predicts there, with
    /// the same hyperparameters and mean: tᵢ - wᵢ / [(R + λ I)⁻¹]ᵢᵢ.
    pub(super) fn leave_one_out(&self) -> Vec<f64> {
        let n = self.len();
        let mut inverse = DMatrix::identity(n, n);
        solve_lower(&self.factor, &mut inverse);
        let diagonal = inverse.column_iter().map(|column| column.norm_squared());
        let pairs = self.targets.iter().zip(self.weights.iter()).zip(diagonal);
        pairs.map(|((target, weight), diagonal)| target - weight / diagonal).collect()
    }
}

/// The weight of the prior of the variance, in observations.
pub(super) const PRIOR_OBSERVATIONS: f64 = 2.0;

/// Returns the estimate of the process variance from rᵀ (R + λ I)⁻¹ r of n residuals: the mode
/// under a scaled inverse χ² prior around 1, the variance of standardized targets. It is positive
/// for constant targets, too.
pub(super) fn posterior_variance(squares: f64, n: usize) -> f64 {
    (squares + PRIOR_OBSERVATIONS) / (n as f64 + PRIOR_OBSERVATIONS)
}

/// Returns the lower Cholesky factor of `matrix` + `noise` I.
pub(super) fn factor_of(mut matrix: DMatrix<f64>, noise: f64) -> Option<DMatrix<f64>> {
    for i in 0..matrix.nrows() {
        matrix[(i, i)] += noise;
    }
    Cholesky::new(matrix).map(Cholesky::unpack)
}
