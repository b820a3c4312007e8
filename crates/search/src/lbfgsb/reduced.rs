//! The matrix of the subspace problem, kept up to date as pairs arrive and coordinates become free or held.

use super::dense::Square;
use super::memory::Memory;

/// K over free and held coordinates, in the products it is made of.
///
/// ```text
/// K = [-D - YᵀZZᵀY/θ   (Lₐ - Rᵤ)ᵀ; Lₐ - Rᵤ   θSᵀAAᵀS]
/// ```
///
/// Z spans the free and A the held coordinates; Lₐ is the strictly lower triangle of SᵀAAᵀY, Rᵤ the upper triangle of
/// SᵀZZᵀY.
///
/// The products are updated, as in the published code, rather than formed anew, and only when a subspace problem is
/// solved. A pair that arrives while no coordinate is free is therefore never entered: once coordinates are free
/// again, K may be found indefinite, and the memory is emptied. Points depend on that, so it is kept.
///
/// # Reference
/// Byrd, Lu, Nocedal and Zhu 1995, section 5.1; the subroutines `formk` and `freev` of L-BFGS-B 3.0.
#[derive(Debug, Clone)]
pub(super) struct ReducedMatrix {
    d: usize,
    free: Vec<usize>,
    became_free: Vec<usize>,
    became_held: Vec<usize>,
    /// YᵀZZᵀY and SᵀAAᵀS, lower triangles.
    yy: Square,
    ss: Square,
    /// Lₐ below the diagonal, Rᵤ from it upwards.
    sy: Square,
}

impl ReducedMatrix {
    /// No pairs yet, out of `capacity`; all of `d` coordinates free.
    pub(super) fn new(d: usize, capacity: usize) -> Self {
        let empty = Square::zero(capacity);
        Self {
            d,
            free: (0..d).collect(),
            became_free: Vec::new(),
            became_held: Vec::new(),
            yy: empty.clone(),
            ss: empty.clone(),
            sy: empty,
        }
    }

    /// Notes which coordinates are free now, and what changed unless this is the `first` time.
    pub(super) fn set_free(&mut self, free: &[usize], first: bool) {
        let without = |a: &[usize], b: &[usize]| a.iter().copied().filter(|i| !b.contains(i)).collect();
        if !first {
            self.became_free = without(free, &self.free);
            self.became_held = without(&self.free, free);
        }
        self.free = free.to_vec();
    }

    /// Brings the products up to date and factorises: R with K = RᵀER, E = diag(-I, I).
    ///
    /// `None` if K is not of that form.
    pub(super) fn factor(&mut self, memory: &Memory) -> Option<Square> {
        let n = memory.len();
        let n_old = if memory.has_new_pair() { n - 1 } else { n };
        if memory.has_new_pair() {
            self.enter_newest(memory);
        }
        let over = |set: &[usize], a: &[f64], b: &[f64]| set.iter().map(|&i| a[i] * b[i]).sum::<f64>();
        for i in 0..n_old {
            for j in 0..n_old {
                let (s_i, y_j) = (&memory.s[i], &memory.y[j]);
                let gain =
                    |a: &[f64], b: &[f64]| over(&self.became_free, a, b) - over(&self.became_held, a, b);
                let sign = if i <= j { 1.0 } else { -1.0 };
                self.sy.add(i, j, sign * gain(s_i, y_j));
                if j <= i {
                    let (yy, ss) = (gain(&memory.y[i], y_j), gain(s_i, &memory.s[j]));
                    self.yy.add(i, j, yy);
                    self.ss.add(i, j, -ss);
                }
            }
        }
        self.assembled(memory)
    }

    fn enter_newest(&mut self, memory: &Memory) {
        let newest = memory.len() - 1;
        if memory.has_dropped_pair() {
            for product in [&mut self.yy, &mut self.ss, &mut self.sy] {
                product.shift();
            }
        }
        let held: Vec<usize> = (0..self.d).filter(|i| !self.free.contains(i)).collect();
        let over = |set: &[usize], a: &[f64], b: &[f64]| set.iter().map(|&i| a[i] * b[i]).sum::<f64>();
        let (s, y) = (&memory.s, &memory.y);
        for j in 0..=newest {
            self.yy.set(newest, j, over(&self.free, &y[newest], &y[j]));
            self.ss.set(newest, j, over(&held, &s[newest], &s[j]));
            self.sy.set(newest, j, over(&held, &s[newest], &y[j]));
        }
        for (i, s) in s.iter().enumerate() {
            self.sy.set(i, newest, over(&self.free, s, &y[newest]));
        }
    }

    fn assembled(&self, memory: &Memory) -> Option<Square> {
        let (n, theta) = (memory.len(), memory.theta);
        let mut k = Square::zero(2 * n);
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
        k.factorise(0..n)?;
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
        k.factorise(n..2 * n)?;
        Some(k)
    }
}
