//! Laws that hold for every formula and trace, checked on random ones.

use super::naive::{Interval, NAMES, Random, TIMED_ONE, TIMED_TWO, Tree};
use mishandle_stl::{
    Bounds, Clock, Formula, Monitor, MonitorError, OnlineMonitor, Trace, is_satisfied, is_violated,
};
use std::sync::Arc;

fn names() -> Arc<[String]> {
    NAMES.map(String::from).into()
}

fn trace_of(columns: &[Vec<f64>]) -> Trace {
    let mut trace = Trace::with_capacity(names(), columns[0].len());
    for step in 0..columns[0].len() {
        let sample: Vec<f64> = columns.iter().map(|column| column[step]).collect();
        trace.push(&sample);
    }
    trace
}

fn random_columns(random: &mut Random, n: usize) -> Vec<Vec<f64>> {
    NAMES.map(|_| random.column(n)).to_vec()
}

fn monitor(text: &str) -> Monitor {
    let formula = Formula::parse(text).unwrap_or_else(|error| panic!("{text}: {error}"));
    Monitor::new(&formula, &names(), Clock::steps(1.0 / 60.0)).unwrap()
}

/// Robustness at every sample of the trace with these columns.
fn robustness(text: &str, columns: &[Vec<f64>]) -> Vec<f64> {
    monitor(text).robustness_signal(&trace_of(columns)).unwrap().to_vec()
}

#[track_caller]
fn check_equal(one: &str, other: &str, columns: &[Vec<f64>]) {
    let a = robustness(one, columns);
    let b = robustness(other, columns);
    assert_eq!(a, b, "{one} against {other} on {columns:?}");
}

#[test]
fn robustness_follows_the_definitions() {
    let mut random = Random(1);
    for case in 0..20_000 {
        let n = 1 + random.below(if case % 10 == 0 { 90 } else { 14 });
        let size = random.below(6);
        let tree = Tree::random(&mut random, size, n);
        let text = tree.write(&mut random);
        let columns = random_columns(&mut random, n);
        assert_eq!(robustness(&text, &columns), tree.evaluate(&columns), "{text} on {columns:?}");
    }
}

/// The robustness is a distance and the verdict is Boolean. They never contradict: the verdict is
/// the sign, also of a zero.
#[test]
fn the_sign_of_the_robustness_is_the_boolean_verdict() {
    let mut random = Random(14);
    let mut zeros = [0, 0];
    for case in 0..20_000 {
        let n = 1 + random.below(if case % 10 == 0 { 90 } else { 14 });
        let size = random.below(6);
        let tree = Tree::random(&mut random, size, n);
        let text = tree.write(&mut random);
        // Few values, so that signals touch each other and the bounds.
        let columns =
            NAMES.map(|_| (0..n).map(|_| random.pick(&[-1.0, 0.0, 0.0, -0.0, 1.5])).collect()).to_vec();
        let found = robustness(&text, &columns);
        let holds = tree.holds(&columns);
        let satisfied: Vec<bool> = found.iter().copied().map(is_satisfied).collect();
        assert_eq!(satisfied, holds, "{text} on {columns:?}: {found:?}");
        for (robustness, holds) in found.iter().zip(holds) {
            assert_ne!(is_satisfied(*robustness), is_violated(*robustness));
            zeros[usize::from(holds)] += usize::from(*robustness == 0.0);
        }
    }
    // Both verdicts occur at the border, or the law is not tested.
    assert!(zeros.iter().all(|count| *count > 1_000), "{zeros:?}");
}

#[test]
fn windows_of_all_lengths_on_long_traces_follow_the_definitions() {
    let mut random = Random(2);
    let lengths = [1, 2, 3, 4, 5, 7, 8, 15, 16, 17, 31, 64, 127, 250, 500, 1023, 1024, 1025, 1500, 3000];
    for name in TIMED_ONE.into_iter().chain(TIMED_TWO) {
        for length in lengths {
            let n = random.pick(&[1, 64, 65, 250, 301, 1024, 1088, 1500, 2100]);
            let begin = random.pick(&[0, 0, 1, 7, 300]);
            let window = Some((begin, begin + length - 1));
            let tree = if TIMED_ONE.contains(&name) {
                Tree::One(name, window, Box::new(Tree::Signal(0)))
            } else {
                Tree::Two(name, window, Box::new(Tree::Signal(0)), Box::new(Tree::Signal(1)))
            };
            // Left operands that rarely fall and right operands that rarely rise, so that distant
            // samples matter.
            let mut columns = random_columns(&mut random, n);
            for (step, value) in columns[0].iter_mut().enumerate() {
                *value = 20.0 - (step as f64 / 40.0) + if step % 97 == 5 { *value } else { 0.0 };
            }
            for (step, value) in columns[1].iter_mut().enumerate() {
                *value = if step % 89 == 3 { *value } else { -30.0 } + step as f64 / 100.0;
            }
            let text = tree.write(&mut random);
            assert_eq!(robustness(&text, &columns), tree.evaluate(&columns), "{text} on {n} samples");
        }
    }
}

/// Returns a random interval as text, and the same one sample longer at its end.
fn intervals(random: &mut Random) -> (String, String) {
    let begin = random.below(5);
    let length = random.below(12);
    (format!("[{begin}:{}]", begin + length), format!("[{begin}:{}]", begin + length + 1))
}

#[test]
fn operators_have_their_duals() {
    let mut random = Random(3);
    for _ in 0..500 {
        let n = 1 + random.below(20);
        let columns = random_columns(&mut random, n);
        let p = Tree::random(&mut random, 2, n).write(&mut random);
        let q = Tree::random(&mut random, 2, n).write(&mut random);
        let (bounded, _) = intervals(&mut random);
        for w in [bounded.as_str(), ""] {
            check_equal(&format!("not always{w} ({p})"), &format!("eventually{w} not ({p})"), &columns);
            check_equal(&format!("not historically{w} ({p})"), &format!("once{w} not ({p})"), &columns);
            let until = format!("not ((not ({p})) until{w} (not ({q})))");
            check_equal(&format!("({p}) release{w} ({q})"), &until, &columns);
        }
        check_equal(&format!("fall({p})"), &format!("rise(not ({p}))"), &columns);
        check_equal(&format!("not next ({p})"), &format!("s_next not ({p})"), &columns);
        check_equal(&format!("not (({p}) and ({q}))"), &format!("not ({p}) or not ({q})"), &columns);
        check_equal(&format!("({p}) implies ({q})"), &format!("not ({p}) or ({q})"), &columns);
        check_equal(&format!("({p}) xor ({q})"), &format!("not (({p}) iff ({q}))"), &columns);
        check_equal(
            &format!("({p}) unless ({q})"),
            &format!("always ({p}) or (({p}) until ({q}))"),
            &columns,
        );
        check_equal(&format!("eventually{bounded} ({p})"), &format!("true until{bounded} ({p})"), &columns);
        check_equal(&format!("once{bounded} ({p})"), &format!("true since{bounded} ({p})"), &columns);
    }
}

#[test]
fn past_operators_are_future_operators_on_the_reversed_trace() {
    let mut random = Random(4);
    let reversed = |columns: &[Vec<f64>]| -> Vec<Vec<f64>> {
        columns.iter().map(|column| column.iter().rev().copied().collect()).collect()
    };
    for _ in 0..500 {
        let n = 1 + random.below(30);
        let columns = random_columns(&mut random, n);
        let (w, _) = intervals(&mut random);
        let pairs = [
            (format!("historically{w} a"), format!("always{w} a")),
            (format!("once{w} a"), format!("eventually{w} a")),
            (format!("a since{w} b"), format!("a until{w} b")),
            ("a since b".to_owned(), "a until b".to_owned()),
            ("prev a".to_owned(), "next a".to_owned()),
        ];
        for (past, future) in pairs {
            let mut expected = robustness(&future, &reversed(&columns));
            expected.reverse();
            assert_eq!(robustness(&past, &columns), expected, "{past} on {columns:?}");
        }
    }
}

#[test]
fn a_longer_window_never_raises_always_and_never_lowers_eventually_and_until() {
    let mut random = Random(5);
    for _ in 0..1000 {
        let n = 1 + random.below(30);
        let columns = random_columns(&mut random, n);
        let (shorter, longer) = intervals(&mut random);
        let grows = [("eventually", ""), ("once", ""), ("a until", " b"), ("a since", " b")];
        let shrinks = [("always", ""), ("historically", ""), ("a release", " b")];
        for (operator, operand) in grows.into_iter().chain(shrinks) {
            let operand = if operand.is_empty() { " a" } else { operand };
            let short = robustness(&format!("{operator}{shorter}{operand}"), &columns);
            let long = robustness(&format!("{operator}{longer}{operand}"), &columns);
            let is_ordered = |(short, long): (&f64, &f64)| {
                if grows.iter().any(|(name, _)| *name == operator) { short <= long } else { short >= long }
            };
            assert!(
                short.iter().zip(&long).all(is_ordered),
                "{operator}{shorter} and {longer} on {columns:?}"
            );
        }
    }
}

#[test]
fn robustness_is_monotonic_in_the_trace() {
    let mut random = Random(6);
    let formulas = [
        "always[1:4] a",
        "a until[2:5] b",
        "b since[0:3] a",
        "a release[1:3] b",
        "a unless[1:6] b",
        "once a",
    ];
    for _ in 0..500 {
        let n = 1 + random.below(20);
        let columns = random_columns(&mut random, n);
        let mut better = columns.clone();
        better.iter_mut().flatten().for_each(|value| *value += random.below(3) as f64);
        for formula in formulas {
            let low = robustness(formula, &columns);
            let high = robustness(formula, &better);
            assert!(
                low.iter().zip(&high).all(|(low, high)| low <= high),
                "{formula} on {columns:?}, {better:?}"
            );
        }
    }
}

#[test]
fn a_future_formula_does_not_depend_on_past_samples() {
    let mut random = Random(7);
    let is_past =
        |name: &str| ["historically", "once", "since", "prev", "s_prev", "rise", "fall"].contains(&name);
    fn any(tree: &Tree, test: &dyn Fn(&str) -> bool) -> bool {
        match tree {
            Tree::Number(_) | Tree::Signal(_) => false,
            Tree::One(name, _, x) => test(name) || any(x, test),
            Tree::Two(name, _, x, y) => test(name) || any(x, test) || any(y, test),
        }
    }
    let mut tried = 0;
    while tried < 500 {
        let n = 2 + random.below(20);
        let tree = Tree::random(&mut random, 3, n);
        if any(&tree, &is_past) {
            continue;
        }
        tried += 1;
        let text = tree.write(&mut random);
        let columns = random_columns(&mut random, n);
        let cut = 1 + random.below(n - 1);
        let later: Vec<Vec<f64>> = columns.iter().map(|column| column[cut..].to_vec()).collect();
        assert_eq!(robustness(&text, &columns)[cut..], robustness(&text, &later), "{text} on {columns:?}");
    }
}

// --- decided values ---

/// The decided values of the trace with these columns.
fn decided(text: &str, columns: &[Vec<f64>]) -> Vec<f64> {
    monitor(text).decided_robustness_signal(&trace_of(columns)).unwrap().to_vec()
}

/// The trace and a random continuation.
fn continued(random: &mut Random, columns: &[Vec<f64>], samples: usize) -> Vec<Vec<f64>> {
    columns.iter().map(|column| [column.clone(), random.column(samples)].concat()).collect()
}

#[test]
fn a_decided_value_follows_the_definitions_and_reads_no_sample_beyond_the_trace() {
    let mut random = Random(8);
    let mut unbounded = 0;
    let mut values = 0;
    for case in 0..5000 {
        let n = 1 + random.below(if case % 10 == 0 { 30 } else { 12 });
        let size = random.below(5);
        let tree = Tree::random(&mut random, size, 1 + n / 3);
        let text = tree.write(&mut random);
        let columns = random_columns(&mut random, n);
        let longer = continued(&mut random, &columns, 12);
        let expected: Vec<f64> =
            (0..n).take_while(|t| tree.is_decided(*t, n)).map(|t| tree.decide(&longer, t, n)).collect();
        assert_eq!(decided(&text, &columns), expected, "{text} on {columns:?}");
        assert_eq!(monitor(&text).decided_samples(n), expected.len(), "{text} on {n} samples");
        values += expected.len();
        unbounded += usize::from(!tree.is_bounded() && !expected.is_empty());
    }
    assert!(unbounded > 500 && values > 10_000, "{unbounded} {values}");
}

#[test]
fn no_continuation_of_the_trace_changes_a_decided_value_of_bounded_windows() {
    let mut random = Random(16);
    let mut formulas = 0;
    let mut values = 0;
    while formulas < 1500 {
        let n = 1 + random.below(20);
        let size = random.below(5);
        let tree = Tree::random(&mut random, size, 5);
        let text = tree.write(&mut random);
        let mut monitor = monitor(&text);
        let columns = random_columns(&mut random, n);
        let trace = trace_of(&columns);
        let signal = monitor.robustness_signal(&trace).unwrap().to_vec();
        assert_eq!(monitor.robustness(&trace), Ok(signal[0]), "{text}");
        let Some(horizon) = monitor.horizon() else { continue };
        formulas += 1;
        let decided = monitor.decided_robustness_signal(&trace).unwrap().to_vec();
        assert_eq!(decided, signal[..n.saturating_sub(horizon)], "{text} with horizon {horizon}");
        values += decided.len();
        for _ in 0..5 {
            let samples = 1 + random.below(horizon.min(20) + 2);
            let longer = trace_of(&continued(&mut random, &columns, samples));
            let cut = monitor.robustness_signal(&longer).unwrap()[..decided.len()].to_vec();
            assert_eq!(cut, decided, "{text} with horizon {horizon}");
            let whole = &monitor.decided_robustness_signal(&longer).unwrap()[..decided.len()];
            assert_eq!(whole, decided, "{text} with horizon {horizon}");
        }
    }
    assert!(values > 3000, "{values}");
}

/// Bounds of a trace that will have `samples` samples.
fn bounds(text: &str, columns: &[Vec<f64>], samples: usize) -> Bounds {
    let formulas = [Formula::parse(text).unwrap()];
    let mut monitor =
        OnlineMonitor::new(&formulas, &names(), Clock::steps(1.0 / 60.0), Some(samples)).unwrap();
    let trace = trace_of(columns);
    monitor.push_trace(&trace, 0..trace.len()).unwrap();
    monitor.bounds(0)
}

/// The value at time 0 is the first of the signal, bit for bit, and later samples may be anything.
#[test]
fn the_value_at_time_0_reads_the_samples_up_to_the_horizon() {
    let mut random = Random(32);
    let mut later = 0;
    for _ in 0..5000 {
        let n = 1 + random.below(20);
        let size = random.below(5);
        let text = Tree::random(&mut random, size, 5).write(&mut random);
        let mut columns = random_columns(&mut random, n);
        let mut monitor = monitor(&text);
        let trace = trace_of(&columns);
        let first = monitor.robustness_signal(&trace).unwrap()[0].to_bits();
        let decided = monitor.decided_robustness_signal(&trace).unwrap().first().map(|x| x.to_bits());
        let horizon = monitor.horizon().unwrap_or(n);
        for column in &mut columns {
            column.iter_mut().skip(horizon + 1).for_each(|value| *value = f64::NAN);
        }
        let trace = trace_of(&columns);
        assert_eq!(monitor.robustness(&trace).unwrap().to_bits(), first, "{text} on {columns:?}");
        let found = monitor.decided_robustness(&trace).unwrap().map(f64::to_bits);
        assert_eq!(found, decided, "{text} on {columns:?}");
        later += usize::from(horizon + 1 < n);
    }
    assert!(later > 1000, "{later}");
}

#[test]
fn every_continuation_of_a_trace_has_a_robustness_within_the_bounds() {
    let mut random = Random(31);
    let mut known_signs = 0;
    for _ in 0..20_000 {
        let samples = 2 + random.below(20);
        let size = 1 + random.below(5);
        let text = Tree::reading(&mut random, size, samples).write(&mut random);
        let start = 1 + random.below(samples - 1);
        let columns = random_columns(&mut random, start);
        if monitor(&text).decided_samples(samples) == 0 {
            assert_eq!(bounds(&text, &columns, samples), Bounds::UNKNOWN, "{text}");
            continue;
        }
        let Bounds { low, high } = bounds(&text, &columns, samples);
        assert!(low <= high, "{text}: {low} {high}");
        known_signs += usize::from(low > 0.0 || high < 0.0);
        for _ in 0..3 {
            let whole = continued(&mut random, &columns, samples - start);
            let value = decided(&text, &whole)[0];
            assert!(low <= value && value <= high, "{text} on {whole:?} after {start}: {low} {value} {high}");
            let known = Bounds { low: value, high: value };
            assert_eq!(bounds(&text, &whole, samples), known, "{text} on {whole:?}");
        }
    }
    assert!(known_signs > 1000, "only {known_signs} formulas were decided early");
}

#[test]
fn windows_inside_an_unbounded_operator_are_not_cut_at_the_end_of_the_trace() {
    let columns = |a: &[f64]| [a.to_vec(), vec![0.0; a.len()], vec![0.0; a.len()]];
    // One last sample is enough for a cut window, not for a whole one.
    let late = columns(&[0.0, 1.0, 0.0, 5.0]);
    assert_eq!(robustness("eventually(always[0:2](a >= 4))", &late)[0], 1.0);
    // min(0, 1, 0) - 4 and min(1, 0, 5) - 4.
    assert_eq!(decided("eventually(always[0:2](a >= 4))", &late), [-4.0, -4.0]);
    // The cut windows of the last samples lack the time in which the requirement can be met.
    let dip = columns(&[5.0, 5.0, 7.0, 0.0]);
    assert_eq!(robustness("always(eventually[0:2](a >= 4))", &dip)[0], -4.0);
    assert_eq!(decided("always(eventually[0:2](a >= 4))", &dip), [3.0, 3.0]);
    // A requirement on the last samples is decided only if they are followed by its window.
    assert_eq!(decided("always(a <= 2 implies eventually[1:2](a >= 4))", &dip), [3.0, 3.0]);
    assert_eq!(decided("(next(a > 0)) until (a >= 7)", &dip), [0.0, 0.0, 0.0]);
    // The trace has three samples: one less than a window of 0 to 3.
    let short = columns(&[5.0; 3]);
    assert!(decided("eventually(always[0:3](a >= 4))", &short).is_empty());
    assert_eq!(decided("eventually(always[0:2](a >= 4))", &short), [1.0]);
    assert!(decided("eventually[0:1](eventually(always[0:2](a >= 4)))", &short).is_empty());
    for (text, samples, cuts) in [
        ("always[0:2] a", 3, false),
        ("always[0:2] a", 2, true),
        ("always a", 1, false),
        ("eventually(always[0:2] a)", 300, true),
        ("eventually[0:100](always[0:2] a)", 300, false),
        ("(next a) until b", 300, false), // the left operand is not evaluated at the last sample
        ("(next next a) until b", 300, true),
        ("a release (next b)", 300, true),
        ("(next a) unless b", 300, true),
        ("once(next a)", 2, false),
    ] {
        assert_eq!(monitor(text).cuts_windows(samples), cuts, "{text}");
    }
}

#[test]
fn robustness_at_time_0_has_the_errors_of_the_samples_up_to_the_horizon() {
    let columns = [vec![1.0, 2.0, 1.0], vec![1.0, 0.0, 1.0], vec![4.0, -1.0, 1.0]];
    // On samples 0 and 1 alone, the last value of `next a` is infinite and the product NaN.
    let text = "(next a) * b >= 0";
    assert_eq!(monitor(text).robustness(&trace_of(&columns)), Ok(2.0));
    assert_eq!(robustness(text, &columns), [2.0, 0.0, f64::INFINITY]);
    let trace = trace_of(&columns);
    for (text, expected) in [("sqrt(c_1) >= 1", 1.0), ("a / b > 0", 1.0)] {
        assert_eq!(monitor(text).robustness(&trace), Ok(expected), "{text}");
        let always = format!("always[0:1]({text})");
        let signal = monitor(&always).robustness_signal(&trace).map(|signal| signal[0]);
        assert!(matches!(signal, Err(MonitorError::Undefined { step: 1, .. })), "{signal:?}");
        assert_eq!(monitor(&always).robustness(&trace), signal, "{text}");
    }
    // The signal has windows that are cut, and 0 times infinity.
    let text = "(always[1:2] a) * (b - 1) >= -9";
    assert!(monitor(text).robustness_signal(&trace).is_err());
    assert_eq!(monitor(text).robustness(&trace), Ok(9.0));
    assert_eq!(decided(text, &columns), [9.0]);
}

#[test]
fn the_horizon_is_the_last_sample_that_matters() {
    let cases = [
        ("a > 0", Some(0)),
        ("always[0:30](a > 0)", Some(30)),
        ("eventually[0:270](always[0:30](a > 0))", Some(300)),
        ("always a", None),
        ("always[3:inf] a", None),
        ("a until[0:5] b", Some(5)),
        ("(next a) until[0:0] b", Some(0)),
        ("(always[0:9] a) until[0:5] b", Some(13)), // the left operand is evaluated up to sample 4
        ("(always[0:9] a) unless[0:5] b", Some(14)),
        ("once[3:4](next next a)", Some(0)),
        ("once[1:4](always[0:5] a)", Some(4)),
        ("historically a since b", Some(0)),
        ("next s_next prev rise(a)", Some(2)), // the existence of sample 2 matters
        ("1 > 0", Some(0)),
    ];
    for (text, expected) in cases {
        assert_eq!(monitor(text).horizon(), expected, "{text}");
    }
}

#[test]
fn a_printed_formula_parses_to_itself() {
    let mut random = Random(9);
    for _ in 0..20_000 {
        let size = random.below(9);
        let text = Tree::random(&mut random, size, 10).write(&mut random);
        let formula = Formula::parse(&text).unwrap();
        let printed = formula.to_string();
        assert_eq!(Formula::parse(&printed).as_ref(), Ok(&formula), "{text} printed as {printed}");
        assert!(printed.matches('(').count() <= text.matches('(').count(), "{text} printed as {printed}");
    }
}

/// Random tokens: if a text parses, its printed form parses to the same formula.
#[test]
fn an_interval_from_seconds_to_infinity_is_printed_as_text_that_parses() {
    for text in ["always[3s:inf](a)", "a since[20ms:inf] b"] {
        let formula = Formula::parse(text).unwrap();
        assert_eq!(Formula::parse(&formula.to_string()), Ok(formula), "{text}");
    }
    assert_eq!(Formula::parse("G[3s,inf] a").unwrap().to_string(), "always[3s:inf] a");
}

#[test]
fn every_text_that_parses_survives_a_round_trip() {
    let mut random = Random(10);
    let tokens = [
        "a",
        "b",
        "1",
        "-",
        "-",
        "+",
        "*",
        "/",
        "(",
        ")",
        "not ",
        "always ",
        "G[1:2]",
        "until",
        " U[0:3s] ",
        ">",
        "==",
        " and ",
        " or ",
        "->",
        "<->",
        " xor ",
        "next ",
        "rise(",
        "abs(",
        "pow(",
        ",",
        " since ",
        " unless ",
        " R ",
        "true",
    ];
    let mut read = 0;
    for _ in 0..400_000 {
        let text: String = (0..1 + random.below(9)).map(|_| random.pick(&tokens)).collect();
        let Ok(formula) = Formula::parse(&text) else { continue };
        read += 1;
        let printed = formula.to_string();
        assert_eq!(Formula::parse(&printed).as_ref(), Ok(&formula), "{text} printed as {printed}");
    }
    assert!(read > 5000, "{read}");
}

#[test]
fn the_parser_never_panics() {
    let mut random = Random(13);
    let pieces = [
        "a", "é", "≤", "\u{301}", "0x", "0b", "1", "_", ".", "e", "+", "-", "/", "/*", "*/", "//", "\n", " ",
        "(", ")", "[", "]", ":", ",", ";", "=", "<", ">", "!", "&", "|", "@", "s", "inf", "const ", "float ",
        "input ", "G", "U", "pow(", "ln",
    ];
    for _ in 0..200_000 {
        let text: String = (0..1 + random.below(12)).map(|_| random.pick(&pieces)).collect();
        if let Err(error) = Formula::parse(&text) {
            let line = text.split('\n').nth(error.position().line - 1).unwrap();
            assert!((1..=line.chars().count() + 1).contains(&error.column()), "{text:?}: {error}");
        }
    }
}

#[test]
fn no_value_is_nan() {
    let mut random = Random(11);
    for _ in 0..3000 {
        let n = 1 + random.below(8);
        let text = Tree::random(&mut random, 6, n).write(&mut random);
        let values = robustness(&text, &random_columns(&mut random, n));
        assert!(values.iter().all(|value| !value.is_nan()), "{text}: {values:?}");
    }
}

#[test]
fn huge_and_empty_windows_have_the_documented_values() {
    let columns = [vec![1.0, -2.0, 3.0], vec![0.0, 5.0, -1.0], vec![0.0; 3]];
    let check = |text: &str, expected: [f64; 3]| assert_eq!(robustness(text, &columns), expected, "{text}");
    const INF: f64 = f64::INFINITY;
    check("always[0:1000000000000] a", [-2.0, -2.0, 3.0]);
    check("always[0:8e12] a", [-2.0, -2.0, 3.0]);
    check("once[0:4398046511104] a", [1.0, 1.0, 3.0]);
    check("a until[0:8e12] b", [1.0, 5.0, -1.0]);
    check("a since[0:8e12] b", [0.0, 5.0, 3.0]);
    check("always[5:9] a", [INF; 3]);
    check("eventually[5:9] a", [-INF; 3]);
    check("a until[5:9] b", [-INF; 3]);
    check("a release[5:9] b", [INF; 3]);
    check("a since[5:9] b", [-INF; 3]);
    check("(always[5:9] a) iff (always[5:9] b)", [INF; 3]);
    check("(always[5:9] a) xor (eventually[5:9] b)", [INF; 3]);
    check("true and 1 > 0", [1.0; 3]);
    check("always 1 > 0", [1.0; 3]);
}

#[test]
fn a_monitor_accepts_traces_of_any_length_in_any_order() {
    let mut random = Random(12);
    let window: Interval = Some((1, 70));
    let tree = Tree::Two("until", window, Box::new(Tree::Signal(0)), Box::new(Tree::Signal(1)));
    let mut monitor = monitor(&tree.write(&mut random));
    for n in [1, 200, 3, 71, 72, 500, 1] {
        let columns = random_columns(&mut random, n);
        assert_eq!(
            monitor.robustness_signal(&trace_of(&columns)).unwrap(),
            tree.evaluate(&columns),
            "{n} samples"
        );
    }
}

// --- sub-formulas ---

/// Returns the samples of a trace of `n` samples at which a formula with these offsets reads no
/// sample outside the trace.
fn covered(low: i64, high: i64, n: usize) -> std::ops::Range<usize> {
    let end = n.saturating_sub(high as usize);
    (-low as usize).min(end)..end
}

#[test]
fn sub_formulas_have_the_values_of_the_definitions() {
    let mut random = Random(14);
    for case in 0..3000 {
        let n = 1 + random.below(if case % 10 == 0 { 40 } else { 14 });
        let size = random.below(5);
        let tree = Tree::random(&mut random, size, n.min(5));
        let text = tree.write(&mut random);
        let columns = random_columns(&mut random, n);
        let parts = tree.subformulas();
        let texts: Vec<String> = Formula::parse(&text).unwrap().subformulas().collect();
        assert_eq!(texts[0], Formula::parse(&text).unwrap().to_string());
        assert_eq!(texts.len(), parts.len(), "{text}: {texts:?}");
        for (part, text) in parts.iter().zip(&texts) {
            let values = decided(text, &columns);
            let expected: Vec<f64> = (0..values.len()).map(|t| part.decide(&columns, t, n)).collect();
            assert_eq!(values, expected, "{text} on {columns:?}");
        }
    }
}

/// At a covered sample, the value of a formula with bounded windows is the same in every longer
/// trace.
#[test]
fn the_value_at_a_covered_sample_does_not_depend_on_the_ends_of_the_trace() {
    let mut random = Random(15);
    let mut formulas = 0;
    let mut samples = 0;
    while formulas < 3000 {
        let n = 1 + random.below(40);
        let size = 1 + random.below(3);
        let tree = Tree::random(&mut random, size, 5);
        if !tree.is_bounded() {
            continue;
        }
        formulas += 1;
        let text = tree.write(&mut random);
        let columns = random_columns(&mut random, n);
        let before = random.below(12);
        let longer: Vec<Vec<f64>> = columns
            .iter()
            .map(|column| [random.column(before), column.clone(), random.column(12)].concat())
            .collect();
        let short = robustness(&text, &columns);
        let long = robustness(&text, &longer);
        let (low, high) = tree.offsets();
        for step in covered(low, high, n) {
            samples += 1;
            assert_eq!(short[step], long[step + before], "{text} at {step} of {columns:?} in {longer:?}");
        }
    }
    assert!(samples > 10_000, "{samples}");
}

#[test]
fn a_diagnosis_leads_to_a_value_with_the_robustness_of_the_formula() {
    let mut random = Random(77);
    let mut ended_at_predicate = 0;
    let mut cases = 0;
    for _ in 0..20_000 {
        let n = 1 + random.below(14);
        let size = 1 + random.below(6);
        let tree = Tree::random(&mut random, size, n);
        let formula = Formula::parse(&tree.write(&mut random)).unwrap();
        let columns = random_columns(&mut random, n);
        let diagnosis = formula.diagnose(&trace_of(&columns), &Clock::steps(1.0 / 60.0)).unwrap();
        assert_eq!(diagnosis.robustness(), tree.evaluate(&columns)[0], "{formula}");
        let texts: Vec<String> = formula.subformulas().collect();
        for found in &diagnosis.path {
            assert_eq!(found.robustness.abs(), diagnosis.robustness().abs(), "{formula}: {found:?}");
            assert_eq!(found.text, texts[found.position], "{formula}");
            let evaluated = robustness(&found.text, &columns)[found.sample];
            assert_eq!(evaluated, found.robustness, "{formula}: {found:?}");
        }
        for position in formula.conjuncts() {
            let alone = robustness(&formula.conjunct(position).unwrap().to_string(), &columns)[0];
            assert!(alone >= diagnosis.robustness(), "{formula}: {} alone has {alone}", texts[position]);
        }
        if let Some(predicate) = &diagnosis.predicate {
            let sign = if predicate.is_negated { -1.0 } else { 1.0 };
            assert_eq!(sign * predicate.robustness, diagnosis.robustness(), "{formula}: {predicate:?}");
            let side = |i: usize| robustness(&predicate.sides[i], &columns)[predicate.sample];
            assert_eq!(predicate.values, [side(0), side(1)], "{formula}: {predicate:?}");
            ended_at_predicate += 1;
        }
        cases += 1;
    }
    assert!(ended_at_predicate > cases / 10, "{ended_at_predicate} of {cases} end at a predicate");
}

#[test]
fn a_formula_is_the_minimum_of_its_conjuncts_under_always() {
    let mut random = Random(78);
    let formula = Formula::parse("always[0:5](a <= 1 and (b < 2 and c_1 >= 0)) and a >= -4").unwrap();
    let texts: Vec<String> = formula.subformulas().collect();
    let conjuncts = formula.conjuncts();
    let listed: Vec<&str> = conjuncts.iter().map(|position| texts[*position].as_str()).collect();
    assert_eq!(listed, ["a <= 1", "b < 2", "c_1 >= 0", "a >= -4"]);
    for _ in 0..200 {
        let columns = random_columns(&mut random, 9);
        let least: Vec<f64> = conjuncts
            .iter()
            .map(|position| robustness(&formula.conjunct(*position).unwrap().to_string(), &columns)[0])
            .collect();
        let whole = robustness(&formula.to_string(), &columns)[0];
        assert_eq!(least.into_iter().fold(f64::INFINITY, f64::min), whole);
    }
    // An `and` that is negated is an `or`: its operands do not fail on their own.
    let negated = Formula::parse("not (a <= 1 and b < 2)").unwrap();
    assert_eq!(negated.conjunct(2).unwrap(), negated);
    assert_eq!(negated.conjuncts(), [0]);
    assert_eq!(Formula::parse("always(a <= 1 until b < 2)").unwrap().conjuncts(), [1]);
    assert_eq!(negated.conjunct(99), None);
}
