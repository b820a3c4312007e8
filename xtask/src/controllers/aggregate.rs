//! Several seeds as one: the interquartile mean, and what it is worth.

/// The share of the values that is left out at each end.
const TRIMMED: f64 = 0.25;

/// The quantiles between which 95 % of the resampled means lie.
const ENDS: [f64; 2] = [0.025, 0.975];

/// Mean of the middle half of `values`: a quarter is left out at each end, of a value that lies across that border only
/// the part beyond it. `None` of nothing.
pub fn interquartile_mean(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let n = sorted.len() as f64;
    let (low, high) = (TRIMMED * n, (1.0 - TRIMMED) * n);
    let (mut sum, mut weights) = (0.0, 0.0);
    for (i, value) in sorted.iter().enumerate() {
        let weight = (high.min(i as f64 + 1.0) - low.max(i as f64)).max(0.0);
        sum += weight * value;
        weights += weight;
    }
    (weights > 0.0).then(|| sum / weights)
}

/// 95 % interval of the interquartile mean by the percentile bootstrap over `values`, which are few: all their samples
/// with replacement are gone through, each with its probability, so that no random numbers are needed. `None` of fewer
/// than two values.
///
/// With n values that are (2n - 1)! / (n! (n - 1)!) different samples, 126 of five.
///
/// Efron and Tibshirani, "An Introduction to the Bootstrap", 1993, chapter 13; interquartile means over seeds are what
/// Agarwal et al., "Deep reinforcement learning at the edge of the statistical precipice", NeurIPS 2021, propose.
pub fn interval(values: &[f64]) -> Option<[f64; 2]> {
    if values.len() < 2 {
        return None;
    }
    let mut means: Vec<(f64, f64)> = Vec::new();
    for_each_sample(&mut vec![0; values.len()], 0, values.len(), &mut |counts| {
        let sample: Vec<f64> = values
            .iter()
            .zip(counts)
            .flat_map(|(value, count)| std::iter::repeat_n(*value, *count))
            .collect();
        means.extend(interquartile_mean(&sample).map(|mean| (mean, probability(counts))));
    });
    means.sort_by(|a, b| a.0.total_cmp(&b.0));
    Some(ENDS.map(|end| quantile(&means, end)))
}

/// All ways to draw `left` values, as how often each place is drawn, from the place `first` on.
fn for_each_sample(counts: &mut Vec<usize>, first: usize, left: usize, visit: &mut impl FnMut(&[usize])) {
    if first + 1 == counts.len() {
        counts[first] = left;
        visit(counts);
        return;
    }
    for count in 0..=left {
        counts[first] = count;
        for_each_sample(counts, first + 1, left - count, visit);
    }
}

/// The probability of drawing each of n places this often in n draws: n! / (c₁! … cₙ!) / nⁿ.
fn probability(counts: &[usize]) -> f64 {
    let n = counts.iter().sum::<usize>();
    let factorial = |count: usize| (1..=count).map(|i| i as f64).product::<f64>();
    let ways = counts.iter().fold(factorial(n), |ways, count| ways / factorial(*count));
    ways / (n as f64).powi(n as i32)
}

/// The least value whose probability, with that of all below it, is at least `p`.
fn quantile(sorted: &[(f64, f64)], p: f64) -> f64 {
    let mut sum = 0.0;
    let reached = sorted.iter().find(|(_, probability)| {
        sum += probability;
        sum >= p
    });
    reached.or(sorted.last()).map_or(f64::NAN, |(value, _)| *value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(values: &[f64], expected: f64) {
        let found = interquartile_mean(values).unwrap();
        assert!((found - expected).abs() < 1e-12, "{values:?}: {found}, not {expected}");
    }

    #[test]
    fn a_quarter_is_left_out_at_each_end() {
        // Four and eight values: a whole quarter at each end, as scipy.stats.trim_mean(values, 0.25) has it.
        check(&[9.0, 1.0, 2.0, 100.0], 5.5);
        check(&[1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 90.0, 100.0], (3.0 + 4.0 + 6.0 + 8.0) / 4.0);
        // Five: 1.25 at each end, so 0.75, 1 and 0.75 of the three in the middle.
        check(&[0.0, 10.0, 20.0, 40.0, 1000.0], (0.75 * 10.0 + 20.0 + 0.75 * 40.0) / 2.5);
        // Three: 0.75 at each end.
        check(&[0.0, 10.0, 40.0], (0.25 * 0.0 + 10.0 + 0.25 * 40.0) / 1.5);
        check(&[2.0, 4.0], 3.0);
        check(&[7.0], 7.0);
        assert_eq!(interquartile_mean(&[]), None);
    }

    #[test]
    fn the_samples_of_two_values_are_three() {
        // Both low, one of each (twice), both high: 1/4, 1/2, 1/4, and 95 % take in all of them.
        let mut seen = Vec::new();
        for_each_sample(&mut vec![0; 2], 0, 2, &mut |counts| {
            seen.push((counts.to_vec(), probability(counts)));
        });
        assert_eq!(seen, [(vec![0, 2], 0.25), (vec![1, 1], 0.5), (vec![2, 0], 0.25)]);
        assert_eq!(interval(&[1.0, 2.0]), Some([1.0, 2.0]));
        assert_eq!(interval(&[1.0]), None);
    }

    #[test]
    fn of_zeros_and_a_one_the_interval_is_counted_by_hand() {
        // Three values, one of them 1: k ones are drawn with probability C(3,k) 2^(3-k) / 27 = 8, 12, 6, 1 of 27. The
        // means of 0, 1, 2 and 3 ones are 0, 1/6, 5/6 and 1; up to 2 ones are 26 / 27 = 0.963, below 0.975.
        assert_eq!(interval(&[0.0, 0.0, 1.0]), Some([0.0, 1.0]));
        // Five values, one 1: k ones with C(5,k) 4^(5-k) / 3125, which is 1024, 1280, 640, 160, 20, 1. Up to 2: 0.942,
        // up to 3: 0.993. Three ones among five: 0.75 of a zero is kept, 1 and 0.75 of ones: 1.75 / 2.5.
        let [low, high] = interval(&[0.0, 0.0, 0.0, 0.0, 1.0]).unwrap();
        assert_eq!(low, 0.0);
        assert!((high - 0.7).abs() < 1e-12, "{high}");
    }

    #[test]
    fn all_samples_together_are_certain() {
        let (mut sum, mut count) = (0.0, 0);
        for_each_sample(&mut vec![0; 5], 0, 5, &mut |counts| {
            sum += probability(counts);
            count += 1;
        });
        assert_eq!(count, 126);
        assert!((sum - 1.0_f64).abs() < 1e-12);
    }
}
