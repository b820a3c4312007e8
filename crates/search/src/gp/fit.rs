//! Hyperparameters by maximum marginal likelihood with priors.

use nalgebra::{DMatrix, DVector};

use super::kernel::{ScaledPoints, correlation, slope};
use super::regression::{Correlation, PRIOR_OBSERVATIONS, factor_of, posterior_variance};
use super::triangular::solve_lower;
use crate::RoundBased;
use crate::lbfgsb::{Lbfgsb, LbfgsbOptions};

/// The bounds of the logarithms of lengths, in units of the box. Longer lengths than 30 √d are
/// indistinguishable from a coordinate without effect.
const SHORTEST: f64 = 0.02;
const LONGEST: f64 = 30.0;
/// The bounds of the noise.
const NOISE: (f64, f64) = (1e-6, 1.0);
/// Standard deviations of the logarithms of the lengths: of the value that all have in common, and
/// of each around it.
///
/// A few dozen points cannot tell the lengths of many coordinates apart. With independent wide
/// priors the fit invents differences that mislead the search; with this one, lengths differ only
/// as far as the data require.
const COMMON_DEVIATION: f64 = 1.732_050_807_568_877_2;
const LENGTH_DEVIATION: f64 = 0.4;
/// The prior of the logarithm of the noise: mean and standard deviation.
const NOISE_PRIOR: (f64, f64) = (-7.0, 2.5);

/// The data of a fit: features as columns, the coordinate of each feature, and the targets.
pub(super) struct Data<'a> {
    pub features: &'a DMatrix<f64>,
    pub coordinate_of: &'a [usize],
    pub targets: &'a [f64],
    pub dimension: usize,
}

/// The logarithms of the d lengths and of the noise.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct LogParameters(pub Vec<f64>);

impl LogParameters {
    /// Returns the means of the priors.
    pub(super) fn prior_means(dimension: usize) -> Self {
        let length = mean_log_length(dimension);
        let mut values = vec![length; dimension];
        values.push(NOISE_PRIOR.0);
        Self(values)
    }

    /// Returns the parameters of the correlation, with one length per feature.
    pub(super) fn correlation(&self, coordinate_of: &[usize]) -> Correlation {
        let noise = self.0[self.0.len() - 1].exp();
        Correlation { lengths: coordinate_of.iter().map(|&k| self.0[k].exp()).collect(), noise }
    }

    /// Returns the lengths of the coordinates.
    pub(super) fn lengths(&self) -> Vec<f64> {
        self.0[..self.0.len() - 1].iter().map(|x| x.exp()).collect()
    }
}

/// Returns parameters with a larger posterior density than `start`, after at most `max_evaluations`
/// evaluations of the density.
pub(super) fn fit(data: &Data<'_>, start: &LogParameters, max_evaluations: usize) -> LogParameters {
    let bounds = bounds(data.dimension);
    let to_unit = |x: f64, (low, high): (f64, f64)| ((x - low) / (high - low)).clamp(0.0, 1.0);
    let unit: Vec<f64> = start.0.iter().zip(&bounds).map(|(x, b)| to_unit(*x, *b)).collect();
    let options =
        LbfgsbOptions { ftol: 1e-4, gtol: 1e-2, max_evaluations, max_line_search: 6, ..Default::default() };
    let mut search = Lbfgsb::from_inside(&unit, options);
    let mut best = (f64::INFINITY, start.clone());
    for _ in 0..max_evaluations {
        let Some(point) = search.round().first() else { break };
        let parameters =
            LogParameters(point.iter().zip(&bounds).map(|(u, (low, high))| low + u * (high - low)).collect());
        let Some((value, mut gradient)) = negative_log_posterior(data, &parameters) else { break };
        if value < best.0 {
            best = (value, parameters);
        }
        gradient.iter_mut().zip(&bounds).for_each(|(g, (low, high))| *g *= high - low);
        search.receive_gradient(value, gradient);
    }
    best.1
}

fn bounds(dimension: usize) -> Vec<(f64, f64)> {
    let longest = (LONGEST * (dimension as f64).sqrt()).ln();
    let mut bounds = vec![(SHORTEST.ln(), longest); dimension];
    bounds.push((NOISE.0.ln(), NOISE.1.ln()));
    bounds
}

/// Returns the negative logarithm of the posterior density of the parameters, up to a constant, and
/// its gradient.
///
/// Mean m and variance σ² of the process are at their optima, so that their derivatives vanish.
/// With r = t - m, R̃ = R + λ I, α = R̃⁻¹ r and the weight b of the prior of the variance in
/// observations,
///
/// ```text
/// f = (n + b) / 2 ln σ² + ln |R̃| / 2 + priors,  σ² = (rᵀ α + b) / (n + b)
/// ∂f = tr(W ∂R̃) / 2 + ∂priors,  W = R̃⁻¹ - α αᵀ / σ²
/// ```
///
/// `None` if R̃ is not numerically positive definite.
pub(super) fn negative_log_posterior(data: &Data<'_>, parameters: &LogParameters) -> Option<(f64, Vec<f64>)> {
    let correlation_parameters = parameters.correlation(data.coordinate_of);
    let noise = correlation_parameters.noise;
    let n = data.targets.len();
    let factors: Vec<f64> = correlation_parameters.lengths.iter().map(|length| length.recip()).collect();
    let points = ScaledPoints::new(data.features, &factors);
    let squared = points.squared_distances(&points);
    let factor = factor_of(squared.map(correlation), noise)?;
    let log_determinant: f64 = 2.0 * factor.diagonal().iter().map(|x| x.ln()).sum::<f64>();

    let mut inverse_factor = DMatrix::identity(n, n);
    solve_lower(&factor, &mut inverse_factor);
    let mut w = inverse_factor.transpose() * &inverse_factor;
    let targets = DVector::from_column_slice(data.targets);
    let mean = w.column_sum().dot(&targets) / w.sum();
    let residuals = targets.add_scalar(-mean);
    let weights = &w * &residuals;
    let variance = posterior_variance(residuals.dot(&weights), n);
    w.ger(-variance.recip(), &weights, &weights, 1.0);

    let mut gradient = vec![0.0; data.dimension + 1];
    gradient[data.dimension] = 0.5 * noise * w.trace();
    add_length_gradient(&mut gradient, data, &points, w, &squared);
    let likelihood = 0.5 * (n as f64 + PRIOR_OBSERVATIONS) * variance.ln() + 0.5 * log_determinant;
    Some((likelihood + add_priors(&mut gradient, parameters), gradient))
}

/// Adds tr(W ∂R) / 2 for the logarithm of each length.
///
/// With the scaled coordinates a, the derivative of Rᵢⱼ by ln ℓₖ is slope(r²ᵢⱼ) (aᵢₖ - aⱼₖ)². For
/// the symmetric M with the elements Wᵢⱼ slope(r²ᵢⱼ), the sum over i and j is 2 Σᵢ a²ᵢₖ Σⱼ Mᵢⱼ - 2
/// aₖᵀ M aₖ.
fn add_length_gradient(
    gradient: &mut [f64],
    data: &Data<'_>,
    points: &ScaledPoints,
    mut w: DMatrix<f64>,
    squared: &DMatrix<f64>,
) {
    w.zip_apply(squared, |w, squared| *w *= slope(squared));
    let sums = w.column_sum();
    let product = w * &points.rows;
    for (feature, &coordinate) in data.coordinate_of.iter().enumerate() {
        let a = points.rows.column(feature);
        let squares: f64 = a.iter().zip(sums.iter()).map(|(a, sum)| a * a * sum).sum();
        gradient[coordinate] += squares - a.dot(&product.column(feature));
    }
}

/// Adds the gradient of the negative log prior, and returns its value.
///
/// The logarithms of the lengths are a common value plus deviations, all normal. With their average
/// a, the mean μ of the prior and the variances τ² of a deviation and s² of the common value, the
/// exponent is
///
/// ```text
/// Σ (xₖ - a)² / (2 τ²) + d (a - μ)² / (2 (τ² + d s²))
/// ```
fn add_priors(gradient: &mut [f64], parameters: &LogParameters) -> f64 {
    let dimension = parameters.0.len() - 1;
    let (lengths, noise) = parameters.0.split_at(dimension);
    let d = dimension as f64;
    let average = lengths.iter().sum::<f64>() / d;
    let offset = average - mean_log_length(dimension);
    let spread = LENGTH_DEVIATION * LENGTH_DEVIATION;
    let pull = offset / (spread + d * COMMON_DEVIATION * COMMON_DEVIATION);
    let mut value = 0.5 * d * pull * offset;
    for (g, x) in gradient.iter_mut().zip(lengths) {
        value += 0.5 * (x - average) * (x - average) / spread;
        *g += (x - average) / spread + pull;
    }
    let standardized = (noise[0] - NOISE_PRIOR.0) / NOISE_PRIOR.1;
    gradient[dimension] += standardized / NOISE_PRIOR.1;
    value + 0.5 * standardized * standardized
}

/// Returns the mean of the prior of the logarithm of a length, √2 + ln √d.
///
/// # Reference
/// Hvarfner, Hellsten and Nardi, "Vanilla Bayesian optimization performs great in high dimensions",
/// ICML 2024: with lengths that grow with √d, the model does not become more complex with the
/// dimension.
fn mean_log_length(dimension: usize) -> f64 {
    std::f64::consts::SQRT_2 + 0.5 * (dimension as f64).ln()
}
