//! Matrix multiplication: matrices in panels of sixteen columns, and the two products that networks
//! need.
//!
//! A matrix of `rows` x `columns` is stored as ⌈columns / 16⌉ panels. A panel has one [`Lanes`] per
//! row. Padding columns contain zeros. A product therefore accesses memory in order and never
//! repacks an operand.
//!
//! Why no library: `gemm` 0.19 (and `faer`, which uses it) and `matrixmultiply` 0.3 select their
//! kernel by processor. `gemm` also selects block sizes by the sizes of the caches, and uses
//! another path for vectors. Their bits depend on both. Here each element of a product is one chain
//! of fused multiply-adds over the inner index, in order, in every tile, so the result of a row
//! cannot depend on other rows.
//!
//! Measured on one Zen 3 core with layers of 30 to 512: 72 to 101 GFLOP/s at 16 rows and more
//! (`gemm` 41 to 98, `matrixmultiply` 44 to 87), 39 to 77 at one row (15 to 34, and 4). The layer
//! of 64 to 9 fills only half of its last panel: 53 (46, 28), and 17 at one row (19, 2).

use crate::activation::Activation;
use crate::layer_norm;
use crate::scalar::Scalar;

/// The number of columns in a panel: two vector registers of `f32`.
pub(crate) const WIDTH: usize = 16;

/// One row of a panel.
#[derive(Debug, Clone, Copy, Default)]
#[repr(C, align(64))]
pub struct Lanes<T>(pub [T; WIDTH]);

impl<T: Scalar> Lanes<T> {
    pub(crate) const ZERO: Lanes<T> = Lanes([T::ZERO; WIDTH]);

    /// self += a b
    #[inline(always)]
    fn add_product(&mut self, a: T, b: &Lanes<T>) {
        for (sum, b) in self.0.iter_mut().zip(&b.0) {
            *sum = a.mul_add(*b, *sum);
        }
    }
}

/// Returns the number of panels for `columns` columns.
pub(crate) fn panels(columns: usize) -> usize {
    columns.div_ceil(WIDTH)
}

/// Resizes `matrix` and reuses its memory. Its content is unspecified afterwards.
pub(crate) fn resize<T: Scalar>(matrix: &mut Vec<Lanes<T>>, rows: usize, columns: usize) {
    matrix.resize(rows * panels(columns), Lanes::ZERO);
}

/// Copies the row-major matrix `from` into the panels `to`, which have `rows` rows. Additional rows
/// are unchanged.
pub(crate) fn pack<T: Scalar>(from: &[T], columns: usize, rows: usize, to: &mut [Lanes<T>]) {
    for (p, panel) in to.chunks_exact_mut(rows).enumerate() {
        let first = p * WIDTH;
        let width = WIDTH.min(columns - first);
        for (row, lanes) in from.chunks_exact(columns).zip(panel) {
            if let Some(full) = row[first..].first_chunk() {
                lanes.0 = *full;
            } else {
                *lanes = Lanes::ZERO;
                lanes.0[..width].copy_from_slice(&row[first..]);
            }
        }
    }
}

/// Copies the panels `from` into the row-major matrix `to`.
pub(crate) fn unpack<T: Scalar>(from: &[Lanes<T>], columns: usize, to: &mut [T]) {
    let rows = to.len() / columns;
    for (p, panel) in from.chunks_exact(rows).enumerate() {
        let first = p * WIDTH;
        let width = WIDTH.min(columns - first);
        for (row, lanes) in to.chunks_exact_mut(columns).zip(panel) {
            row[first..first + width].copy_from_slice(&lanes.0[..width]);
        }
    }
}

/// Copies the transpose of the row-major matrix `from` into the panels `to`.
///
/// The transpose has ⌈columns / 16⌉ · 16 rows, so that it can be the second operand of [`product`].
/// Padding rows must already be zero.
pub(crate) fn pack_transposed<T: Scalar>(from: &[T], columns: usize, to: &mut [Lanes<T>]) {
    let rows = from.len() / columns;
    for (r, row) in from.chunks_exact(columns).enumerate() {
        let panel = &mut to[(r / WIDTH) * panels(columns) * WIDTH..][..columns];
        for (value, lanes) in row.iter().zip(panel) {
            lanes.0[r % WIDTH] = *value;
        }
    }
    debug_assert_eq!(to.len(), panels(rows) * panels(columns) * WIDTH);
}

/// The operation applied to each panel of a product while it is in the cache.
#[derive(Debug, Clone, Copy)]
pub enum Epilogue<'a, T> {
    /// No operation.
    None,
    /// Applies the activation.
    Activate(Activation),
    /// Multiplies each element by the activation's derivative, given the activation's values.
    TimesDerivative(Activation, &'a [Lanes<T>]),
}

/// The kernels (inner loops), compiled in this crate once for each scalar type.
///
/// Generic functions are compiled again in each crate that uses them. Whether the compiler keeps
/// the sums of a tile in registers then depends on the code inlined around them, which changed the
/// time by a factor of two. Therefore these functions are never inlined.
pub trait Kernels: Sized {
    /// Computes c = start + a b, then applies `epilogue`.
    ///
    /// `a` has `rows` rows. `b` has as many rows as `a` has columns, including padding. `start` is
    /// one row, added to every row of the product, with as many panels as c. Without it, the
    /// product is added to c.
    fn product(
        rows: usize,
        a: &[Lanes<Self>],
        b: &[Lanes<Self>],
        start: Option<&[Lanes<Self>]>,
        c: &mut [Lanes<Self>],
        epilogue: Epilogue<'_, Self>,
    );

    /// Computes c += aᵀ b, where `c` is row-major of `a_columns` x `b_columns`, and `a` and `b`
    /// have `rows` rows in panels.
    ///
    /// The sum over the rows is one chain per element, in order, starting at zero and added to `c`
    /// once.
    fn add_transposed_product(
        rows: usize,
        a: &[Lanes<Self>],
        a_columns: usize,
        b: &[Lanes<Self>],
        b_columns: usize,
        c: &mut [Self],
    );

    /// Replaces each x by the activation's y(x).
    fn activate(activation: Activation, values: &mut [Lanes<Self>]);

    /// Multiplies each of `factors` by dy/dx, given the activation's value in `outputs`.
    fn times_derivative(activation: Activation, outputs: &[Lanes<Self>], factors: &mut [Lanes<Self>]);

    /// Standardizes each row of a matrix of `columns` columns to mean 0 and variance 1. Writes the
    /// factors to `scales`.
    fn standardize(columns: usize, values: &mut [Lanes<Self>], scales: &mut [Self]);

    /// Multiplies each row of `gradient` by the derivative of
    /// [`standardize`](Kernels::standardize), a symmetric matrix, given its results `values` and
    /// `scales`.
    fn times_standardize_derivative(
        columns: usize,
        values: &[Lanes<Self>],
        scales: &[Self],
        gradient: &mut [Lanes<Self>],
    );
}

macro_rules! compile_kernels {
    ($($number:ty),*) => {$(
        impl Kernels for $number {
            #[inline(never)]
            fn product(
                rows: usize,
                a: &[Lanes<Self>],
                b: &[Lanes<Self>],
                start: Option<&[Lanes<Self>]>,
                c: &mut [Lanes<Self>],
                epilogue: Epilogue<'_, Self>,
            ) {
                product(rows, a, b, start, c, epilogue);
            }

            #[inline(never)]
            fn add_transposed_product(
                rows: usize,
                a: &[Lanes<Self>],
                a_columns: usize,
                b: &[Lanes<Self>],
                b_columns: usize,
                c: &mut [Self],
            ) {
                add_transposed_product(rows, a, a_columns, b, b_columns, c);
            }

            #[inline(never)]
            fn activate(activation: Activation, values: &mut [Lanes<Self>]) {
                activation.apply(values);
            }

            #[inline(never)]
            fn times_derivative(activation: Activation, outputs: &[Lanes<Self>], factors: &mut [Lanes<Self>]) {
                activation.times_derivative(outputs, factors);
            }

            #[inline(never)]
            fn standardize(columns: usize, values: &mut [Lanes<Self>], scales: &mut [Self]) {
                layer_norm::standardize(columns, values, scales);
            }

            #[inline(never)]
            fn times_standardize_derivative(
                columns: usize,
                values: &[Lanes<Self>],
                scales: &[Self],
                gradient: &mut [Lanes<Self>],
            ) {
                layer_norm::times_derivative(columns, values, scales, gradient);
            }
        }
    )*};
}
compile_kernels!(f32, f64);

/// The number of rows of a tile. With two registers per row, twelve sums are computed in parallel,
/// and three registers are left for the operands.
const TILE_ROWS: usize = 6;

#[inline(always)]
fn product<T: Scalar>(
    rows: usize,
    a: &[Lanes<T>],
    b: &[Lanes<T>],
    start: Option<&[Lanes<T>]>,
    c: &mut [Lanes<T>],
    epilogue: Epilogue<'_, T>,
) {
    let operands = Operands { rows, a, b, start, depth: a.len() / rows * WIDTH };
    let tiled = rows / TILE_ROWS * TILE_ROWS;
    // With few rows, several panels are computed at once to use all registers.
    match rows - tiled {
        1 => operands.few_rows::<1, 4>(tiled, c),
        2 => operands.few_rows::<2, 2>(tiled, c),
        3 => operands.few_rows::<3, 2>(tiled, c),
        4 => operands.few_rows::<4, 1>(tiled, c),
        5 => operands.few_rows::<5, 1>(tiled, c),
        _ => {}
    }
    for (p, panel) in c.chunks_exact_mut(rows).enumerate() {
        operands.many_rows(tiled, p, panel);
        match epilogue {
            Epilogue::None => {}
            Epilogue::Activate(activation) => T::activate(activation, panel),
            Epilogue::TimesDerivative(activation, outputs) => {
                T::times_derivative(activation, &outputs[p * rows..][..rows], panel);
            }
        }
    }
}

struct Operands<'a, T> {
    rows: usize,
    a: &'a [Lanes<T>],
    b: &'a [Lanes<T>],
    start: Option<&'a [Lanes<T>]>,
    depth: usize,
}

impl<T: Scalar> Operands<'_, T> {
    /// Computes the rows before `end`, a multiple of `TILE_ROWS`, of the panel `c` with index `p`.
    #[inline(never)]
    fn many_rows(&self, end: usize, p: usize, c: &mut [Lanes<T>]) {
        for first in (0..end).step_by(TILE_ROWS) {
            self.tile::<TILE_ROWS, 1>(first, p, c);
        }
    }

    /// Computes the last `R` rows of all panels, `P` panels at a time.
    #[inline(never)]
    fn few_rows<const R: usize, const P: usize>(&self, first: usize, c: &mut [Lanes<T>]) {
        let panels = c.len() / self.rows;
        let together = panels / P * P;
        for p in (0..together).step_by(P) {
            self.tile::<R, P>(first, p, &mut c[p * self.rows..]);
        }
        for p in together..panels {
            self.tile::<R, 1>(first, p, &mut c[p * self.rows..]);
        }
    }

    /// Computes `R` rows from `first` of the `P` panels from `panel`; `c` starts with the first of
    /// these panels.
    #[inline(always)]
    #[allow(clippy::needless_range_loop)] // Indices keep the sums in registers; iterators do not.
    fn tile<const R: usize, const P: usize>(&self, first: usize, panel: usize, c: &mut [Lanes<T>]) {
        let rows = self.rows;
        let mut sums: [[Lanes<T>; P]; R] = std::array::from_fn(|r| {
            std::array::from_fn(|p| {
                self.start.map_or_else(|| c[p * rows + first + r], |start| start[panel + p])
            })
        });
        let b: [&[[Lanes<T>; WIDTH]]; P] =
            std::array::from_fn(|p| self.b[(panel + p) * self.depth..][..self.depth].as_chunks().0);
        for (k, a) in self.a.chunks_exact(rows).enumerate() {
            let a: [&Lanes<T>; R] = std::array::from_fn(|r| &a[first + r]);
            let b: [&[Lanes<T>; WIDTH]; P] = std::array::from_fn(|p| &b[p][k]);
            for lane in 0..WIDTH {
                for p in 0..P {
                    for r in 0..R {
                        sums[r][p].add_product(a[r].0[lane], &b[p][lane]);
                    }
                }
            }
        }
        for (r, sums) in sums.iter().enumerate() {
            for (p, sum) in sums.iter().enumerate() {
                c[p * rows + first + r] = *sum;
            }
        }
    }
}

#[inline(always)]
fn add_transposed_product<T: Scalar>(
    rows: usize,
    a: &[Lanes<T>],
    a_columns: usize,
    b: &[Lanes<T>],
    b_columns: usize,
    c: &mut [T],
) {
    for (bp, b) in b.chunks_exact(rows).enumerate() {
        let column = bp * WIDTH;
        let width = WIDTH.min(b_columns - column);
        for (ap, a) in a.chunks_exact(rows).enumerate() {
            let columns = WIDTH.min(a_columns - ap * WIDTH);
            for tile in 0..columns.div_ceil(TILE) {
                let sums = transposed_tile(a, b, tile);
                let first = ap * WIDTH + tile * TILE;
                for (sum, row) in sums.iter().zip(first..first + TILE.min(a_columns - first)) {
                    let c = &mut c[row * b_columns + column..][..width];
                    for (c, sum) in c.iter_mut().zip(&sum.0) {
                        *c += *sum;
                    }
                }
            }
        }
    }
}

/// The number of rows of aᵀ b computed at once. With two registers per row, eight sums are computed
/// in parallel.
const TILE: usize = 4;

/// Computes the product of the transposed columns of `a` from `TILE · tile` and `b`.
#[inline(never)]
#[allow(clippy::needless_range_loop)] // Indices keep the sums in registers; iterators do not.
fn transposed_tile<T: Scalar>(a: &[Lanes<T>], b: &[Lanes<T>], tile: usize) -> [Lanes<T>; TILE] {
    let mut sums = [Lanes::ZERO; TILE];
    let first = tile.min(WIDTH / TILE - 1) * TILE;
    for (a, b) in a.iter().zip(b) {
        for r in 0..TILE {
            sums[r].add_product(a.0[first + r], b);
        }
    }
    sums
}

/// Adds the sum of the rows of `a`, whose panels have `rows` rows, to c.
pub(crate) fn add_row_sum<T: Scalar>(rows: usize, a: &[Lanes<T>], c: &mut [T]) {
    for (panel, c) in a.chunks_exact(rows).zip(c.chunks_mut(WIDTH)) {
        let mut sum = Lanes::ZERO;
        for row in panel {
            sum.add_product(T::ONE, row);
        }
        for (c, sum) in c.iter_mut().zip(&sum.0) {
            *c += *sum;
        }
    }
}
