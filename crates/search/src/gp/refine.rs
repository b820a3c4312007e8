//! Minimization of the lower confidence bound from a candidate, with gradients.

use nalgebra::{DMatrix, DVector};

use super::candidates::Region;
use super::surrogate::Surrogate;
use crate::RoundBased;
use crate::lbfgsb::{Lbfgsb, LbfgsbOptions};

/// Evaluations of the bound and its gradient for one point.
const EFFORT: usize = 14;

/// Returns a point of `region` with a lower bound than `start`: mean minus `kappa` standard
/// deviations. Integers and categories keep their levels. `None` without a model.
pub(super) fn refined(surrogate: &Surrogate, start: &[f64], region: &Region, kappa: f64) -> Option<Vec<f64>> {
    let model = surrogate.model()?;
    let space = surrogate.space();
    let edges: Vec<(f64, f64)> = (0..start.len()).map(|k| edge(surrogate, region, start, k)).collect();
    let unit = |x: f64, (low, width): (f64, f64)| {
        if width > 0.0 { ((x - low) / width).clamp(0.0, 1.0) } else { 0.0 }
    };
    let unit: Vec<f64> = start.iter().zip(&edges).map(|(x, edge)| unit(*x, *edge)).collect();
    let options = LbfgsbOptions {
        ftol: 1e-4,
        gtol: 1e-4,
        max_evaluations: EFFORT,
        max_line_search: 5,
        ..Default::default()
    };
    let mut search = Lbfgsb::from_inside(&unit, options);
    let mut best = (f64::INFINITY, start.to_vec());
    for _ in 0..EFFORT {
        let Some(unit) = search.round().first() else { break };
        // At the upper edge exactly 1, so that points on a face are on it.
        let inside = |(t, (low, width)): (&f64, &(f64, f64))| {
            if *t == 1.0 { low + width } else { low + t * width }
        };
        let point: Vec<f64> = unit.iter().zip(&edges).map(inside).map(|x| x.clamp(0.0, 1.0)).collect();
        let features = space.features(std::iter::once(point.as_slice()));
        let (value, by_feature) = bound_and_gradient(model, &features, kappa);
        let mut gradient = vec![0.0; point.len()];
        for (&k, g) in space.coordinate_of().iter().zip(by_feature.iter()) {
            gradient[k] = if edges[k].1 > 0.0 { g * edges[k].1 } else { 0.0 };
        }
        if value < best.0 {
            best = (value, point);
        }
        search.receive_gradient(value, gradient);
    }
    Some(best.1)
}

/// Returns lower end and width of the interval that coordinate `k` may move in.
fn edge(surrogate: &Surrogate, region: &Region, start: &[f64], k: usize) -> (f64, f64) {
    if !surrogate.space().is_continuous(k) {
        return (start[k], 0.0);
    }
    let low = (region.center[k] - region.half_edges[k]).max(0.0);
    let high = (region.center[k] + region.half_edges[k]).min(1.0);
    (low, high - low)
}

/// Returns m + kᵀα - κ s and its gradient by the features, s² = σ² (1 - |L⁻¹ k|²).
///
/// The derivative of correlation i by feature j is -slope(r²ᵢ) (aⱼ - aᵢⱼ) fⱼ with the scaled
/// features a and the factors f.
pub(super) fn bound_and_gradient(
    model: &super::regression::GaussianProcess,
    features: &DMatrix<f64>,
    kappa: f64,
) -> (f64, DVector<f64>) {
    let point = model.scaled(features);
    let rows = &model.points().rows;
    let squared = model.points().squared_distances(&point);
    let correlations =
        DVector::from_iterator(squared.len(), squared.iter().map(|r| super::kernel::correlation(*r)));
    let solved = model.solve(&correlations);
    let remaining = (1.0 - correlations.dot(&solved)).max(1e-12).sqrt();
    let deviation = model.variance.sqrt();
    let value = model.mean + correlations.dot(model.weights()) - kappa * deviation * remaining;
    let mut by_correlation = model.weights() + solved * (kappa * deviation / remaining);
    by_correlation.iter_mut().zip(squared.iter()).for_each(|(w, r)| *w *= super::kernel::slope(*r));
    let total = by_correlation.sum();
    let mut gradient = rows.tr_mul(&by_correlation);
    for (j, g) in gradient.iter_mut().enumerate() {
        *g = -model.factors()[j] * (point.rows[(0, j)] * total - *g);
    }
    (value, gradient)
}
