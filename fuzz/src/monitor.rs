//! Monitors against the reference evaluator of the crate `stl`.

use std::sync::Arc;

use mishandle::stl::{
    Clock, DenseError, DenseMonitor, DenseSignal, Formula, Interpolation, Monitor, TimeUnit, Trace,
};

use crate::bytes::Bytes;

#[path = "../../crates/stl/tests/laws/naive/mod.rs"]
#[allow(dead_code, reason = "the tests of the crate `stl` use the rest")]
mod naive;

use naive::{Interval, NAMES, ONE, Random, TIMED_ONE, TIMED_TWO, TWO, Tree};

/// Longest trace. The reference evaluator takes quadratic time per operator.
const SAMPLES: usize = 40;

/// Deepest formula; it has at most 2⁶ operands.
const DEPTH: usize = 6;

/// Checks that the robustness signal of a formula equals that of the reference evaluator, also
/// after the formula was printed and parsed, or the trace was recorded, and that the robustness at
/// time 0 is its first value. Checks dense time likewise.
pub fn check(bytes: &[u8]) {
    let mut bytes = Bytes(bytes);
    let samples = 1 + bytes.below(SAMPLES);
    let mut spelling = Random(u64::from(bytes.next()));
    let tree = formula(&mut bytes, DEPTH, samples);
    let columns: Vec<Vec<f64>> =
        NAMES.iter().map(|_| (0..samples).map(|_| value(&mut bytes)).collect()).collect();

    let text = tree.write(&mut spelling);
    let formula = Formula::parse(&text).unwrap_or_else(|error| panic!("{text}: {error}"));
    let names: Arc<[String]> = NAMES.map(String::from).into();
    let mut trace = Trace::new(Arc::clone(&names));
    for step in 0..samples {
        trace.push(&columns.iter().map(|column| column[step]).collect::<Vec<_>>());
    }
    let expected = tree.evaluate(&columns);
    let printed: Formula = formula.to_string().parse().expect("a printed formula parses");
    for formula in [formula, printed] {
        let mut monitor = Monitor::new(&formula, &names, Clock::steps(1.0 / 60.0)).expect("known signals");
        assert_eq!(monitor.robustness(&trace), Ok(expected[0]), "{text} on {columns:?}");
        assert_eq!(monitor.robustness_signal(&trace), Ok(&expected[..]), "{text} on {columns:?}");
    }
    for interpolation in [Interpolation::Hold, Interpolation::Linear] {
        check_dense(&tree, &text, &columns, interpolation, &mut bytes);
    }
}

/// Checks dense time with samples at whole seconds, some of which the columns skip. Signals that
/// hold change there only, so that the values equal those of discrete time with a sample for each
/// second, and one for each time between two of them.
fn check_dense(
    tree: &Tree,
    text: &str,
    columns: &[Vec<f64>],
    interpolation: Interpolation,
    bytes: &mut Bytes<'_>,
) {
    let mut times = vec![0.0];
    for _ in 1..columns[0].len() {
        times.push(times[times.len() - 1] + 1.0 + bytes.below(2) as f64);
    }
    let signal = |(name, values): (&&str, &Vec<f64>)| {
        DenseSignal::new(*name, times.clone(), values.clone(), interpolation).expect("increasing times")
    };
    let signals: Vec<DenseSignal> = NAMES.iter().zip(columns).map(signal).collect();
    let formula = Formula::parse(text).unwrap_or_else(|error| panic!("{text}: {error}"));
    let monitor = match DenseMonitor::new(&formula, &NAMES.map(String::from), Some(TimeUnit::Seconds)) {
        Ok(monitor) => monitor,
        Err(error) => {
            let is_right = matches!(error, DenseError::NoNeighbor { .. }) && tree.has_neighbors();
            return assert!(is_right, "{text}: {error}");
        }
    };
    let found = match monitor.robustness_signal(&signals) {
        Ok(found) => found,
        Err(error) => {
            let is_right =
                matches!(error, DenseError::NotLinear { .. }) && interpolation == Interpolation::Linear;
            return assert!(is_right, "{text}: {error}");
        }
    };
    let points: Vec<_> = found.breakpoints().collect();
    assert!(points.windows(2).all(|pair| pair[0].time < pair[1].time), "{text} on {signals:?}");
    let is_number = |value: f64| !value.is_nan();
    assert!(points.iter().all(|point| [point.before, point.at, point.after].into_iter().all(is_number)));
    assert_eq!(found.domain(), Some((0.0, times[times.len() - 1])), "{text} on {signals:?}");
    if interpolation == Interpolation::Hold {
        assert_eq!(monitor.robustness(&signals).ok(), found.first(), "{text} on {signals:?}");
        let elements = 0..=2 * times[times.len() - 1] as usize;
        let held = |values: &Vec<f64>| -> Vec<f64> {
            let value =
                |element: usize| values[times.partition_point(|time| *time <= (element / 2) as f64) - 1];
            elements.clone().map(value).collect()
        };
        let expected = tree.on_grid(2).evaluate(&columns.iter().map(held).collect::<Vec<_>>());
        for (element, expected) in elements.clone().zip(expected) {
            assert_eq!(found.at(element as f64 / 2.0), Some(expected), "{text} at {element} on {signals:?}");
        }
    }
}

/// Returns a formula of at most this depth.
fn formula(bytes: &mut Bytes<'_>, depth: usize, samples: usize) -> Tree {
    let kind = if depth == 0 { bytes.below(3) } else { bytes.below(9) };
    let sub = |bytes: &mut Bytes<'_>| Box::new(formula(bytes, depth - 1, samples));
    match kind {
        0 => Tree::Signal(bytes.below(NAMES.len())),
        1 => Tree::Number(bytes.pick(&[f64::INFINITY, f64::NEG_INFINITY, 1.5])),
        2 => {
            let name = bytes.pick(&["<=", ">=", "<", ">", "==", "!=="]);
            let x = term(bytes);
            let y = term(bytes);
            Tree::Two(name, None, Box::new(x), Box::new(y))
        }
        3 => Tree::One(bytes.pick(&ONE), None, sub(bytes)),
        4 | 5 => Tree::One(bytes.pick(&TIMED_ONE), interval(bytes, samples), sub(bytes)),
        6 => Tree::Two(bytes.pick(&TWO), None, sub(bytes), sub(bytes)),
        _ => Tree::Two(bytes.pick(&TIMED_TWO), interval(bytes, samples), sub(bytes), sub(bytes)),
    }
}

/// Returns arithmetic of at most one operator.
fn term(bytes: &mut Bytes<'_>) -> Tree {
    let leaf = |bytes: &mut Bytes<'_>| match bytes.below(2) {
        0 => Tree::Signal(bytes.below(NAMES.len())),
        _ => Tree::Number(value(bytes)),
    };
    match bytes.below(4) {
        0 => Tree::One(bytes.pick(&["abs", "-"]), None, Box::new(leaf(bytes))),
        1 => Tree::Two(bytes.pick(&["+", "-", "*"]), None, Box::new(leaf(bytes)), Box::new(leaf(bytes))),
        _ => leaf(bytes),
    }
}

/// Returns a multiple of 1/4 in [-8, 8), so that ties are common and sums are exact.
fn value(bytes: &mut Bytes<'_>) -> f64 {
    f64::from(bytes.below(64) as u8) / 4.0 - 8.0
}

fn interval(bytes: &mut Bytes<'_>, samples: usize) -> Interval {
    let begin = bytes.below(samples + 2);
    match bytes.below(5) {
        0 => None,
        1 => Some((begin, usize::MAX)),
        _ => Some((begin, begin + bytes.below(samples + 2))),
    }
}

pub fn seeds() -> Vec<Vec<u8>> {
    // The bytes of 40 different inputs; most bytes are choices, so any sequence is a formula.
    (0..40_u64)
        .map(|seed| {
            let mut random = Random(seed);
            (0..40 + 2 * seed).map(|_| random.next() as u8).collect()
        })
        .collect()
}
