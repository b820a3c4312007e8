//! The standard normal distribution.

use std::f64::consts::SQRT_2;

/// Returns the probability that a standard normal number is at most `z`. The relative error is
/// about 1e-13 down to z = -37, below which the result is 0.
///
/// # Reference
/// West, "Better approximations to cumulative normal functions", Wilmott Magazine, May 2005, after
/// Hart et al., "Computer Approximations", 1968.
pub(crate) fn cdf(z: f64) -> f64 {
    const NUMERATOR: [f64; 7] = [
        3.526_249_659_989_11e-2,
        0.700_383_064_443_688,
        6.373_962_203_531_65,
        33.912_866_078_383,
        112.079_291_497_871,
        221.213_596_169_931,
        220.206_867_912_376,
    ];
    const DENOMINATOR: [f64; 8] = [
        8.838_834_764_831_84e-2,
        1.755_667_163_182_64,
        16.064_177_579_207,
        86.780_732_202_946_1,
        296.564_248_779_674,
        637.333_633_378_831,
        793.826_512_519_948,
        440.413_735_824_752,
    ];
    let x = z.abs();
    let exponential = (-0.5 * x * x).exp();
    let tail = if x > 37.0 {
        0.0
    } else if x < 3.0 {
        exponential * polynomial(&NUMERATOR, x) / polynomial(&DENOMINATOR, x)
    } else {
        // Laplace's continued fraction, from the back.
        let fraction = (1..=40).rev().fold(x, |below, k| x + f64::from(k) / below);
        exponential / fraction / (SQRT_2 * std::f64::consts::PI.sqrt())
    };
    if z > 0.0 { 1.0 - tail } else { tail }
}

/// Returns the number below which a standard normal number is with probability `p`; infinite for 0
/// and 1.
///
/// # Reference
/// Wichura, "Algorithm AS 241: the percentage points of the normal distribution", Applied
/// Statistics 37, 1988.
pub(crate) fn quantile(p: f64) -> f64 {
    if p <= 0.0 || p >= 1.0 {
        return if p <= 0.0 { f64::NEG_INFINITY } else { f64::INFINITY };
    }
    let q = p - 0.5;
    if q.abs() <= 0.425 {
        let r = 0.180_625 - q * q;
        return q * polynomial(&CENTER.0, r) / polynomial(&CENTER.1, r);
    }
    let r = (-p.min(1.0 - p).ln()).sqrt();
    let (r, [numerator, denominator]) = if r <= 5.0 { (r - 1.6, &MIDDLE) } else { (r - 5.0, &TAIL) };
    (polynomial(numerator, r) / polynomial(denominator, r)).copysign(q)
}

/// Returns the value of a polynomial, whose coefficients begin with that of the highest power.
fn polynomial(coefficients: &[f64], x: f64) -> f64 {
    coefficients.iter().fold(0.0, |sum, coefficient| sum * x + coefficient)
}

const CENTER: ([f64; 8], [f64; 8]) = (
    [
        2.509_080_928_730_122_6e3,
        33_430.575_583_588_13,
        67_265.770_927_008_7,
        4.592_195_393_154_987e4,
        1.373_169_376_550_946e4,
        1.971_590_950_306_551_4e3,
        1.331_416_678_917_843_8e2,
        3.387_132_872_796_366_5,
    ],
    [
        5.226_495_278_852_545e3,
        2.872_908_573_572_194e4,
        3.930_789_580_009_271e4,
        2.121_379_430_158_659_7e4,
        5.394_196_021_424_751e3,
        6.871_870_074_920_579e2,
        4.231_333_070_160_091e1,
        1.0,
    ],
);

const MIDDLE: [[f64; 8]; 2] = [
    [
        7.745_450_142_783_414e-4,
        2.272_384_498_926_918_4e-2,
        2.417_807_251_774_506e-1,
        1.270_458_252_452_368_4,
        3.647_848_324_763_204_5,
        5.769_497_221_460_691,
        4.630_337_846_156_546,
        1.423_437_110_749_683_5,
    ],
    [
        1.050_750_071_644_416_9e-9,
        5.475_938_084_995_345e-4,
        1.519_866_656_361_645_7e-2,
        1.481_039_764_274_800_8e-1,
        6.897_673_349_851e-1,
        1.676_384_830_183_803_8,
        2.053_191_626_637_759,
        1.0,
    ],
];

const TAIL: [[f64; 8]; 2] = [
    [
        2.010_334_399_292_288_1e-7,
        2.711_555_568_743_487_6e-5,
        1.242_660_947_388_078_4e-3,
        2.653_218_952_657_612_4e-2,
        2.965_605_718_285_048_7e-1,
        1.784_826_539_917_291_3,
        5.463_784_911_164_114,
        6.657_904_643_501_103,
    ],
    [
        2.044_263_103_389_939_8e-15,
        1.421_511_758_316_446e-7,
        1.846_318_317_510_054_7e-5,
        7.868_691_311_456_133e-4,
        1.487_536_129_085_061_5e-2,
        1.369_298_809_227_358e-1,
        5.998_322_065_558_88e-1,
        1.0,
    ],
];

#[cfg(test)]
mod tests {
    use super::*;

    const SCIPY: [(f64, f64); 8] = [
        (-37.0, 5.725_571_222_523_926_6e-300),
        (-8.0, 6.220_960_574_271_74e-16),
        (-7.08, 7.207_723_086_467_469e-13),
        (-7.0, 1.279_812_543_885_835e-12),
        (-5.0, 2.866_515_718_791_933e-7),
        (-1.5, 0.066_807_201_268_858_07),
        (0.0, 0.5),
        (2.0, 0.977_249_868_051_820_8),
    ];

    /// SciPy 1.17.1:
    /// `python -c "from scipy.stats import norm; print([norm.cdf(z) for z in (-37, -8, -7.08, -7, -5, -1.5, 0, 2)])"`.
    #[test]
    fn probabilities_match_scipy() {
        for (z, expected) in SCIPY {
            assert!((cdf(z) / expected - 1.0).abs() < 1e-12, "{z}: {}", cdf(z));
        }
        assert_eq!((cdf(f64::NEG_INFINITY), cdf(f64::INFINITY)), (0.0, 1.0));
    }

    #[test]
    fn quantiles_invert_probabilities() {
        for (z, expected) in SCIPY {
            assert!((quantile(expected) - z).abs() < 1e-12 * z.abs().max(1.0), "{z}: {}", quantile(expected));
        }
        assert_eq!((quantile(0.0), quantile(1.0)), (f64::NEG_INFINITY, f64::INFINITY));
    }
}
