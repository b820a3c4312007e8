//! Coverage of the confidence intervals: the probability that a nominal 95 % interval contains the
//! true value.
//!
//! Rates are computed exactly from the binomial distribution. Means are simulated, with a tolerance
//! of five standard errors.

use mishandle_evaluation::{Estimate, betting_mean, bootstrap_mean, wilson};
use mishandle_random::{Seed, Sequence};

/// Draws a value of a distribution.
type Draw = dyn Fn(&mut Sequence) -> f64;

/// Returns the fraction of `samples` samples of size `n` whose interval contains `mean`.
fn coverage(
    draw: &Draw,
    mean: f64,
    n: usize,
    samples: u64,
    interval: &dyn Fn(&[f64], u64) -> Estimate,
) -> f64 {
    let covers = |sample: &u64| {
        let mut sequence = Sequence::new(*sample, n as u64);
        let values: Vec<f64> = (0..n).map(|_| draw(&mut sequence)).collect();
        let Estimate { low, high, .. } = interval(&values, *sample);
        low.is_some_and(|low| low <= mean) && high.is_some_and(|high| mean <= high)
    };
    (0..samples).filter(covers).count() as f64 / samples as f64
}

fn betting(values: &[f64], _: u64) -> Estimate {
    betting_mean(values)
}

/// Returns a distribution that is `value` with probability `p`, else 0.
fn rare(p: f64, value: f64) -> impl Fn(&mut Sequence) -> f64 {
    move |sequence| if sequence.uniform() < p { value } else { 0.0 }
}

/// An exponential distribution with this mean, cut off at 1. Its true mean is
/// `mean (1 - exp(-1 / mean))`.
fn skewed(mean: f64) -> impl Fn(&mut Sequence) -> f64 {
    move |sequence| (-mean * (1.0 - sequence.uniform()).ln()).min(1.0)
}

#[test]
fn the_betting_interval_covers_rare_clustered_and_skewed_danger() {
    let skewed_mean = |mean: f64| mean * (1.0 - (-1.0 / mean).exp());
    let cases: [(&str, Box<Draw>, f64); 7] = [
        ("one of 1000 episodes is dangerous throughout", Box::new(rare(0.001, 1.0)), 0.001),
        ("one of 100 episodes is dangerous throughout", Box::new(rare(0.01, 1.0)), 0.01),
        ("one of 700 episodes is dangerous for half its time", Box::new(rare(1.0 / 700.0, 0.5)), 0.5 / 700.0),
        ("a fair coin", Box::new(rare(0.5, 1.0)), 0.5),
        ("never any danger", Box::new(rare(0.0, 1.0)), 0.0),
        ("skewed", Box::new(skewed(0.02)), skewed_mean(0.02)),
        (
            "two clusters",
            Box::new(|sequence: &mut Sequence| {
                0.05 + 0.01 * sequence.uniform() + if sequence.uniform() < 0.02 { 0.9 } else { 0.0 }
            }),
            0.055 + 0.02 * 0.9,
        ),
    ];
    for (name, draw, mean) in &cases {
        // Five standard errors of 0.95 in 1000 samples are 0.034, in 300 samples 0.063.
        for (n, samples, tolerance) in
            [(1, 1000, 0.034), (10, 1000, 0.034), (100, 1000, 0.034), (1000, 300, 0.063)]
        {
            let found = coverage(draw, *mean, n, samples, &betting);
            assert!(found >= 0.95 - tolerance, "{name}, n = {n}: {found}");
        }
    }
}

#[test]
fn the_bootstrap_misses_rare_danger_that_the_betting_interval_covers() {
    // At most 1 - 0.9985^100 = 13.9 % of all samples contain the event, and no other sample has an
    // interval that does.
    let rare = rare(0.0015, 1.0);
    let bootstrap = |values: &[f64], seed: u64| bootstrap_mean(values, Seed(seed));
    let found = coverage(&rare, 0.0015, 100, 500, &bootstrap);
    assert!((found - 0.139).abs() < 0.078, "{found}");
    assert!(coverage(&rare, 0.0015, 100, 1000, &betting) > 0.95);
}

/// Coverage of the interval of task completion times, as its documentation states it.
#[test]
fn the_bootstrap_covers_a_mean_of_moderate_skewness_and_not_one_of_rare_values() {
    let bootstrap = |values: &[f64], seed: u64| bootstrap_mean(values, Seed(seed));
    let exponential = |sequence: &mut Sequence| -(1.0 - sequence.uniform()).ln();
    let uniform = |sequence: &mut Sequence| sequence.uniform();
    // One of 100 simulations takes 300 control steps, the others 15.
    let late = |sequence: &mut Sequence| if sequence.uniform() < 0.01 { 300.0 } else { 15.0 };
    let cases: [(&str, &Draw, f64, usize, [f64; 2]); 6] = [
        ("uniform", &uniform, 0.5, 10, [0.84, 0.97]),
        ("uniform", &uniform, 0.5, 100, [0.89, 0.99]),
        ("exponential", &exponential, 1.0, 10, [0.78, 0.94]),
        ("exponential", &exponential, 1.0, 30, [0.85, 0.96]),
        ("exponential", &exponential, 1.0, 100, [0.88, 0.99]),
        // 63 % of all samples of 100 contain a late simulation.
        ("late", &late, 17.85, 100, [0.51, 0.76]),
    ];
    for (name, draw, mean, n, [low, high]) in cases {
        let found = coverage(draw, mean, n, 400, &bootstrap);
        assert!((low..=high).contains(&found), "{name}, n = {n}: {found}");
    }
}

/// Returns the probabilities of 0 to `n` successes with success probability `p`.
fn binomial(n: u64, p: f64) -> Vec<f64> {
    let mut log_ways = 0.0;
    let probability = |k: u64| {
        let successes = if k == 0 { 0.0 } else { k as f64 * p.ln() };
        let failures = if k == n { 0.0 } else { (n - k) as f64 * (1.0 - p).ln() };
        let probability = (log_ways + successes + failures).exp();
        log_ways += ((n - k) as f64 / (k + 1) as f64).ln();
        probability
    };
    (0..=n).map(probability).collect()
}

/// Returns the exact coverage of the Wilson interval of n simulations at each of these success
/// probabilities.
fn wilson_coverage(n: u64, rates: impl Iterator<Item = f64>) -> Vec<f64> {
    let intervals: Vec<Estimate> = (0..=n).map(|k| wilson(k, n)).collect();
    let covered = |p: f64| {
        let contains = |estimate: &Estimate| estimate.low.unwrap() <= p && p <= estimate.high.unwrap();
        binomial(n, p)
            .iter()
            .zip(&intervals)
            .filter(|(_, it)| contains(it))
            .map(|(probability, _)| probability)
            .sum()
    };
    rates.map(covered).collect()
}

#[test]
fn the_wilson_interval_has_a_mean_coverage_of_95_percent_and_at_least_83() {
    for n in [10, 30, 100, 500] {
        let found = wilson_coverage(n, (1..5000).map(|i| f64::from(i) / 5000.0));
        let mean = found.iter().sum::<f64>() / found.len() as f64;
        // The coverage is least just outside the ends of an interval.
        let outside = (1..=n).map(|k| wilson(k, n).low.unwrap() - 1e-12);
        let least = wilson_coverage(n, outside).into_iter().fold(1.0, f64::min);
        assert!((mean - 0.95).abs() < 0.005, "n = {n}: mean coverage {mean}");
        // The least coverage is near p = 0.18 / n: Brown, Cai and DasGupta, "Interval estimation
        // for a binomial proportion", Statistical Science 16, 2001, section 4.1.1.
        assert!((0.83..0.86).contains(&least), "n = {n}: least coverage {least}");
    }
}

/// Returns the Clopper-Pearson interval by bisection of the binomial tails.
fn clopper_pearson(k: u64, n: u64) -> [f64; 2] {
    let solve = |tail: &dyn Fn(f64) -> f64| {
        let mut low = 0.0;
        let mut high = 1.0;
        for _ in 0..60 {
            let p = 0.5 * (low + high);
            if tail(p) < 0.025 { low = p } else { high = p }
        }
        low
    };
    let at_least = |p: f64| binomial(n, p)[k as usize..].iter().sum::<f64>();
    let at_most = |q: f64| binomial(n, 1.0 - q)[..=k as usize].iter().sum::<f64>();
    [if k == 0 { 0.0 } else { solve(&at_least) }, if k == n { 1.0 } else { 1.0 - solve(&at_most) }]
}

#[test]
fn the_betting_interval_of_a_rate_is_at_most_half_wider_than_the_exact_one() {
    // Agresti and Coull, "Approximate is better than exact", The American Statistician 52, 1998: 0
    // of 10 and 5 of 10.
    let close = |found: [f64; 2], expected: [f64; 2]| {
        assert!(
            found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 5e-4),
            "{found:?}, expected {expected:?}"
        );
    };
    close(clopper_pearson(0, 10), [0.0, 0.3085]);
    close(clopper_pearson(5, 10), [0.1871, 0.8129]);
    for (k, n) in [(0, 10), (0, 100), (0, 1000), (1, 100), (3, 1000), (50, 100), (300, 1000), (100, 100)] {
        let [low, high] = clopper_pearson(k, n);
        // The interval depends on the order of the values; this is the mean of 20 orders.
        let width = |seed: u64| {
            let mut sequence = Sequence::new(seed, 0);
            let mut values: Vec<f64> = (0..n).map(|i| if i < k { 1.0 } else { 0.0 }).collect();
            (1..n).for_each(|i| values.swap(i as usize, sequence.below(i + 1) as usize));
            let found = betting_mean(&values);
            found.high.unwrap() - found.low.unwrap()
        };
        let ratio = (0..20).map(width).sum::<f64>() / 20.0 / (high - low);
        assert!((0.9..1.5).contains(&ratio), "{k} of {n}: {ratio}");
    }
}
