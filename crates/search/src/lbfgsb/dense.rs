//! Dense linear algebra for small symmetric systems.

/// A square matrix of order `n`, row-major.
#[derive(Debug, Clone, Default)]
pub(super) struct SquareMatrix {
    n: usize,
    entries: Vec<f64>,
}

impl SquareMatrix {
    /// Creates the zero matrix of order `n`.
    pub(super) fn zero(n: usize) -> Self {
        Self { n, entries: vec![0.0; n * n] }
    }

    pub(super) fn at(&self, row: usize, column: usize) -> f64 {
        self.entries[row * self.n + column]
    }

    pub(super) fn set(&mut self, row: usize, column: usize, value: f64) {
        self.entries[row * self.n + column] = value;
    }

    pub(super) fn add(&mut self, row: usize, column: usize, value: f64) {
        self.entries[row * self.n + column] += value;
    }

    /// Moves every entry up and left by one, overwriting the first row and column. The last row and
    /// column are unchanged.
    pub(super) fn shift(&mut self) {
        for row in 1..self.n {
            for column in 1..self.n {
                self.set(row - 1, column - 1, self.at(row, column));
            }
        }
    }

    /// Computes the Cholesky factor R with RᵀR = A of a diagonal block in its upper triangle.
    ///
    /// `None` if the block is not positive definite.
    pub(super) fn factorize(&mut self, block: std::ops::Range<usize>) -> Option<()> {
        for j in block.clone() {
            for i in block.start..=j {
                let sum: f64 = (block.start..i).map(|k| self.at(k, i) * self.at(k, j)).sum();
                let rest = self.at(i, j) - sum;
                if i < j {
                    self.set(i, j, rest / self.at(i, i));
                } else if rest > 0.0 {
                    self.set(j, j, rest.sqrt());
                } else {
                    return None;
                }
            }
        }
        Some(())
    }

    /// Solves Rᵀx = b in place, where R is the upper triangle of the first `b.len()` rows.
    pub(super) fn solve_transposed(&self, b: &mut [f64]) {
        for i in 0..b.len() {
            let sum: f64 = (0..i).map(|k| self.at(k, i) * b[k]).sum();
            b[i] = (b[i] - sum) / self.at(i, i);
        }
    }

    /// Solves Rx = b in place, where R is the upper triangle of the first `b.len()` rows.
    pub(super) fn solve(&self, b: &mut [f64]) {
        for i in (0..b.len()).rev() {
            let sum: f64 = (i + 1..b.len()).map(|k| self.at(i, k) * b[k]).sum();
            b[i] = (b[i] - sum) / self.at(i, i);
        }
    }
}

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A = [4 2; 2 5] = RᵀR with R = [2 1; 0 2]; A x = (8, 14) has x = (3/4, 5/2).
    #[test]
    fn cholesky_solves_a_positive_definite_system() {
        let mut a = SquareMatrix::zero(2);
        for (row, column, value) in [(0, 0, 4.0), (0, 1, 2.0), (1, 1, 5.0)] {
            a.set(row, column, value);
        }
        assert!(a.factorize(0..2).is_some());
        assert_eq!([a.at(0, 0), a.at(0, 1), a.at(1, 1)], [2.0, 1.0, 2.0]);
        let mut x = [8.0, 14.0];
        a.solve_transposed(&mut x);
        a.solve(&mut x);
        assert_eq!(x, [0.75, 2.5]);
    }

    #[test]
    fn a_matrix_that_is_not_positive_definite_has_no_factor() {
        let mut a = SquareMatrix::zero(1);
        for diagonal in [-1.0, 0.0, f64::NAN] {
            a.set(0, 0, diagonal);
            assert!(a.factorize(0..1).is_none(), "{diagonal}");
        }
    }
}
