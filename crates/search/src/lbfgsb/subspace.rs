//! The minimum of the model over the coordinates that are free at the Cauchy point, brought back into the box.

use super::cauchy::CauchyPoint;
use super::clipped;
use super::dense::{Square, dot};
use super::memory::Memory;

/// The point the line search heads for: the model's minimum over the free coordinates, inside [0,1]^d.
///
/// The Newton step is projected on the box; where the projected step would not descend, it is cut at the first face
/// instead. `None` if the reduced matrix is not positive definite.
///
/// # Reference
/// Byrd, Lu, Nocedal and Zhu 1995, section 5.1; Morales and Nocedal, "Remark on Algorithm 778", ACM TOMS 38, 2011.
pub(super) fn subspace_minimum(
    x: &[f64],
    g: &[f64],
    cauchy: &CauchyPoint,
    memory: &Memory,
) -> Option<Vec<f64>> {
    let step = newton_step(x, g, cauchy, memory)?;
    let mut projected = cauchy.x.clone();
    for (&i, d) in cauchy.free.iter().zip(&step) {
        projected[i] = clipped(cauchy.x[i] + d);
    }
    let meets_face = cauchy.free.iter().any(|&i| projected[i] == 0.0 || projected[i] == 1.0);
    let slope: f64 = projected.iter().zip(x).zip(g).map(|((p, x), g)| (p - x) * g).sum();
    Some(if meets_face && slope > 0.0 { cut_at_first_face(cauchy, step) } else { projected })
}

/// d = r/θ + Zᵀ W K⁻¹ Wᵀ Z r / θ² with r = -Zᵀ(g + B(x_cauchy - x)) over the free coordinates Z.
fn newton_step(x: &[f64], g: &[f64], cauchy: &CauchyPoint, memory: &Memory) -> Option<Vec<f64>> {
    let (n, theta) = (memory.len(), memory.theta);
    let matrix = reduced_matrix(x.len(), &cauchy.free, memory)?;
    let middle = memory.middle(&cauchy.c);
    let rows: Vec<Vec<f64>> = cauchy.free.iter().map(|&i| memory.row(i)).collect();
    let reduced = |(row, &i): (&Vec<f64>, &usize)| -theta * (cauchy.x[i] - x[i]) - g[i] + dot(row, &middle);
    let mut step: Vec<f64> = rows.iter().zip(&cauchy.free).map(reduced).collect();
    let mut v = vec![0.0; 2 * n];
    for (row, r) in rows.iter().zip(&step) {
        v.iter_mut().zip(row).for_each(|(v, w)| *v += w * r);
    }
    matrix.solve_transposed(&mut v);
    v[..n].iter_mut().for_each(|v| *v = -*v);
    matrix.solve(&mut v);
    for (row, d) in rows.iter().zip(&mut step) {
        *d = (*d + dot(row, &v) / theta) / theta;
    }
    Some(step)
}

/// The factors R of K = Rᵀ E R, E = diag(-I, I), over free and held coordinates.
///
/// ```text
/// K = [-D - YᵀZZᵀY/θ   Lₐᵀ - Rᵤᵀ; Lₐ - Rᵤ   θSᵀAAᵀS]
/// ```
///
/// Z spans the free and A the held coordinates; Lₐ is the strictly lower triangle of SᵀAAᵀY, Rᵤ the upper triangle
/// of SᵀZZᵀY.
fn reduced_matrix(d: usize, free: &[usize], memory: &Memory) -> Option<Square> {
    let (n, theta) = (memory.len(), memory.theta);
    let held: Vec<usize> = (0..d).filter(|i| free.binary_search(i).is_err()).collect();
    let over = |set: &[usize], a: &[f64], b: &[f64]| set.iter().map(|&i| a[i] * b[i]).sum::<f64>();
    let mut k = Square::zero(2 * n);
    for i in 0..n {
        let (s_i, y_i) = (&memory.s[i], &memory.y[i]);
        for j in 0..=i {
            k.set(j, i, over(free, y_i, &memory.y[j]) / theta);
            k.set(n + j, n + i, over(&held, s_i, &memory.s[j]) * theta);
        }
        k.set(i, i, k.at(i, i) + memory.curvature(i));
        for j in 0..n {
            let y_j = &memory.y[j];
            k.set(j, n + i, if j < i { -over(&held, s_i, y_j) } else { over(free, s_i, y_j) });
        }
    }
    k.factorise(0..n)?;
    for column in n..2 * n {
        let mut b: Vec<f64> = (0..n).map(|row| k.at(row, column)).collect();
        k.solve_transposed(&mut b);
        b.iter().enumerate().for_each(|(row, value)| k.set(row, column, *value));
    }
    for i in n..2 * n {
        for j in i..2 * n {
            let sum: f64 = (0..n).map(|row| k.at(row, i) * k.at(row, j)).sum();
            k.set(i, j, k.at(i, j) + sum);
        }
    }
    k.factorise(n..2 * n)?;
    Some(k)
}

/// Goes from the Cauchy point along the step, no further than the first face met.
fn cut_at_first_face(cauchy: &CauchyPoint, mut step: Vec<f64>) -> Vec<f64> {
    let mut point = cauchy.x.clone();
    let (mut share, mut first) = (1.0, None);
    for (k, (&i, &d)) in cauchy.free.iter().zip(&step).enumerate() {
        let room = if d < 0.0 { -point[i] } else { 1.0 - point[i] };
        let possible = if d == 0.0 {
            continue;
        } else if room * d <= 0.0 {
            0.0
        } else {
            room / d
        };
        if possible < share {
            (share, first) = (possible, Some(k));
        }
    }
    if let Some(k) = first {
        point[cauchy.free[k]] = if step[k] > 0.0 { 1.0 } else { 0.0 };
        step[k] = 0.0;
    }
    for (&i, d) in cauchy.free.iter().zip(&step) {
        point[i] += share * d;
    }
    point
}
