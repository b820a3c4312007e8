//! Statistics over seeds: the interquartile mean and its confidence interval.

/// Share of the values that is trimmed at each end.
const TRIMMED: f64 = 0.25;

/// Quantiles of the resampled means that bound the 95 % interval.
const ENDS: [f64; 2] = [0.025, 0.975];

/// Returns the mean of the middle half of `values`; `None` for no values.
///
/// A quarter of the values is trimmed at each end. If the border falls inside a value, that value
/// counts in part.
///
/// # Example
/// ```
/// use mishandle_zoo::interquartile_mean;
/// assert_eq!(interquartile_mean(&[9.0, 1.0, 2.0, 100.0]), Some(5.5));
/// assert_eq!(interquartile_mean(&[]), None);
/// ```
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

/// Returns the 95 % percentile bootstrap interval of the interquartile mean; `None` for fewer than
/// two values.
///
/// The bootstrap is exact: it enumerates every sample with replacement with its probability, so it
/// needs no random numbers. n values have (2n - 1)! / (n! (n - 1)!) different samples: 126 for
/// n = 5.
///
/// # Reference
/// Efron and Tibshirani, "An Introduction to the Bootstrap", 1993, chapter 13. Agarwal et al.,
/// "Deep reinforcement learning at the edge of the statistical precipice", NeurIPS 2021, propose
/// interquartile means over seeds.
pub fn interquartile_mean_interval(values: &[f64]) -> Option<[f64; 2]> {
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

/// Visits all ways to draw `left` more values from the places `first` and above, as the count of
/// each place.
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

/// Returns the probability of these counts in n draws from n places: n! / (c₁! … cₙ!) / nⁿ.
fn probability(counts: &[usize]) -> f64 {
    let n = counts.iter().sum::<usize>();
    let factorial = |count: usize| (1..=count).map(|i| i as f64).product::<f64>();
    let ways = counts.iter().fold(factorial(n), |ways, count| ways / factorial(*count));
    ways / (n as f64).powi(n as i32)
}

/// Returns the least value whose cumulative probability is at least `p`.
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
    fn a_quarter_of_the_values_is_trimmed_at_each_end() {
        // Four and eight values: whole values are trimmed, as by scipy.stats.trim_mean(values,
        // 0.25).
        check(&[9.0, 1.0, 2.0, 100.0], 5.5);
        check(&[1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 90.0, 100.0], (3.0 + 4.0 + 6.0 + 8.0) / 4.0);
        // Five values: 1.25 are trimmed at each end, which leaves 0.75, 1 and 0.75 of the three in
        // the middle.
        check(&[0.0, 10.0, 20.0, 40.0, 1000.0], (0.75 * 10.0 + 20.0 + 0.75 * 40.0) / 2.5);
        // Three values: 0.75 are trimmed at each end.
        check(&[0.0, 10.0, 40.0], (0.25 * 0.0 + 10.0 + 0.25 * 40.0) / 1.5);
        check(&[2.0, 4.0], 3.0);
        check(&[7.0], 7.0);
        assert_eq!(interquartile_mean(&[]), None);
    }

    #[test]
    fn two_values_have_three_samples() {
        // Both low, one of each (two orders), both high: 1/4, 1/2, 1/4. The 95 % interval covers
        // all of them.
        let mut samples = Vec::new();
        for_each_sample(&mut vec![0; 2], 0, 2, &mut |counts| {
            samples.push((counts.to_vec(), probability(counts)));
        });
        assert_eq!(samples, [(vec![0, 2], 0.25), (vec![1, 1], 0.5), (vec![2, 0], 0.25)]);
        assert_eq!(interquartile_mean_interval(&[1.0, 2.0]), Some([1.0, 2.0]));
        assert_eq!(interquartile_mean_interval(&[1.0]), None);
    }

    #[test]
    fn the_interval_of_zeros_and_a_one_matches_the_hand_count() {
        // Three values, one of them 1: a sample has k ones with probability C(3,k) 2^(3-k) / 27 =
        // 8, 12, 6, 1 of 27. The means for 0, 1, 2 and 3 ones are 0, 1/6, 5/6 and 1. At most 2
        // ones: 26 / 27 = 0.963, below 0.975.
        assert_eq!(interquartile_mean_interval(&[0.0, 0.0, 1.0]), Some([0.0, 1.0]));
        // Five values, one of them 1: k ones with probability C(5,k) 4^(5-k) / 3125, which is 1024,
        // 1280, 640, 160, 20, 1 of 3125. At most 2: 0.942; at most 3: 0.993. Three ones in five:
        // 0.75 zeros and 1.75 ones remain: 1.75 / 2.5.
        let [low, high] = interquartile_mean_interval(&[0.0, 0.0, 0.0, 0.0, 1.0]).unwrap();
        assert_eq!(low, 0.0);
        assert!((high - 0.7).abs() < 1e-12, "{high}");
    }

    #[test]
    fn the_probabilities_of_all_samples_add_up_to_one() {
        let (mut sum, mut count) = (0.0, 0);
        for_each_sample(&mut vec![0; 5], 0, 5, &mut |counts| {
            sum += probability(counts);
            count += 1;
        });
        assert_eq!(count, 126);
        assert!((sum - 1.0_f64).abs() < 1e-12);
    }
}
