//! Samples of the posterior as functions: a sample of the prior plus the correction that the data
//! require.

use mishandle_random::Sequence;
use nalgebra::{DMatrix, DVector};

use super::elementary::cosine_of_turns;
use super::regression::GaussianProcess;

/// The number of random Fourier features that approximate the prior.
const FEATURES: usize = 256;

/// Returns `n` samples of the posterior at points, given as columns of features: one row per point,
/// one column per sample.
///
/// A sample is f(x) + k(x)ᵀ (R + λ I)⁻¹ (t - f(X) - ε). The sample f of the prior is a sum of
/// cosines with frequencies from the spectral density of the Matérn-5/2 correlation, which is the
/// density of Student's t with 5 degrees of freedom.
///
/// # Reference
/// Wilson, Borovitskiy, Terenin, Mostowsky and Deisenroth, "Efficiently sampling functions from
/// Gaussian process posteriors", ICML 2020. Rahimi and Recht, "Random features for large-scale
/// kernel machines", NIPS 2007.
pub(super) fn posterior_samples(
    model: &GaussianProcess,
    features: &DMatrix<f64>,
    n: usize,
    stream: &mut Sequence,
) -> DMatrix<f64> {
    let others = model.scaled(features);
    let frequencies = frequencies(features.nrows(), stream) / std::f64::consts::TAU;
    let phases: Vec<f64> = (0..FEATURES).map(|_| stream.uniform()).collect();
    let amplitudes = normals(FEATURES, n, stream) * (2.0 * model.variance / FEATURES as f64).sqrt();
    let prior = |rows: &DMatrix<f64>| cosines(rows * &frequencies, &phases) * &amplitudes;

    let mut samples = prior(&others.rows);
    let noise = normals(model.len(), n, stream) * (model.variance * model.noise).sqrt();
    let mut residuals = prior(&model.points().rows) + noise;
    for mut column in residuals.column_iter_mut() {
        let residual: DVector<f64> = (model.targets() - &column).add_scalar(-model.mean);
        column.copy_from(&model.solve(&residual));
    }
    samples.gemm(1.0, &model.correlations(&others).transpose(), &residuals, 1.0);
    samples.add_scalar_mut(model.mean);
    samples
}

/// Returns one frequency per column: a normal vector over the root of an independent χ² variable
/// per degree of freedom.
fn frequencies(n_features: usize, stream: &mut Sequence) -> DMatrix<f64> {
    let mut frequencies = normals(n_features, FEATURES, stream);
    let squares = normals(5, FEATURES, stream);
    for (mut frequency, square) in frequencies.column_iter_mut().zip(squares.column_iter()) {
        frequency *= (5.0 / square.norm_squared().max(f64::MIN_POSITIVE)).sqrt();
    }
    frequencies
}

/// Returns the cosines of angles with one phase per column, all as fractions of a turn.
fn cosines(mut angles: DMatrix<f64>, phases: &[f64]) -> DMatrix<f64> {
    for (mut column, phase) in angles.column_iter_mut().zip(phases) {
        column.as_mut_slice().iter_mut().for_each(|angle| *angle = cosine_of_turns(*angle + phase));
    }
    angles
}

fn normals(rows: usize, columns: usize, stream: &mut Sequence) -> DMatrix<f64> {
    let mut matrix = DMatrix::zeros(rows, columns);
    for pair in matrix.as_mut_slice().chunks_mut(2) {
        let (a, b) = stream.normal_pair();
        pair[0] = a;
        if let Some(second) = pair.get_mut(1) {
            *second = b;
        }
    }
    matrix
}
