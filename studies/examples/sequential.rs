//! Prints how often the intervals that hold at any time ever miss the true value, as Markdown.
//!
//! ```console
//! $ cargo run -q -p mishandle-studies --example sequential -- 20000
//! ```

#![expect(clippy::print_stdout, reason = "its output is its purpose")]

use mishandle::evaluation::{ClippedDifferences, DifferenceSequence, RateSequence, sign_test, wilson};
use mishandle::random::Sequence;

/// Random seed of all replications.
const SEED: u64 = 47;

/// ln 20, the logarithm of the capital that excludes a candidate.
const EXCLUDED: f64 = 2.995_732_273_553_991;

/// Number of values after each of which one looks.
const VALUES: u64 = 2000;

/// Number of values between two looks at an interval for a fixed number.
const BATCH: u64 = 64;

fn main() {
    let replications: u64 = std::env::args().nth(1).and_then(|text| text.parse().ok()).unwrap_or(2000);
    let share = |misses: &dyn Fn(&mut Sequence) -> bool| {
        let missed = (0..replications).filter(|stream| misses(&mut Sequence::new(SEED, *stream))).count();
        format!("{:.2} %", 100.0 * missed as f64 / replications as f64)
    };
    println!(
        "| truth | a look after each of {VALUES} values | usual interval or test, a look after each {BATCH} |"
    );
    println!("|---|--:|--:|");
    for p in [0.5, 0.95, 0.999] {
        let anytime = share(&|sequence| {
            let mut rate = RateSequence::default();
            (0..VALUES).any(|_| {
                rate.add(sequence.uniform() < p);
                rate.log_capital(p) >= EXCLUDED
            })
        });
        let usual = share(&|sequence| {
            let mut successes = 0;
            (1..=VALUES).any(|n| {
                successes += u64::from(sequence.uniform() < p);
                let found = wilson(successes, n);
                let contains = found.low <= Some(p) && Some(p) <= found.high;
                n.is_multiple_of(BATCH) && !contains
            })
        });
        println!("| rate {p} | {anytime} | {usual} |");
    }
    for [first_only, second_only] in [[0.1, 0.1], [0.02, 0.02], [0.02, 0.06], [0.001, 0.0]] {
        let truth: f64 = second_only - first_only;
        let draw = |sequence: &mut Sequence| {
            let u = sequence.uniform();
            (u < first_only, (first_only..first_only + second_only).contains(&u))
        };
        let anytime = share(&|sequence| {
            let mut difference = DifferenceSequence::default();
            (1..=VALUES).any(|n| {
                let (first, second) = draw(sequence);
                difference.add(first, second);
                n.is_multiple_of(BATCH) && difference.log_capital(truth) >= EXCLUDED
            })
        });
        let usual = share(&|sequence| {
            let mut difference = DifferenceSequence::default();
            (1..=VALUES).any(|n| {
                let (first, second) = draw(sequence);
                difference.add(first, second);
                let counts = difference.counts();
                n.is_multiple_of(BATCH) && sign_test(counts.first_only, counts.second_only) <= 0.05
            })
        });
        let usual = if truth == 0.0 { usual } else { "–".to_string() };
        println!("| pairs: only A {first_only}, only B {second_only} | {anytime} (each {BATCH}) | {usual} |");
    }
    let clipped = share(&|sequence| {
        let mut differences = ClippedDifferences::new([-0.5, 0.5]);
        for _ in 0..VALUES {
            if sequence.uniform() < 0.02 {
                differences.add(0.5, -0.5);
            } else {
                differences.add(0.3, 0.3 + 0.02 / 0.98);
            }
        }
        differences.p_value() <= 0.05
    });
    println!("| robustness: B loses 1 in 2 % of the pairs, mean difference 0 | {clipped} | – |");
}
