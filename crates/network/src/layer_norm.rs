//! Layer normalisation without parameters, on matrices in panels.
//!
//! ```text
//! y = s (x − mean(x)),  s = 1 / √(variance(x) + 1e-5),  over the columns of a row
//! ∂y/∂x = s (I − 1 1ᵀ / n − y yᵀ / n)
//! ```
//!
//! PyTorch's `LayerNorm` has a gain and a shift for each column as well (its `elementwise_affine`): the next layer's weights and
//! this layer's bias can do most of what they do.
//!
//! # Reference
//! Ba, Kiros and Hinton, "Layer Normalization", 2016.

use crate::lanes::{Lanes, WIDTH};
use crate::scalar::Scalar;

/// Added to a variance, as PyTorch does.
const EPSILON: f64 = 1e-5;

/// Standardises each row; columns that do not exist become 0.
#[inline(always)]
pub(crate) fn standardize<T: Scalar>(columns: usize, values: &mut [Lanes<T>], scales: &mut [T]) {
    let rows = scales.len();
    let share = T::from_f64(1.0 / columns as f64);
    for (r, scale) in scales.iter_mut().enumerate() {
        let mut sum = Lanes::ZERO;
        for lanes in values[r..].iter().step_by(rows) {
            zip(&mut sum, lanes, |sum, x| sum + x);
        }
        let mean = total(&sum) * share;
        let mut squares = Lanes::ZERO;
        for (p, lanes) in values[r..].iter_mut().step_by(rows).enumerate() {
            for x in &mut lanes.0 {
                *x = *x - mean;
            }
            blank(columns, p, lanes);
            zip(&mut squares, lanes, |sum, x| x.mul_add(x, sum));
        }
        *scale = T::ONE / total(&squares).mul_add(share, T::from_f64(EPSILON)).sqrt();
        for lanes in values[r..].iter_mut().step_by(rows) {
            for x in &mut lanes.0 {
                *x = *x * *scale;
            }
        }
    }
}

/// Multiplies each row of `flow` by ∂y/∂x; columns that do not exist must hold 0, and do so afterwards.
#[inline(always)]
pub(crate) fn times_derivative<T: Scalar>(
    columns: usize,
    values: &[Lanes<T>],
    scales: &[T],
    flow: &mut [Lanes<T>],
) {
    let rows = scales.len();
    let share = T::from_f64(1.0 / columns as f64);
    for (r, scale) in scales.iter().enumerate() {
        let (mut sum, mut along) = (Lanes::ZERO, Lanes::ZERO);
        for (flow, y) in flow[r..].iter().step_by(rows).zip(values[r..].iter().step_by(rows)) {
            zip(&mut sum, flow, |sum, f| sum + f);
            for ((along, f), y) in along.0.iter_mut().zip(&flow.0).zip(&y.0) {
                *along = f.mul_add(*y, *along);
            }
        }
        let (mean, along) = (total(&sum) * share, total(&along) * share);
        let panels = flow[r..].iter_mut().step_by(rows).zip(values[r..].iter().step_by(rows));
        for (p, (flow, y)) in panels.enumerate() {
            zip(flow, y, |f, y| *scale * (-along).mul_add(y, f - mean));
            blank(columns, p, flow);
        }
    }
}

#[inline(always)]
fn zip<T: Scalar>(to: &mut Lanes<T>, from: &Lanes<T>, f: impl Fn(T, T) -> T) {
    for (to, from) in to.0.iter_mut().zip(&from.0) {
        *to = f(*to, *from);
    }
}

/// The sum of all lanes, by halves.
#[inline(always)]
fn total<T: Scalar>(lanes: &Lanes<T>) -> T {
    let mut sums = lanes.0;
    let mut width = WIDTH;
    while width > 1 {
        width /= 2;
        for i in 0..width {
            sums[i] += sums[i + width];
        }
    }
    sums[0]
}

/// Sets the lanes of the panel numbered `p` beyond the last column to 0.
#[inline(always)]
fn blank<T: Scalar>(columns: usize, p: usize, lanes: &mut Lanes<T>) {
    let width = columns - p * WIDTH;
    if width < WIDTH {
        lanes.0[width..].fill(T::ZERO);
    }
}
