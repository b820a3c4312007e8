//! The matrix K of the subspace minimization, updated with every correction pair and every change
//! of free coordinates.

use super::dense::SquareMatrix;
use super::memory::Memory;

/// The inner products that K consists of, over free and fixed coordinates.
///
/// ```text
/// K = [-D - YᵀZZᵀY/θ   (Lₐ - Rᵤ)ᵀ; Lₐ - Rᵤ   θSᵀAAᵀS]
/// ```
///
/// Z spans the free and A the fixed coordinates; Lₐ is the strictly lower triangle of SᵀAAᵀY, Rᵤ
/// the upper triangle of SᵀZZᵀY.
///
/// As in the published code, the products are updated instead of recomputed, and only when a
/// subspace problem is solved. So a pair that arrives while no coordinate is free is never
/// included. When coordinates become free again, K may be indefinite, and the memory is cleared.
/// The points depend on this behavior, so it must stay.
///
/// # Reference
/// Byrd, Lu, Nocedal and Zhu 1995, section 5.1; the subroutines `formk` and `freev` of L-BFGS-B
/// 3.0.
#[derive(Debug, Clone)]
pub(super) struct ReducedMatrix {
    d: usize,
    free: Vec<usize>,
    became_free: Vec<usize>,
    became_fixed: Vec<usize>,
    /// YᵀZZᵀY and SᵀAAᵀS, lower triangles.
    yy: SquareMatrix,
    ss: SquareMatrix,
    /// Lₐ below the diagonal, Rᵤ from it upwards.
    sy: SquareMatrix,
}

impl ReducedMatrix {
    /// Creates the products of an empty memory for `capacity` pairs, with all `d` coordinates free.
    pub(super) fn new(d: usize, capacity: usize) -> Self {
        let empty = SquareMatrix::zero(capacity);
        Self {
            d,
            free: (0..d).collect(),
            became_free: Vec::new(),
            became_fixed: Vec::new(),
            yy: empty.clone(),
            ss: empty.clone(),
            sy: empty,
        }
    }

    /// Sets the free coordinates and, unless this is the `first` call, determines the changes.
    pub(super) fn set_free(&mut self, free: &[usize], first: bool) {
        let without = |a: &[usize], b: &[usize]| a.iter().copied().filter(|i| !b.contains(i)).collect();
        if !first {
            self.became_free = without(free, &self.free);
            self.became_fixed = without(&self.free, free);
        }
        self.free = free.to_vec();
    }

    /// Updates the products and factorizes K = RᵀER with E = diag(-I, I). Returns R.
    ///
    /// `None` if K has no such factorization.
    pub(super) fn factor(&mut self, memory: &Memory) -> Option<SquareMatrix> {
        let n = memory.len();
        let n_old = if memory.has_new_pair() { n - 1 } else { n };
        if memory.has_new_pair() {
            self.insert_newest(memory);
        }
        let over = |set: &[usize], a: &[f64], b: &[f64]| set.iter().map(|&i| a[i] * b[i]).sum::<f64>();
        for i in 0..n_old {
            for j in 0..n_old {
                let s_i = &memory.s[i];
                let y_j = &memory.y[j];
                let change =
                    |a: &[f64], b: &[f64]| over(&self.became_free, a, b) - over(&self.became_fixed, a, b);
                let sign = if i <= j { 1.0 } else { -1.0 };
                self.sy.add(i, j, sign * change(s_i, y_j));
                if j <= i {
                    let yy = change(&memory.y[i], y_j);
                    let ss = change(s_i, &memory.s[j]);
                    self.yy.add(i, j, yy);
                    self.ss.add(i, j, -ss);
                }
            }
        }
        self.assembled(memory)
    }

    fn insert_newest(&mut self, memory: &Memory) {
        let newest = memory.len() - 1;
        if memory.has_dropped_pair() {
            for product in [&mut self.yy, &mut self.ss, &mut self.sy] {
                product.shift();
            }
        }
        let fixed: Vec<usize> = (0..self.d).filter(|i| !self.free.contains(i)).collect();
        let over = |set: &[usize], a: &[f64], b: &[f64]| set.iter().map(|&i| a[i] * b[i]).sum::<f64>();
        let s = &memory.s;
        let y = &memory.y;
        for j in 0..=newest {
            self.yy.set(newest, j, over(&self.free, &y[newest], &y[j]));
            self.ss.set(newest, j, over(&fixed, &s[newest], &s[j]));
            self.sy.set(newest, j, over(&fixed, &s[newest], &y[j]));
        }
        for (i, s) in s.iter().enumerate() {
            self.sy.set(i, newest, over(&self.free, s, &y[newest]));
        }
    }

    fn assembled(&self, memory: &Memory) -> Option<SquareMatrix> {
        let n = memory.len();
        let theta = memory.theta;
        let mut k = SquareMatrix::zero(2 * n);
        for i in 0..n {
            for j in 0..=i {
                k.set(j, i, self.yy.at(i, j) / theta);
                k.set(n + j, n + i, self.ss.at(i, j) * theta);
            }
            k.add(i, i, memory.curvature(i));
            for j in 0..n {
                k.set(j, n + i, if j < i { -self.sy.at(i, j) } else { self.sy.at(i, j) });
            }
        }
        k.factorize(0..n)?;
        for column in n..2 * n {
            let mut b: Vec<f64> = (0..n).map(|row| k.at(row, column)).collect();
            k.solve_transposed(&mut b);
            b.iter().enumerate().for_each(|(row, value)| k.set(row, column, *value));
        }
        for i in n..2 * n {
            for j in i..2 * n {
                k.add(i, j, (0..n).map(|row| k.at(row, i) * k.at(row, j)).sum());
            }
        }
        k.factorize(n..2 * n)?;
        Some(k)
    }
}
