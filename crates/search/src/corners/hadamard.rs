//! Hadamard matrices by Paley's first construction and by Sylvester's doubling.

/// A Hadamard matrix: signs in which each two columns agree in half of the rows. The first column
/// is all +1.
///
/// Its other columns are a two-level orthogonal array of strength 2, a Plackett-Burman design. With
/// the rows of opposite signs added (foldover) the strength is 3: each combination of signs of
/// three columns occurs equally often.
///
/// # Reference
/// Paley, "On orthogonal matrices", J. Math. Phys. 12, 1933. Plackett and Burman, "The design of
/// optimum multifactorial experiments", Biometrika 33, 1946.
#[derive(Debug, Clone)]
pub(crate) struct Hadamard {
    /// Order of the matrix that is doubled: 1, or q + 1.
    base: usize,
    doublings: u32,
    /// Whether a number modulo the prime q is the square of another number than 0; empty for a base
    /// of 1.
    is_square: Vec<bool>,
}

impl Hadamard {
    /// Creates the smallest of these matrices with at least `columns` columns: orders 2^k, and 2^k
    /// (q + 1) for primes q of the form 4 m + 3.
    pub(crate) fn with_columns(columns: usize) -> Self {
        let primes = (3..columns + 4).step_by(4).filter(|q| is_prime(*q));
        let doublings = |base: usize| columns.div_ceil(base).next_power_of_two().trailing_zeros();
        let smallest = primes.map(|q| q + 1).chain([1]).min_by_key(|base| base << doublings(*base));
        let base = smallest.unwrap_or(1);
        let mut is_square = vec![false; base - 1];
        (1..base.saturating_sub(1)).for_each(|x| is_square[x * x % (base - 1)] = true);
        Self { base, doublings: doublings(base), is_square }
    }

    /// Returns the order: the number of rows and columns.
    pub(crate) fn order(&self) -> usize {
        self.base << self.doublings
    }

    /// Returns whether the sign in this row and column is +1.
    pub(crate) fn is_positive(&self, row: usize, column: usize) -> bool {
        let overlap = (row / self.base) & (column / self.base);
        let i = row % self.base;
        let j = column % self.base;
        let base_is_positive = i == 0 || j == 0 || {
            let q = self.base - 1;
            i != j && !self.is_square[(j + q - i) % q]
        };
        base_is_positive == (overlap.count_ones().is_multiple_of(2))
    }
}

fn is_prime(n: usize) -> bool {
    n > 1 && (2..).take_while(|k| k * k <= n).all(|k| !n.is_multiple_of(k))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The number of runs of the design for d factors is the smallest order above d. Orders 28, 36,
    /// 52, 56, 76, 88, 92 and 100 need other constructions, so the next one is used.
    #[test]
    fn orders_are_those_of_plackett_and_burman_where_the_construction_exists() {
        for (columns, order) in
            [(1, 1), (2, 2), (3, 4), (4, 4), (5, 8), (8, 8), (9, 12), (12, 12), (13, 16), (17, 20), (21, 24)]
        {
            assert_eq!(Hadamard::with_columns(columns).order(), order, "{columns} columns");
        }
        for (columns, order) in [(25, 32), (33, 40), (41, 44), (45, 48), (57, 60), (65, 68), (101, 104)] {
            assert_eq!(Hadamard::with_columns(columns).order(), order, "{columns} columns");
        }
    }

    #[test]
    fn columns_are_orthogonal() {
        for columns in (1..50).chain([101, 129, 150]) {
            let matrix = Hadamard::with_columns(columns);
            let n = matrix.order();
            assert!(n >= columns && (0..n).all(|row| matrix.is_positive(row, 0)));
            for a in 0..columns {
                for b in 0..a {
                    let agree = (0..n)
                        .filter(|row| matrix.is_positive(*row, a) == matrix.is_positive(*row, b))
                        .count();
                    assert_eq!(2 * agree, n, "columns {a} and {b} of {columns}");
                }
            }
        }
    }
}
