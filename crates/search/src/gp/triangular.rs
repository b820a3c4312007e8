//! Solution of triangular systems with many right-hand sides, in blocks.

use nalgebra::DMatrix;

/// Rows of a diagonal block.
const BLOCK: usize = 32;
/// The number of right-hand sides from which blocks are faster.
const MANY: usize = 8;

/// Overwrites `right` with L⁻¹ `right` for the lower triangle L of `lower`. Entries above the
/// diagonal are ignored.
///
/// The diagonal blocks are inverted, so that nearly all of the time goes to the library's matrix
/// product, which is much faster than its triangular solver.
pub(super) fn solve_lower(lower: &DMatrix<f64>, right: &mut DMatrix<f64>) {
    let (n, columns) = right.shape();
    if columns < MANY {
        lower.solve_lower_triangular_unchecked_mut(right);
        return;
    }
    let mut inverse = DMatrix::zeros(BLOCK, BLOCK);
    let mut block = DMatrix::zeros(BLOCK, columns);
    let mut start = 0;
    while start < n {
        let end = (start + BLOCK).min(n);
        let size = end - start;
        let mut inverse = inverse.view_mut((0, 0), (size, size));
        inverse.fill_with_identity();
        lower.view((start, start), (size, size)).solve_lower_triangular_unchecked_mut(&mut inverse);
        let mut block = block.rows_mut(0, size);
        block.copy_from(&right.rows(start, size));
        right.rows_mut(start, size).gemm(1.0, &inverse, &block, 0.0);
        if end < n {
            let below = lower.view((end, start), (n - end, size));
            let (solved, mut rest) = right.rows_range_pair_mut(start..end, end..n);
            rest.gemm(-1.0, &below, &solved, 1.0);
        }
        start = end;
    }
}

#[cfg(test)]
mod tests {
    use super::solve_lower;
    use nalgebra::DMatrix;

    #[test]
    fn solution_times_the_triangle_is_the_right_hand_side() {
        for (n, columns) in [(1, 9), (31, 9), (32, 8), (33, 20), (100, 40), (100, 1)] {
            let lower = DMatrix::from_fn(n, n, |i, j| match i.cmp(&j) {
                std::cmp::Ordering::Less => f64::NAN,
                std::cmp::Ordering::Equal => 2.0 + i as f64,
                std::cmp::Ordering::Greater => ((7 * i + 3 * j) % 11) as f64 / 11.0 - 0.4,
            });
            let right = DMatrix::from_fn(n, columns, |i, j| ((i + 2 * j) % 7) as f64);
            let mut solution = right.clone();
            solve_lower(&lower, &mut solution);
            let triangle = DMatrix::from_fn(n, n, |i, j| if i < j { 0.0 } else { lower[(i, j)] });
            assert!((triangle * solution - right).amax() < 1e-9, "n = {n}");
        }
    }
}
