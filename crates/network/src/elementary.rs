//! e^x − 1, e^x, tanh and the logistic function in `f32`, written so that the compiler can
//! vectorize them.
//!
//! The standard library calls the C library, which computes one number at a time and selects its
//! code by processor. These functions are arithmetic without branches or tables, so their bits are
//! the same in scalar and vector code. NaN stays NaN.

/// For |x| above this limit e^−|x| is less than half the spacing of `f32` numbers just above −1.
const SATURATION: f32 = 18.0;

/// Returns e^x − 1 for x ≤ 0.
///
/// ```text
/// n = round(x / ln 2),  r = x − n ln 2 ∈ [−0.347, 0.347]
/// e^x − 1 = 2^n (e^r − 1) + (2^n − 1),  e^r − 1 = r + r² q(r)
/// ```
///
/// `q` is a minimax polynomial of degree 4 with relative error 1.8e-8, a seventh of the spacing of
/// `f32` numbers. The relative error of the result is below 9.2e-8, also for x near 0. For x < −18
/// the result is −1. Positive x are outside the domain.
///
/// # Example
/// ```
/// use mishandle_network::elementary::exp_m1_of_nonpositive;
/// assert!((exp_m1_of_nonpositive(-1.0) + 0.632_120_56).abs() < 1e-7); // e^−1 = 0.36787944
/// ```
///
/// # Reference
/// Cody and Waite, "Software Manual for the Elementary Functions", 1980: the range reduction.
#[inline(always)]
#[must_use]
pub fn exp_m1_of_nonpositive(x: f32) -> f32 {
    // A comparison instead of `f32::max`, which would turn NaN into a number.
    let x = if x < -SATURATION { -SATURATION } else { x };
    let (two_to_n, exp_m1_of_r) = reduce(x);
    two_to_n.mul_add(exp_m1_of_r, two_to_n - 1.0)
}

/// Returns 2^n and e^r − 1 for the n and r of [`exp_m1_of_nonpositive`], for −87 ≤ x ≤ 0.
#[inline(always)]
fn reduce(x: f32) -> (f32, f32) {
    /// 1.5 · 2^23: adding it to a small number leaves the nearest integer in the lowest bits.
    const ROUND: f32 = 12_582_912.0;
    /// The first 15 bits of ln 2, so that the product with a small integer is exact, and the
    /// remainder.
    const LN_2_HIGH: f32 = 0.693_145_75;
    const LN_2_LOW: f32 = 1.428_606_8e-6;
    const Q: [f32; 5] = [0.499_999_98, 0.166_665_43, 0.041_667_2, 0.008_366_58, 0.001_388_250_8];
    let shifted = x.mul_add(std::f32::consts::LOG2_E, ROUND);
    let n = shifted - ROUND;
    let r = n.mul_add(-LN_2_LOW, n.mul_add(-LN_2_HIGH, x));
    let q = Q[4].mul_add(r, Q[3]).mul_add(r, Q[2]).mul_add(r, Q[1]).mul_add(r, Q[0]);
    let exp_m1_of_r = (r * r).mul_add(q, r);
    let two_to_n = f32::from_bits((shifted.to_bits() << 23).wrapping_add(1.0_f32.to_bits()));
    (two_to_n, exp_m1_of_r)
}

/// Returns e^x for x ≤ 0. The relative error is below 1.5e-7. For x < −87 the result is that of
/// −87, which is 1.6e-38.
///
/// # Example
/// ```
/// use mishandle_network::elementary::exp_of_nonpositive;
/// assert!((exp_of_nonpositive(-10.0) / 4.539_992_98e-5 - 1.0).abs() < 2e-7);
/// ```
#[inline(always)]
#[must_use]
pub fn exp_of_nonpositive(x: f32) -> f32 {
    /// Below it, 2^n is no longer a normal number.
    const LOWEST: f32 = -87.0;
    let (two_to_n, exp_m1_of_r) = reduce(if x < LOWEST { LOWEST } else { x });
    two_to_n.mul_add(exp_m1_of_r, two_to_n)
}

/// Returns the hyperbolic tangent of x.
///
/// ```text
/// tanh |x| = −t / (t + 2),  t = e^(−2|x|) − 1
/// ```
///
/// The relative error is below 1.9e-7, also for x near 0.
///
/// # Example
/// ```
/// use mishandle_network::elementary::tanh;
/// assert!((tanh(0.5) - 0.462_117_16).abs() < 1e-7);
/// assert_eq!(tanh(-100.0), -1.0);
/// ```
#[inline(always)]
#[must_use]
pub fn tanh(x: f32) -> f32 {
    let t = exp_m1_of_nonpositive(-2.0 * x.abs());
    (-t / (t + 2.0)).copysign(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Checks the maximum relative error of `ours` against `exact` in f64, on many numbers with
    /// these signs.
    #[track_caller]
    fn check(ours: fn(f32) -> f32, exact: fn(f64) -> f64, signs: &[f32], bound: f64) {
        let mut worst = (0.0, 0.0);
        for bits in (1e-30_f32.to_bits()..40.0_f32.to_bits()).step_by(997) {
            for sign in signs {
                let x = f32::from_bits(bits) * sign;
                let expected = exact(f64::from(x));
                let error = (f64::from(ours(x)) - expected).abs() / expected.abs();
                assert!(error.is_finite(), "x = {x}");
                if error > worst.0 {
                    worst = (error, x);
                }
            }
        }
        assert!(worst.0 < bound, "relative error {} at {}", worst.0, worst.1);
    }

    #[test]
    fn exp_m1_is_close_to_the_exact_value() {
        check(exp_m1_of_nonpositive, f64::exp_m1, &[-1.0], 9.2e-8);
    }

    #[test]
    fn exp_is_close_to_the_exact_value() {
        check(exp_of_nonpositive, f64::exp, &[-1.0], 1.5e-7);
        assert_eq!(exp_of_nonpositive(0.0), 1.0);
        assert!(exp_of_nonpositive(f32::NEG_INFINITY) < 2e-38);
        assert!(exp_of_nonpositive(f32::NAN).is_nan());
    }

    #[test]
    fn tanh_is_close_to_the_exact_value() {
        check(tanh, f64::tanh, &[-1.0, 1.0], 1.9e-7);
    }

    #[test]
    fn infinities_zeros_and_nan_have_the_expected_values() {
        assert_eq!(exp_m1_of_nonpositive(f32::NEG_INFINITY), -1.0);
        assert_eq!(exp_m1_of_nonpositive(0.0), 0.0);
        assert_eq!(tanh(f32::INFINITY), 1.0);
        assert_eq!(tanh(f32::NEG_INFINITY), -1.0);
        assert_eq!(tanh(-0.0).to_bits(), (-0.0_f32).to_bits());
        assert!(exp_m1_of_nonpositive(f32::NAN).is_nan());
        assert!(tanh(f32::NAN).is_nan());
    }
}
