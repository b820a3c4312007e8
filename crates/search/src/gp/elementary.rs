//! The exponential function and the cosine, written so that the compiler can vectorize them, and
//! the tail of the normal distribution.
//!
//! The standard library calls the C library, which computes one number at a time.

/// Returns e^x for x ≤ 0, with a relative error below 4e-16. For x < -700 the result is that
/// of -700, about 1e-304.
///
/// ```text
/// n = round(x / ln 2),  r = x - n ln 2 ∈ [-0.347, 0.347],  e^x = 2^n Σ rᵏ / k!
/// ```
///
/// The sum has 14 terms; the next one is below 5e-18.
///
/// # Reference
/// Cody and Waite, "Software Manual for the Elementary Functions", 1980: the range reduction.
#[inline(always)]
pub(super) fn exp_of_nonpositive(x: f64) -> f64 {
    /// 1.5 · 2^52: adding it to a small number leaves the nearest integer in the lowest bits.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    /// The first 32 bits of ln 2, so that the product with a small integer is exact, and the
    /// remainder.
    const LN_2_HIGH: f64 = 6.931_471_803_691_238e-1;
    const LN_2_LOW: f64 = 1.908_214_929_270_587_7e-10;
    const INVERSE_FACTORIALS: [f64; 14] = [
        1.0,
        1.0,
        1.0 / 2.0,
        1.0 / 6.0,
        1.0 / 24.0,
        1.0 / 120.0,
        1.0 / 720.0,
        1.0 / 5_040.0,
        1.0 / 40_320.0,
        1.0 / 362_880.0,
        1.0 / 3_628_800.0,
        1.0 / 39_916_800.0,
        1.0 / 479_001_600.0,
        1.0 / 6_227_020_800.0,
    ];
    let x = if x < -700.0 { -700.0 } else { x };
    let shifted = x.mul_add(std::f64::consts::LOG2_E, ROUND);
    let n = shifted - ROUND;
    let r = n.mul_add(-LN_2_LOW, n.mul_add(-LN_2_HIGH, x));
    let mut sum = INVERSE_FACTORIALS[13];
    for k in (0..13).rev() {
        sum = sum.mul_add(r, INVERSE_FACTORIALS[k]);
    }
    let two_to_n = f64::from_bits((shifted.to_bits() << 52).wrapping_add(1.0_f64.to_bits()));
    two_to_n * sum
}

/// Returns cos(2π x) for |x| < 2^50, with an absolute error below 1e-11.
///
/// ```text
/// r = x - round(x) ∈ [-1/2, 1/2],  cos(2π x) = Σ (-1)ᵏ (2π r)²ᵏ / (2k)!
/// ```
///
/// The sum has 13 terms; the next one is below π^26 / 26! = 2.1e-14.
#[inline(always)]
pub(super) fn cosine_of_turns(x: f64) -> f64 {
    const ROUND: f64 = 6_755_399_441_055_744.0;
    let r = std::f64::consts::TAU * (x - ((x + ROUND) - ROUND));
    let squared = r * r;
    let mut sum = 1.0;
    for k in (1..13).rev() {
        sum = (-squared / ((2 * k * (2 * k - 1)) as f64)).mul_add(sum, 1.0);
    }
    sum
}

/// Returns the probability that a standard normal number is above `z`, with an absolute error below
/// 7.5e-8.
///
/// # Reference
/// Abramowitz and Stegun, "Handbook of Mathematical Functions", 1964, formula 26.2.17.
pub(crate) fn normal_tail(z: f64) -> f64 {
    const COEFFICIENTS: [f64; 5] =
        [0.319_381_530, -0.356_563_782, 1.781_477_937, -1.821_255_978, 1.330_274_429];
    let t = (1.0 + 0.231_641_9 * z.abs()).recip();
    let density = (-0.5 * z * z).exp() / std::f64::consts::TAU.sqrt();
    let tail = density * COEFFICIENTS.iter().rev().fold(0.0, |sum, c| t * (c + sum));
    if z < 0.0 { 1.0 - tail } else { tail }
}

/// Returns the logarithm of [`normal_tail`], also where that is 0.
///
/// # Reference
/// Abramowitz and Stegun, formula 26.2.12: the asymptotic expansion for large `z`.
pub(crate) fn log_normal_tail(z: f64) -> f64 {
    const FAR: f64 = 3.5;
    if z < FAR {
        return normal_tail(z).ln();
    }
    let inverse = (z * z).recip();
    -0.5 * z * z - (z * std::f64::consts::TAU.sqrt()).ln()
        + (inverse * (inverse * (3.0 - 15.0 * inverse) - 1.0)).ln_1p()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cosine_agrees_with_the_standard_library() {
        for i in -5_000..5_000 {
            let x = 0.001_37 * f64::from(i);
            let error = cosine_of_turns(x) - (std::f64::consts::TAU * x).cos();
            assert!(error.abs() < 1e-11, "{x}: {error}");
        }
    }

    #[test]
    fn exponential_agrees_with_the_standard_library() {
        for i in 0..70_000 {
            let x = -0.01 * f64::from(i);
            let relative = exp_of_nonpositive(x) / x.exp() - 1.0;
            assert!(relative.abs() < 4e-16, "{x}: {relative}");
        }
        assert!(exp_of_nonpositive(-1e300) < 1e-303 && exp_of_nonpositive(0.0) == 1.0);
    }

    /// Published quantiles of the standard normal distribution.
    #[test]
    fn normal_tails_agree_with_tables() {
        for (z, p) in
            [(0.0, 0.5), (1.959_964, 0.025), (2.326_348, 0.01), (3.090_232, 0.001), (-1.281_552, 0.9)]
        {
            assert!((normal_tail(z) - p).abs() < 1.5e-7, "{z}");
        }
        assert_eq!((normal_tail(f64::INFINITY), normal_tail(f64::NEG_INFINITY)), (0.0, 1.0));
    }

    /// Tables of the tail: 0.1587, 2.8665e-7 and 7.6199e-24 at 1, 5 and 10.
    #[test]
    fn logarithms_of_normal_tails_agree_with_tables() {
        for (z, p) in [(1.0, 0.158_655_3), (5.0, 2.866_516e-7), (10.0, 7.619_853e-24)] {
            assert!((log_normal_tail(z) - f64::ln(p)).abs() < 1e-3, "{z}");
        }
        let jump = log_normal_tail(3.5 - 1e-9) - log_normal_tail(3.5);
        assert!(jump.abs() < 5e-3, "{jump}");
        assert!(log_normal_tail(1e3) < log_normal_tail(999.0) && log_normal_tail(1e200) < -1e300);
    }
}
