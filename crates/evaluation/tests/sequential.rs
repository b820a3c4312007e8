//! Sequential statistics by simulation: how often an interval ever misses the true value, however
//! often one looks, and how often a rule that stops by itself raises a false alarm.
//!
//! Each share is of 2,000 replications. A method that keeps 5 % exactly would exceed 6.5 % by
//! chance once in 1,000 times.

use mishandle_evaluation::{
    ClippedDifferences, DifferenceSequence, RateSequence, StopRule, sign_test, wilson,
};
use mishandle_random::Sequence;
use mishandle_results::StopDecision;

const REPLICATIONS: u64 = 2000;

/// Largest share of misses: 5 %, and three standard errors of 2,000 replications.
const MISSES: f64 = 0.065;

/// ln 20, the logarithm of the capital that excludes a candidate.
const EXCLUDED: f64 = 2.995_732_273_553_991;

/// Draws the robustness of A and of B.
type DrawPair = dyn Fn(&mut Sequence) -> (f64, f64);

/// Returns the share of the replications for which `misses` holds.
fn share(mut misses: impl FnMut(&mut Sequence) -> bool) -> f64 {
    let missed = (0..REPLICATIONS).filter(|stream| misses(&mut Sequence::new(47, *stream))).count();
    missed as f64 / REPLICATIONS as f64
}

#[test]
fn the_interval_of_a_rate_hardly_ever_misses_it_at_any_of_2000_looks() {
    for p in [0.5, 0.95, 0.999] {
        let found = share(|sequence| {
            let mut rate = RateSequence::default();
            (0..2000).any(|_| {
                rate.add(sequence.uniform() < p);
                rate.log_capital(p) >= EXCLUDED
            })
        });
        assert!(found <= MISSES, "{p}: {found}");
    }
}

#[test]
fn looking_at_wilsons_interval_again_and_again_misses_the_rate() {
    let found = share(|sequence| {
        let mut successes = 0;
        (1..=2000).any(|n| {
            successes += u64::from(sequence.uniform() < 0.5);
            let rate = wilson(successes, n);
            n % 64 == 0 && !(rate.low.unwrap()..=rate.high.unwrap()).contains(&0.5)
        })
    });
    assert!(found > 0.15, "31 looks of 5 % each: {found}");
}

#[test]
fn the_interval_of_a_paired_difference_hardly_ever_misses_it_at_any_of_300_looks() {
    for [first_only, second_only] in [[0.05, 0.05], [0.02, 0.06], [0.4, 0.3], [0.001, 0.0]] {
        let truth = second_only - first_only;
        let found = share(|sequence| {
            let mut difference = DifferenceSequence::default();
            (0..300).any(|_| {
                let u = sequence.uniform();
                difference.add(u < first_only, (first_only..first_only + second_only).contains(&u));
                difference.log_capital(truth) >= EXCLUDED
            })
        });
        assert!(found <= MISSES, "{first_only} and {second_only}: {found}");
    }
}

#[test]
fn the_interval_of_clipped_robustness_hardly_ever_misses_its_mean_difference() {
    // B loses 1 in 2 % of the pairs and gains 0.02 / 0.98 in the others: the mean difference is 0,
    // and most samples of 50 pairs look as if B were better.
    let rare = |sequence: &mut Sequence| {
        if sequence.uniform() < 0.02 { (0.5, -0.5) } else { (0.3, 0.3 + 0.02 / 0.98) }
    };
    // Values beyond the bounds count as the bound: A and B are clipped to the same numbers.
    let beyond = |sequence: &mut Sequence| {
        let wide = |u: f64| 8.0 * u - 4.0;
        (wide(sequence.uniform()), wide(sequence.uniform()))
    };
    let draws: [&DrawPair; 2] = [&rare, &beyond];
    for draw in draws {
        let found = share(|sequence| {
            let mut differences = ClippedDifferences::new([-0.5, 0.5]);
            for _ in 0..1000 {
                let (first, second) = draw(sequence);
                differences.add(first, second);
            }
            // The p-value is that of the largest capital at any time.
            differences.p_value() <= 0.05
        });
        assert!(found <= MISSES, "{found}");
    }
}

/// Returns the share of comparisons of equal rates that `decide` calls different within 2,000
/// pairs, with a look after each 64.
fn false_alarms(decide: impl Fn(&mut DifferenceSequence) -> bool) -> f64 {
    share(|sequence| {
        let mut difference = DifferenceSequence::default();
        (1..=2000).any(|n| {
            let u = sequence.uniform();
            difference.add(u < 0.1, (0.1..0.2).contains(&u));
            n % 64 == 0 && decide(&mut difference)
        })
    })
}

#[test]
fn equal_controllers_are_called_different_in_at_most_5_percent_of_the_comparisons() {
    let rule = StopRule::Difference(None);
    let found = false_alarms(|difference| {
        difference.look();
        let decision = rule.decide(&difference.estimate());
        matches!(decision, Some(StopDecision::Above | StopDecision::Below))
    });
    assert!(found <= MISSES, "{found}");
    // McNemar's test, once for each look, is wrong several times as often.
    let repeated = false_alarms(|difference| {
        let counts = difference.counts();
        sign_test(counts.first_only, counts.second_only) <= 0.05
    });
    assert!(repeated > 0.15, "{repeated}");
}

#[test]
fn different_controllers_are_called_equivalent_in_at_most_5_percent_of_the_comparisons() {
    // The difference is exactly the margin.
    let rule = StopRule::Difference(Some(0.05));
    let found = share(|sequence| {
        let mut difference = DifferenceSequence::default();
        for n in 1..=3000 {
            let u = sequence.uniform();
            difference.add(u < 0.01, (0.01..0.07).contains(&u));
            if n % 64 == 0 {
                difference.look();
                if let Some(decision) = rule.decide(&difference.estimate()) {
                    return decision == StopDecision::Equivalent;
                }
            }
        }
        false
    });
    assert!(found <= MISSES, "{found}");
}
