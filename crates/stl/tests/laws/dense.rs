//! Dense time against the reference evaluator of discrete time, on grids that make both equal or
//! close.

use super::naive::{NAMES, Random, TIMED_ONE, TIMED_TWO, Tree};
use mishandle_stl::{
    Clock, DenseError, DenseMonitor, DenseRobustness, DenseSignal, Formula, Interpolation, Monitor, TimeUnit,
    Trace, is_satisfied,
};
use std::sync::Arc;

fn names() -> Arc<[String]> {
    NAMES.map(String::from).into()
}

fn monitor(text: &str) -> DenseMonitor {
    let formula = Formula::parse(text).unwrap_or_else(|error| panic!("{text}: {error}"));
    DenseMonitor::new(&formula, &names(), Some(TimeUnit::Seconds))
        .unwrap_or_else(|error| panic!("{text}: {error}"))
}

/// Returns a random formula that has a meaning in dense time.
fn random_tree(random: &mut Random, size: usize, n: usize) -> Tree {
    loop {
        let tree = Tree::random(random, size, n);
        if !tree.has_neighbors() {
            return tree;
        }
    }
}

/// Samples at some of the times 0, 1, …, n, the first and last of one signal among them.
fn random_samples(random: &mut Random, n: usize, is_complete: bool) -> (Vec<f64>, Vec<f64>) {
    let times: Vec<f64> = (0..=n)
        .filter(|time| *time == 0 || (is_complete && *time == n) || random.below(3) > 0)
        .map(|time| time as f64)
        .collect();
    let values = times.iter().map(|_| random.value()).collect();
    (times, values)
}

/// Signals that hold change at whole seconds only. So does every sub-formula with whole bounds, and
/// dense time equals discrete time on a trace with a sample for each whole second and one for each
/// time between two of them.
#[test]
fn held_signals_equal_the_discrete_definitions_at_instants_and_between_them() {
    let mut random = Random(44);
    for case in 0..8_000 {
        let n = random.below(if case % 20 == 0 { 30 } else { 9 });
        let size = random.below(6);
        let tree = random_tree(&mut random, size, n + 1);
        let text = tree.write(&mut random);
        let mut signals = Vec::new();
        let mut columns = Vec::new();
        for (index, name) in NAMES.iter().enumerate() {
            // The formula may read one signal only; the log ends with it.
            let (times, values) = random_samples(&mut random, n, true);
            let held =
                |element: usize| values[times.partition_point(|time| *time <= (element / 2) as f64) - 1];
            columns.push((0..=2 * n).map(held).collect::<Vec<f64>>());
            assert_eq!(index, signals.len());
            signals.push(DenseSignal::new(*name, times, values, Interpolation::Hold).unwrap());
        }
        let grid = tree.on_grid(2);
        let expected = grid.evaluate(&columns);
        let holds = grid.holds(&columns);
        let monitor = monitor(&text);
        let found = monitor.robustness_signal(&signals).unwrap();
        let context = format!("{text} on {signals:?}: {found:?}");
        assert_eq!(found.domain(), Some((0.0, n as f64)), "{context}");
        for (element, expected) in expected.iter().enumerate() {
            let time = element as f64 / 2.0;
            assert_eq!(found.at(time), Some(*expected), "at {time}: {context}");
            // The verdict is Boolean, also if the robustness is zero.
            assert_eq!(found.at(time).map(is_satisfied), Some(holds[element]), "at {time}: {context}");
            if element % 2 == 1 {
                assert_eq!(found.at(time + 0.25), Some(*expected), "at {time} + 0.25: {context}");
            }
        }
        assert_eq!(monitor.robustness(&signals), Ok(expected[0]), "{context}");
        if case % 4 == 0 && n < 6 {
            let decided = monitor.decided_robustness_signal(&signals).unwrap();
            for element in 0..=2 * n {
                let expected =
                    grid.is_decided(element, 2 * n + 1).then(|| grid.decide(&columns, element, 2 * n + 1));
                assert_eq!(
                    decided.at(element as f64 / 2.0),
                    expected,
                    "{element}, {decided:?} decided: {context}"
                );
            }
        }
    }
}

/// The largest slope of a sub-formula, and how far its values on a grid are from those in dense
/// time.
fn error_bound(tree: &Tree, slope: f64, step: f64) -> (f64, f64) {
    match tree {
        Tree::Number(_) => (0.0, 0.0),
        Tree::Signal(_) => (slope, 1e-9),
        Tree::One(name, _, x) => {
            let (slope_x, error) = error_bound(x, slope, step);
            // The limit at a jump is a step from a sample.
            let own = if TIMED_ONE.contains(name) { slope_x * step } else { 0.0 };
            (slope_x, error + own)
        }
        Tree::Two(name, _, x, y) => {
            let (slope_x, error_x) = error_bound(x, slope, step);
            let (slope_y, error_y) = error_bound(y, slope, step);
            match (*name, &**x, &**y) {
                ("*", Tree::Number(factor), _) => (factor.abs() * slope_y, factor.abs() * error_y),
                ("*", _, Tree::Number(factor)) => (factor.abs() * slope_x, factor.abs() * error_x),
                // Factors are signals, whose values are at most 1.25; one of them holds.
                ("*", ..) => (1.25 * (slope_x + slope_y), 1.25 * (error_x + error_y)),
                ("+" | "-" | "<=" | ">=" | "<" | ">" | "==" | "!==", ..) => {
                    (slope_x + slope_y, error_x + error_y)
                }
                _ => {
                    let larger = slope_x.max(slope_y);
                    let own = if TIMED_TWO.contains(name) { larger * step } else { 0.0 };
                    (larger, error_x.max(error_y) + own)
                }
            }
        }
    }
}

fn is_close(found: f64, expected: f64, bound: f64) -> bool {
    found == expected || (found - expected).abs() <= bound
}

const PER_SECOND: usize = 64;

/// Checks a formula on random signals of `n` seconds, one of which may hold. A linear signal
/// changes by at most slope · step between two samples of a grid, so every value in dense time is
/// close to that in discrete time on the grid. Returns how close; `None` if the formula is not
/// linear.
fn compare_on_grid(random: &mut Random, tree: &Tree, n: usize, holds: bool) -> Option<f64> {
    let text = tree.write(random);
    let step = 1.0 / PER_SECOND as f64;
    let mut slope: f64 = 0.0;
    let mut signals = Vec::new();
    let mut columns = Vec::new();
    for (index, name) in NAMES.iter().enumerate() {
        let (times, values) = random_samples(random, n, true);
        let values: Vec<f64> = values.iter().map(|value| value / 4.0).collect();
        let interpolation = if holds && index == 0 { Interpolation::Hold } else { Interpolation::Linear };
        let value = |sample: usize| {
            let time = sample as f64 * step;
            let next = times.partition_point(|known| *known <= time).min(times.len() - 1).max(1);
            let share = (time - times[next - 1]) / (times[next] - times[next - 1]);
            match interpolation {
                Interpolation::Hold => values[times.partition_point(|known| *known <= time) - 1],
                Interpolation::Linear => values[next - 1] + share * (values[next] - values[next - 1]),
            }
        };
        columns.push((0..=n * PER_SECOND).map(value).collect::<Vec<f64>>());
        if interpolation == Interpolation::Linear {
            let slopes = (1..times.len()).map(|i| (values[i] - values[i - 1]) / (times[i] - times[i - 1]));
            slope = slopes.fold(slope, |slope, next| slope.max(next.abs()));
        }
        signals.push(DenseSignal::new(*name, times, values, interpolation).unwrap());
    }
    let found = match monitor(&text).robustness_signal(&signals) {
        Ok(found) => found,
        // A product of two signals.
        Err(DenseError::NotLinear { .. }) => return None,
        Err(error) => panic!("{text}: {error}"),
    };
    let (_, bound) = error_bound(tree, slope, step);
    for (sample, expected) in tree.on_grid(PER_SECOND).evaluate(&columns).iter().enumerate() {
        let time = sample as f64 * step;
        let got = found.at(time).unwrap();
        assert!(
            is_close(got, *expected, bound),
            "{text} at {time}: {got}, not {expected} ± {bound} on {signals:?}: {found:?}"
        );
    }
    check_shape(&found, &text);
    Some(bound)
}

#[test]
fn linear_signals_are_close_to_the_discrete_definitions_on_a_fine_grid() {
    let mut random = Random(45);
    let mut bounds = Vec::new();
    for case in 0..2_500 {
        let n = 1 + random.below(5);
        let size = 1 + random.below(4);
        let tree = random_tree(&mut random, size, n + 1);
        bounds.extend(compare_on_grid(&mut random, &tree, n, case % 3 == 0));
    }
    let tight = bounds.iter().filter(|bound| (0.0..0.05).contains(*bound)).count();
    assert!(bounds.len() > 1_500 && tight > 500, "{} {tight}", bounds.len());
}

/// The sum of a signal that holds and a linear one has jumps between lines.
#[test]
fn functions_with_jumps_and_slopes_are_close_to_the_discrete_definitions_on_a_fine_grid() {
    let mut random = Random(47);
    for case in 0..3_000 {
        let n = 1 + random.below(5);
        let operand = |random: &mut Random, other: usize| {
            let signals = (Box::new(Tree::Signal(0)), Box::new(Tree::Signal(other)));
            Box::new(Tree::Two(random.pick(&["+", "-"]), None, signals.0, signals.1))
        };
        let window = |random: &mut Random| {
            let begin = random.below(n);
            random.pick(&[None, Some((0, 1)), Some((begin, begin + 1)), Some((begin, usize::MAX))])
        };
        let x = operand(&mut random, 1);
        let y = operand(&mut random, 2);
        let bounds = window(&mut random);
        let one = |random: &mut Random, x| Box::new(Tree::One(random.pick(&TIMED_ONE), window(random), x));
        let tree = match case % 3 {
            0 => Tree::Two(random.pick(&TIMED_TWO), bounds, x, y),
            1 => *one(&mut random, x),
            _ => Tree::Two(random.pick(&TIMED_TWO), bounds, one(&mut random, x), one(&mut random, y)),
        };
        compare_on_grid(&mut random, &tree, n, true);
    }
}

/// Breakpoints increase, no value is NaN, and no line leads to infinity.
fn check_shape(found: &DenseRobustness, text: &str) {
    let points: Vec<_> = found.breakpoints().collect();
    for point in &points {
        assert!(!point.before.is_nan() && !point.at.is_nan() && !point.after.is_nan(), "{text}: {points:?}");
    }
    for pair in points.windows(2) {
        assert!(pair[0].time < pair[1].time, "{text}: {points:?}");
        let a = pair[0].after;
        let b = pair[1].before;
        assert!(a == b || (a.is_finite() && b.is_finite()), "{text}: {points:?}");
    }
}

/// The relation to discrete time: with samples at whole multiples of a period that hold, and bounds
/// that are multiples of it, the decided values at the samples are equal, except of formulas with
/// `until`, `since`, `release` and `unless`.
#[test]
fn held_samples_of_a_period_have_the_values_of_discrete_time_at_the_samples() {
    let mut random = Random(46);
    let mut compared = 0;
    for _ in 0..6_000 {
        let n = 1 + random.below(20);
        let size = random.below(6);
        let tree = random_tree(&mut random, size, n);
        // Bounds in units of 100 ms.
        let text = tree.write(&mut random);
        if ["until", "since", "release", "unless", "U", "S", "R", "W"].iter().any(|word| text.contains(word))
        {
            continue;
        }
        let text = tree.scaled(100).write(&mut random);
        compared += 1;
        let times: Vec<f64> = (0..n).map(|i| i as f64 / 10.0).collect();
        let columns: Vec<Vec<f64>> = NAMES.iter().map(|_| random.column(n)).collect();
        let mut trace = Trace::new(names());
        for step in 0..n {
            trace.push(&columns.iter().map(|column| column[step]).collect::<Vec<_>>());
        }
        let signal = |(name, values): (&&str, &Vec<f64>)| {
            DenseSignal::new(*name, times.clone(), values.clone(), Interpolation::Hold).unwrap()
        };
        let signals: Vec<DenseSignal> = NAMES.iter().zip(&columns).map(signal).collect();
        let formula = Formula::parse(&text).unwrap();
        let clock = Clock::rtamt(0.1, TimeUnit::Milliseconds);
        let mut discrete = Monitor::new(&formula, &names(), clock).unwrap();
        let dense = DenseMonitor::new(&formula, &names(), Some(TimeUnit::Milliseconds)).unwrap();
        let decided = dense.decided_robustness_signal(&signals).unwrap();
        let expected = discrete.decided_robustness_signal(&trace).unwrap();
        for (step, time) in times.iter().enumerate() {
            let expected = expected.get(step).copied();
            assert_eq!(decided.at(*time), expected, "{text} at {time} on {columns:?}");
        }
    }
    assert!(compared > 1_000, "{compared}");
}
