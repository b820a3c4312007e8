//! Transforms of robustness to targets of a Gaussian process.
//!
//! Robustness has heavy tails (a ball that falls off the table), ties (robustness of discrete
//! events) and infinite values (simulations without a verdict). A Gaussian process fits none of
//! them. All transforms are monotone and give targets with mean 0 and variance 1. Infinite values
//! become the largest finite one: all that is known of them is that they are not low.

/// A transform of robustness.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Transform {
    /// Standardization only.
    Standard,
    /// asinh((y - median) / scale): linear near the median, logarithmic in the tails.
    Asinh,
    /// Normal scores of the ranks; ties have their mean rank.
    Rank,
}

impl Transform {
    /// The names of all transforms.
    pub(crate) const NAMES: &str = "\"asinh\", \"rank\" or \"standard\"";

    /// Returns the transform with this name.
    pub(crate) fn by_name(name: &str) -> Option<Self> {
        match name {
            "standard" => Some(Transform::Standard),
            "asinh" => Some(Transform::Asinh),
            "rank" => Some(Transform::Rank),
            _ => None,
        }
    }

    /// Returns the targets of `values`, which contain no NaN, and the target that a robustness of
    /// `level` would have.
    pub(crate) fn targets(self, values: &[f64], level: f64) -> (Vec<f64>, f64) {
        let highest = values.iter().copied().filter(|y| y.is_finite()).fold(f64::NEG_INFINITY, f64::max);
        let lowest = values.iter().copied().filter(|y| y.is_finite()).fold(f64::INFINITY, f64::min);
        if highest <= lowest {
            // No finite value, or one: nothing is known of scales.
            let targets = values.iter().map(|y| if *y > highest { 1.0 } else { 0.0 }).collect();
            return standardized(targets, if level < lowest { -3.0 } else { 0.0 });
        }
        let mut scaled: Vec<f64> = values.iter().map(|y| y.clamp(lowest, highest)).collect();
        let mut level = level;
        if self != Transform::Standard {
            let (center, scale) = median_and_scale(&scaled);
            let asinh = |y: f64| ((y - center) / scale).asinh();
            scaled.iter_mut().for_each(|y| *y = asinh(*y));
            level = asinh(level);
        }
        if self == Transform::Rank { normal_scores(&scaled, level) } else { standardized(scaled, level) }
    }
}

/// Returns median and a robust measure of scale: the interquartile range over that of the normal
/// distribution, or the standard deviation if at least half of the values are equal.
fn median_and_scale(values: &[f64]) -> (f64, f64) {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let quantile = |q: f64| sorted[((sorted.len() - 1) as f64 * q).round() as usize];
    let range = (quantile(0.75) - quantile(0.25)) / 1.349;
    let scale = if range > 0.0 { range } else { mean_and_deviation(values).1 };
    (quantile(0.5), scale.max(f64::MIN_POSITIVE))
}

fn mean_and_deviation(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|y| (y - mean) * (y - mean)).sum::<f64>() / n;
    (mean, variance.sqrt())
}

fn standardized(mut values: Vec<f64>, level: f64) -> (Vec<f64>, f64) {
    let (mean, deviation) = mean_and_deviation(&values);
    let scale = if deviation > 0.0 { deviation.recip() } else { 1.0 };
    values.iter_mut().for_each(|y| *y = (*y - mean) * scale);
    (values, (level - mean) * scale)
}

/// Returns the normal scores Φ⁻¹((rank - 3/8) / (n + 1/4)). The score of a level between two values
/// is interpolated; below the lowest value it continues with the mean slope from the median.
fn normal_scores(values: &[f64], level: f64) -> (Vec<f64>, f64) {
    let ranks = mean_ranks(values);
    let n = values.len() as f64;
    let scores: Vec<f64> = ranks.iter().map(|rank| normal_quantile((rank - 0.375) / (n + 0.25))).collect();
    let mut curve: Vec<(f64, f64)> = values.iter().copied().zip(scores.iter().copied()).collect();
    curve.sort_by(|a, b| a.0.total_cmp(&b.0));
    standardized(scores, interpolated(&curve, level))
}

fn interpolated(curve: &[(f64, f64)], x: f64) -> f64 {
    let after = curve.partition_point(|point| point.0 < x);
    let (low, high) = match after {
        0 => (curve[0], curve[curve.len() / 2]),
        after if after == curve.len() => return curve[after - 1].1,
        after => (curve[after - 1], curve[after]),
    };
    let slope = if high.0 > low.0 { (high.1 - low.1) / (high.0 - low.0) } else { 1.0 };
    low.1 + slope * (x - low.0)
}

/// Returns the rank of each value, from 1; equal values have the mean of their ranks.
pub(crate) fn mean_ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&i, &j| values[i].total_cmp(&values[j]));
    let mut ranks = vec![0.0; values.len()];
    let mut first = 0;
    while first < order.len() {
        let value = values[order[first]];
        let ties = order[first..].iter().take_while(|&&i| values[i] == value).count();
        let rank = first as f64 + 0.5 * (ties as f64 + 1.0);
        order[first..first + ties].iter().for_each(|&i| ranks[i] = rank);
        first += ties;
    }
    ranks
}

/// Returns Spearman's rank correlation; 0 if one side is constant.
pub(crate) fn rank_correlation(a: &[f64], b: &[f64]) -> f64 {
    let a = mean_ranks(a);
    let b = mean_ranks(b);
    let mean = 0.5 * (a.len() as f64 + 1.0);
    let sum = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| (x - mean) * (y - mean)).sum::<f64>();
    let scale = (sum(&a, &a) * sum(&b, &b)).sqrt();
    if scale > 0.0 { sum(&a, &b) / scale } else { 0.0 }
}

/// Returns the quantile function of the standard normal distribution for p in (0, 1), with a
/// relative error below 1.2e-9.
///
/// # Reference
/// Acklam, "An algorithm for computing the inverse normal cumulative distribution function", 2003.
fn normal_quantile(p: f64) -> f64 {
    const A: [f64; 6] = [
        -3.969_683_028_665_376e1,
        2.209_460_984_245_205e2,
        -2.759_285_104_469_687e2,
        1.383_577_518_672_69e2,
        -3.066_479_806_614_716e1,
        2.506_628_277_459_239,
    ];
    const B: [f64; 6] = [
        -5.447_609_879_822_406e1,
        1.615_858_368_580_409e2,
        -1.556_989_798_598_866e2,
        6.680_131_188_771_972e1,
        -1.328_068_155_288_572e1,
        1.0,
    ];
    const C: [f64; 6] = [
        -7.784_894_002_430_293e-3,
        -3.223_964_580_411_365e-1,
        -2.400_758_277_161_838,
        -2.549_732_539_343_734,
        4.374_664_141_464_968,
        2.938_163_982_698_783,
    ];
    const D: [f64; 5] = [
        7.784_695_709_041_462e-3,
        3.224_671_290_700_398e-1,
        2.445_134_137_142_996,
        3.754_408_661_907_416,
        1.0,
    ];
    let polynomial = |c: &[f64], x: f64| c.iter().fold(0.0, |sum, c| sum * x + c);
    let tail = |p: f64| {
        let q = (-2.0 * p.ln()).sqrt();
        polynomial(&C, q) / polynomial(&D, q)
    };
    if p < 0.02425 {
        tail(p)
    } else if p > 1.0 - 0.02425 {
        -tail(1.0 - p)
    } else {
        let q = p - 0.5;
        q * polynomial(&A, q * q) / polynomial(&B, q * q)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Transform; 3] = [Transform::Standard, Transform::Asinh, Transform::Rank];

    #[test]
    fn targets_are_standardized_and_monotone() {
        let values = [3.0, -0.2, 1e6, f64::INFINITY, 0.5, 0.5, 0.0, -40.0];
        for transform in ALL {
            let (targets, _) = transform.targets(&values, 0.0);
            let (mean, deviation) = mean_and_deviation(&targets);
            assert!(mean.abs() < 1e-12 && (deviation - 1.0).abs() < 1e-12, "{transform:?}");
            for (i, j) in (0..8).flat_map(|i| (0..8).map(move |j| (i, j))) {
                assert!(values[i] > values[j] || targets[i] <= targets[j], "{transform:?}");
            }
            assert_eq!(targets[4], targets[5]);
        }
    }

    #[test]
    fn infinite_values_equal_the_largest_finite_one() {
        for transform in ALL {
            let (targets, _) = transform.targets(&[1.0, 2.0, 5.0, f64::INFINITY], 0.0);
            assert_eq!(targets[2], targets[3], "{transform:?}");
        }
    }

    #[test]
    fn constant_and_infinite_values_give_finite_targets() {
        for transform in ALL {
            for values in [vec![1.0; 4], vec![f64::INFINITY; 4], vec![2.0, f64::INFINITY], vec![7.0]] {
                let (targets, level) = transform.targets(&values, 0.0);
                assert!(
                    targets.iter().all(|t| t.is_finite()) && level.is_finite(),
                    "{transform:?} {values:?}"
                );
            }
        }
    }

    /// A level equal to a value has the target of the value; a level below all values is below all
    /// targets.
    #[test]
    fn level_is_on_the_scale_of_the_targets() {
        let values = [0.3, 0.9, 0.1, 2.0, 50.0];
        for transform in ALL {
            for (i, value) in values.iter().enumerate() {
                let (targets, level) = transform.targets(&values, *value);
                assert!((targets[i] - level).abs() < 1e-12, "{transform:?}");
            }
            let (targets, level) = transform.targets(&values, 0.0);
            assert!(targets.iter().all(|target| level < *target), "{transform:?}");
        }
    }

    /// Published quantiles of the standard normal distribution.
    #[test]
    fn normal_quantiles_agree_with_tables() {
        for (p, x) in [
            (0.5, 0.0),
            (0.975, 1.959_963_984_540_054),
            (0.01, -2.326_347_874_040_841),
            (0.999, 3.090_232_306_167_813_5),
        ] {
            assert!((normal_quantile(p) - x).abs() < 1e-8, "{p}");
        }
    }

    /// Ranks 1, 2.5, 2.5, 4 and 4, 1.5, 1.5, 3: the centered products sum to -1.5, the centered
    /// squares to 4.5 each.
    #[test]
    fn rank_correlation_averages_ties() {
        let a = [0.0, 1.0, 1.0, 9.0];
        let b = [8.0, 2.0, 2.0, 3.0];
        assert_eq!(mean_ranks(&a), [1.0, 2.5, 2.5, 4.0]);
        assert_eq!(mean_ranks(&b), [4.0, 1.5, 1.5, 3.0]);
        assert!((rank_correlation(&a, &b) + 1.5 / 4.5).abs() < 1e-15);
        assert_eq!(rank_correlation(&a, &[1.0; 4]), 0.0);
    }
}
