//! Eight numbers that are computed together.
//!
//! The compiler turns the loops into vector instructions. Every operation is one of +, -, *, / and
//! square root of IEEE 754, or a comparison, so the bits depend on no machine.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// The number of lanes.
pub(crate) const LANES: usize = 8;

/// Eight numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(32))]
pub(crate) struct Lanes(pub [f32; LANES]);

macro_rules! operator {
    ($trait:ident, $name:ident, $op:tt) => {
        impl $trait for Lanes {
            type Output = Lanes;

            #[inline(always)]
            fn $name(self, other: Lanes) -> Lanes {
                let mut out = [0.0; LANES];
                for i in 0..LANES {
                    out[i] = self.0[i] $op other.0[i];
                }
                Lanes(out)
            }
        }
    };
}

operator!(Add, add, +);
operator!(Sub, sub, -);
operator!(Mul, mul, *);
operator!(Div, div, /);

impl Neg for Lanes {
    type Output = Lanes;

    #[inline(always)]
    fn neg(self) -> Lanes {
        self.map(|value| -value)
    }
}

impl Lanes {
    /// Where a ray that misses enters.
    pub const MISS: Lanes = Lanes([f32::INFINITY; LANES]);
    /// 0 in each lane.
    pub const ZERO: Lanes = Lanes([0.0; LANES]);

    /// Returns `value` in each lane.
    #[inline(always)]
    pub fn all(value: f32) -> Lanes {
        Lanes([value; LANES])
    }

    /// Returns `f` of each lane.
    #[inline(always)]
    pub fn map(self, f: impl Fn(f32) -> f32) -> Lanes {
        let mut out = [0.0; LANES];
        for i in 0..LANES {
            out[i] = f(self.0[i]);
        }
        Lanes(out)
    }

    /// Returns the square root of each lane.
    #[inline(always)]
    pub fn sqrt(self) -> Lanes {
        self.map(f32::sqrt)
    }

    /// Returns the magnitude of each lane.
    #[inline(always)]
    pub fn abs(self) -> Lanes {
        self.map(f32::abs)
    }

    /// Returns the lesser number of each lane, `other` if one is undefined.
    #[inline(always)]
    pub fn min(self, other: Lanes) -> Lanes {
        self.select_less(other, self, other)
    }

    /// Returns the greater number of each lane, `other` if one is undefined.
    #[inline(always)]
    pub fn max(self, other: Lanes) -> Lanes {
        other.select_less(self, self, other)
    }

    /// Returns `yes` where a lane is less than that of `other`, and `no` elsewhere.
    #[inline(always)]
    pub fn select_less(self, other: Lanes, yes: Lanes, no: Lanes) -> Lanes {
        let mut out = [0.0; LANES];
        for i in 0..LANES {
            out[i] = if self.0[i] < other.0[i] { yes.0[i] } else { no.0[i] };
        }
        Lanes(out)
    }

    /// Returns `yes` where a lane is at most that of `other`, and `no` elsewhere.
    #[inline(always)]
    pub fn select_at_most(self, other: Lanes, yes: Lanes, no: Lanes) -> Lanes {
        let mut out = [0.0; LANES];
        for i in 0..LANES {
            out[i] = if self.0[i] <= other.0[i] { yes.0[i] } else { no.0[i] };
        }
        Lanes(out)
    }

    /// Returns the least lane.
    #[inline(always)]
    pub fn least(self) -> f32 {
        self.0.iter().fold(f32::INFINITY, |least, value| if *value < least { *value } else { least })
    }

    /// Returns the greatest lane.
    #[inline(always)]
    pub fn greatest(self) -> f32 {
        self.0
            .iter()
            .fold(f32::NEG_INFINITY, |greatest, value| if *value > greatest { *value } else { greatest })
    }
}

/// Eight points or directions.
pub(crate) type Lanes3 = [Lanes; 3];

/// Returns the dot product.
#[inline(always)]
pub(crate) fn dot(a: Lanes3, b: Lanes3) -> Lanes {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Returns `o + t d`.
#[inline(always)]
pub(crate) fn along(o: Lanes3, t: Lanes, d: Lanes3) -> Lanes3 {
    [o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2]]
}

/// Returns the same vector in each lane.
#[inline(always)]
pub(crate) fn same(v: [f32; 3]) -> Lanes3 {
    v.map(Lanes::all)
}
