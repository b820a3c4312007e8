//! Subspace minimization: the minimizer of the model over the coordinates that are free at the
//! Cauchy point.

use super::cauchy::CauchyPoint;
use super::clipped;
use super::dense::{SquareMatrix, dot};
use super::memory::Memory;

/// Returns the target of the line search: the model's minimizer over the free coordinates, inside
/// `[0,1]^d`.
///
/// The Newton step is projected on `[0,1]^d`. If the projected step is not a descent direction, the
/// Newton step is truncated at the first bound instead. `factor` is the factor of the
/// [`ReducedMatrix`](super::reduced::ReducedMatrix) for these free coordinates.
///
/// # Reference
/// Byrd, Lu, Nocedal and Zhu 1995, section 5.1; Morales and Nocedal, "Remark on Algorithm 778", ACM
/// TOMS 38, 2011.
pub(super) fn subspace_minimum(
    x: &[f64],
    g: &[f64],
    cauchy: &CauchyPoint,
    memory: &Memory,
    factor: &SquareMatrix,
) -> Vec<f64> {
    let step = newton_step(x, g, cauchy, memory, factor);
    let mut projected = cauchy.x.clone();
    for (&i, d) in cauchy.free.iter().zip(&step) {
        projected[i] = clipped(cauchy.x[i] + d);
    }
    let is_at_bound = cauchy.free.iter().any(|&i| projected[i] == 0.0 || projected[i] == 1.0);
    let slope: f64 = projected.iter().zip(x).zip(g).map(|((p, x), g)| (p - x) * g).sum();
    if is_at_bound && slope > 0.0 { truncated_at_bound(cauchy, step) } else { projected }
}

/// Returns d = r/θ + Zᵀ W K⁻¹ Wᵀ Z r / θ² with r = -Zᵀ(g + B(x_cauchy - x)) over the free
/// coordinates Z.
fn newton_step(
    x: &[f64],
    g: &[f64],
    cauchy: &CauchyPoint,
    memory: &Memory,
    factor: &SquareMatrix,
) -> Vec<f64> {
    let n = memory.len();
    let theta = memory.theta;
    let middle = memory.middle(&cauchy.c);
    let rows: Vec<Vec<f64>> = cauchy.free.iter().map(|&i| memory.row(i)).collect();
    let reduced = |(row, &i): (&Vec<f64>, &usize)| -theta * (cauchy.x[i] - x[i]) - g[i] + dot(row, &middle);
    let mut step: Vec<f64> = rows.iter().zip(&cauchy.free).map(reduced).collect();
    let mut v = vec![0.0; 2 * n];
    for (row, r) in rows.iter().zip(&step) {
        v.iter_mut().zip(row).for_each(|(v, w)| *v += w * r);
    }
    factor.solve_transposed(&mut v);
    v[..n].iter_mut().for_each(|v| *v = -*v);
    factor.solve(&mut v);
    for (row, d) in rows.iter().zip(&mut step) {
        *d = (*d + dot(row, &v) / theta) / theta;
    }
    step
}

/// Returns the Cauchy point plus the step, truncated at the first bound.
fn truncated_at_bound(cauchy: &CauchyPoint, mut step: Vec<f64>) -> Vec<f64> {
    let mut point = cauchy.x.clone();
    let mut scale = 1.0;
    let mut first = None;
    for (k, (&i, &d)) in cauchy.free.iter().zip(&step).enumerate() {
        let room = if d < 0.0 { -point[i] } else { 1.0 - point[i] };
        let possible = if d == 0.0 {
            continue;
        } else if room * d <= 0.0 {
            0.0
        } else {
            room / d
        };
        if possible < scale {
            (scale, first) = (possible, Some(k));
        }
    }
    if let Some(k) = first {
        point[cauchy.free[k]] = if step[k] > 0.0 { 1.0 } else { 0.0 };
        step[k] = 0.0;
    }
    for (&i, d) in cauchy.free.iter().zip(&step) {
        point[i] += scale * d;
    }
    point
}
