//! Tasks of the benchmark as target files: the same traces, bit for bit.

#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "mod.rs"]
mod both;

use mishandle_rollout::Episode;

fn traces_are_equal(task: &str) {
    let [expected, found] = both::targets(task).map(|target| both::simulate(&target, 40));
    for (row, (expected, found)) in expected.iter().zip(&found).enumerate() {
        assert_eq!(expected.trace.names(), found.trace.names());
        for (column, name) in expected.trace.names().iter().enumerate() {
            let bits = |episode: &Episode| -> Vec<u64> {
                episode.trace.column(column).iter().map(|x| x.to_bits()).collect()
            };
            let (expected, found) = (bits(expected), bits(found));
            let differs = expected.iter().zip(&found).position(|(a, b)| a != b);
            assert_eq!((differs, expected.len()), (None, found.len()), "{name} in simulation {row}");
        }
        let robustness = |episode: &Episode| episode.verdict.robustness.map(f64::to_bits);
        assert_eq!(robustness(expected), robustness(found));
    }
}

#[test]
fn point_reaching_as_a_file_has_the_same_traces() {
    traces_are_equal("point-reaching");
}

#[test]
fn ball_balancing_as_a_file_has_the_same_traces() {
    traces_are_equal("ball-balancing");
}

/// The seed draws the offsets of the start in both.
#[test]
fn ball_pushing_as_a_file_has_the_same_traces() {
    traces_are_equal("ball-pushing");
}

#[test]
fn door_opening_as_a_file_has_the_same_traces() {
    traces_are_equal("door-opening");
}
