//! The Matérn-5/2 correlation with one length per coordinate.

use nalgebra::DMatrix;

use super::elementary::exp_of_nonpositive;

const SQRT_5: f64 = 2.236_067_977_499_79;

/// Returns the correlation (1 + √5 r + 5 r² / 3) exp(-√5 r) for a squared scaled distance r².
///
/// # Reference
/// Rasmussen and Williams, "Gaussian Processes for Machine Learning", 2006, equation 4.17.
#[inline(always)]
pub(super) fn correlation(squared: f64) -> f64 {
    let r = SQRT_5 * squared.sqrt();
    (1.0 + r + 5.0 / 3.0 * squared) * exp_of_nonpositive(-r)
}

/// Returns -2 times the derivative of the correlation by r²: (5 / 3) (1 + √5 r) exp(-√5 r).
#[inline(always)]
pub(super) fn slope(squared: f64) -> f64 {
    let r = SQRT_5 * squared.sqrt();
    5.0 / 3.0 * (1.0 + r) * exp_of_nonpositive(-r)
}

/// Points scaled by the lengths: one row per point, and the squared norms of the rows.
#[derive(Debug, Clone)]
pub(super) struct ScaledPoints {
    pub rows: DMatrix<f64>,
    pub squared_norms: Vec<f64>,
}

impl ScaledPoints {
    /// Scales points, given as the columns of `features`, by one factor per feature.
    pub(super) fn new(features: &DMatrix<f64>, factors: &[f64]) -> Self {
        // Features are in [0, 1]. Around their center the difference of squared norms loses fewer
        // digits.
        let rows = DMatrix::from_fn(features.ncols(), features.nrows(), |i, k| {
            (features[(k, i)] - 0.5) * factors[k]
        });
        let squared_norms = rows.row_iter().map(|row| row.norm_squared()).collect();
        Self { rows, squared_norms }
    }

    /// Adds points below the others.
    pub(super) fn extend(&mut self, more: &ScaledPoints) {
        let n = self.rows.nrows();
        let rows = std::mem::replace(&mut self.rows, DMatrix::zeros(0, 0));
        self.rows = rows.resize_vertically(n + more.rows.nrows(), 0.0);
        self.rows.rows_mut(n, more.rows.nrows()).copy_from(&more.rows);
        self.squared_norms.extend_from_slice(&more.squared_norms);
    }

    /// Returns the squared distances between all points and all `others`: one row per point, one
    /// column per other.
    pub(super) fn squared_distances(&self, others: &ScaledPoints) -> DMatrix<f64> {
        let mut squared = &self.rows * others.rows.transpose();
        for (j, mut column) in squared.column_iter_mut().enumerate() {
            let other = others.squared_norms[j];
            for (value, norm) in column.as_mut_slice().iter_mut().zip(&self.squared_norms) {
                *value = (-2.0 * *value + (norm + other)).max(0.0);
            }
        }
        squared
    }

    /// Returns the correlations between all points and all `others`.
    pub(super) fn correlations(&self, others: &ScaledPoints) -> DMatrix<f64> {
        let mut matrix = self.squared_distances(others);
        matrix.as_mut_slice().iter_mut().for_each(|value| *value = correlation(*value));
        matrix
    }
}
