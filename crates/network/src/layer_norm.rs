//! Layer normalization on matrices in panels.
//!
//! ```text
//! y = s (x − mean(x)),  s = 1 / √(variance(x) + 1e-5),  over the columns of a row
//! ∂y/∂x = s (I − 1 1ᵀ / n − y yᵀ / n)
//! ```
//!
//! PyTorch's `LayerNorm` also has a gain and a shift per column (`elementwise_affine`), a [`Norm`].
//! Networks that are trained here have none: the next layer's weights can represent most of their
//! effect.
//!
//! # Reference
//! Ba, Kiros and Hinton, "Layer Normalization", 2016.

use crate::matmul::{Lanes, WIDTH};
use crate::scalar::Scalar;

/// Added to a variance, as PyTorch does.
const EPSILON: f64 = 1e-5;

/// The gain and the shift of a layer: y = gain · x + shift, for standardized x.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Norm<T> {
    pub gain: Vec<T>,
    pub shift: Vec<T>,
}

impl<T: Scalar> Norm<T> {
    /// Applies the gain and the shift to each row. Padding columns are not changed.
    pub(crate) fn apply(&self, rows: usize, values: &mut [Lanes<T>]) {
        let panels = self.gain.chunks(WIDTH).zip(self.shift.chunks(WIDTH));
        for ((gain, shift), panel) in panels.zip(values.chunks_exact_mut(rows)) {
            for lanes in panel {
                for ((x, gain), shift) in lanes.0.iter_mut().zip(gain).zip(shift) {
                    *x = x.mul_add(*gain, *shift);
                }
            }
        }
    }
}

/// Standardizes each row; padding columns become 0.
#[inline(always)]
pub(crate) fn standardize<T: Scalar>(columns: usize, values: &mut [Lanes<T>], scales: &mut [T]) {
    let rows = scales.len();
    let weight = T::from_f64(1.0 / columns as f64);
    for (r, scale) in scales.iter_mut().enumerate() {
        let mut sum = Lanes::ZERO;
        for lanes in values[r..].iter().step_by(rows) {
            zip(&mut sum, lanes, |sum, x| sum + x);
        }
        let mean = total(&sum) * weight;
        let mut squares = Lanes::ZERO;
        for (p, lanes) in values[r..].iter_mut().step_by(rows).enumerate() {
            for x in &mut lanes.0 {
                *x = *x - mean;
            }
            clear_padding(columns, p, lanes);
            zip(&mut squares, lanes, |sum, x| x.mul_add(x, sum));
        }
        *scale = T::ONE / total(&squares).mul_add(weight, T::from_f64(EPSILON)).sqrt();
        for lanes in values[r..].iter_mut().step_by(rows) {
            for x in &mut lanes.0 {
                *x = *x * *scale;
            }
        }
    }
}

/// Multiplies each row of `gradient` by ∂y/∂x. Padding columns must be 0 and stay 0.
#[inline(always)]
pub(crate) fn times_derivative<T: Scalar>(
    columns: usize,
    values: &[Lanes<T>],
    scales: &[T],
    gradient: &mut [Lanes<T>],
) {
    let rows = scales.len();
    let weight = T::from_f64(1.0 / columns as f64);
    for (r, scale) in scales.iter().enumerate() {
        let mut sum = Lanes::ZERO;
        let mut along = Lanes::ZERO;
        for (gradient, y) in gradient[r..].iter().step_by(rows).zip(values[r..].iter().step_by(rows)) {
            zip(&mut sum, gradient, |sum, f| sum + f);
            for ((along, f), y) in along.0.iter_mut().zip(&gradient.0).zip(&y.0) {
                *along = f.mul_add(*y, *along);
            }
        }
        let mean = total(&sum) * weight;
        let along = total(&along) * weight;
        let panels = gradient[r..].iter_mut().step_by(rows).zip(values[r..].iter().step_by(rows));
        for (p, (gradient, y)) in panels.enumerate() {
            zip(gradient, y, |f, y| *scale * (-along).mul_add(y, f - mean));
            clear_padding(columns, p, gradient);
        }
    }
}

#[inline(always)]
fn zip<T: Scalar>(to: &mut Lanes<T>, from: &Lanes<T>, f: impl Fn(T, T) -> T) {
    for (to, from) in to.0.iter_mut().zip(&from.0) {
        *to = f(*to, *from);
    }
}

/// Returns the sum of all lanes, by pairwise summation.
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

/// Sets the padding lanes of the panel with index `p` to 0.
#[inline(always)]
fn clear_padding<T: Scalar>(columns: usize, p: usize, lanes: &mut Lanes<T>) {
    let width = columns - p * WIDTH;
    if width < WIDTH {
        lanes.0[width..].fill(T::ZERO);
    }
}
