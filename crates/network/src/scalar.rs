//! The scalar types of networks.

use std::fmt::Debug;
use std::iter::Sum;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

use crate::elementary;
use crate::matmul::Kernels;

/// A scalar type: `f32` for networks, or `f64` for gradient checks.
///
/// Elementary functions of `f32` are implemented in [`elementary`], so their bits depend only on
/// the build. Those of `f64` are the standard library's.
pub trait Scalar:
    Kernels
    + Copy
    + Debug
    + Default
    + PartialOrd
    + Send
    + Sync
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + Sum
    + 'static
{
    /// 0
    const ZERO: Self;
    /// 1
    const ONE: Self;

    /// Converts `value` to the nearest number.
    fn from_f64(value: f64) -> Self;

    /// Converts the number to `f64`, exactly.
    fn to_f64(self) -> f64;

    /// Returns `self · a + b`, rounded once.
    fn mul_add(self, a: Self, b: Self) -> Self;

    /// Returns √self.
    fn sqrt(self) -> Self;

    /// Returns e^self − 1 for `self` ≤ 0; NaN stays NaN.
    fn exp_m1_of_nonpositive(self) -> Self;

    /// Returns e^self for `self` ≤ 0; NaN stays NaN.
    fn exp_of_nonpositive(self) -> Self;

    /// Returns the hyperbolic tangent.
    fn tanh(self) -> Self;
}

impl Scalar for f32 {
    const ZERO: f32 = 0.0;
    const ONE: f32 = 1.0;

    #[inline(always)]
    fn from_f64(value: f64) -> f32 {
        value as f32
    }

    #[inline(always)]
    fn to_f64(self) -> f64 {
        f64::from(self)
    }

    #[inline(always)]
    fn mul_add(self, a: f32, b: f32) -> f32 {
        f32::mul_add(self, a, b)
    }

    #[inline(always)]
    fn sqrt(self) -> f32 {
        f32::sqrt(self)
    }

    #[inline(always)]
    fn exp_m1_of_nonpositive(self) -> f32 {
        elementary::exp_m1_of_nonpositive(self)
    }

    #[inline(always)]
    fn exp_of_nonpositive(self) -> f32 {
        elementary::exp_of_nonpositive(self)
    }

    #[inline(always)]
    fn tanh(self) -> f32 {
        elementary::tanh(self)
    }
}

impl Scalar for f64 {
    const ZERO: f64 = 0.0;
    const ONE: f64 = 1.0;

    #[inline(always)]
    fn from_f64(value: f64) -> f64 {
        value
    }

    #[inline(always)]
    fn to_f64(self) -> f64 {
        self
    }

    #[inline(always)]
    fn mul_add(self, a: f64, b: f64) -> f64 {
        f64::mul_add(self, a, b)
    }

    #[inline(always)]
    fn sqrt(self) -> f64 {
        f64::sqrt(self)
    }

    fn exp_m1_of_nonpositive(self) -> f64 {
        self.exp_m1()
    }

    fn exp_of_nonpositive(self) -> f64 {
        self.exp()
    }

    fn tanh(self) -> f64 {
        f64::tanh(self)
    }
}
