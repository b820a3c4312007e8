//! Values at the first time in dense time, the predicates that determine them, and cut windows.

use super::random_signals::{compile, evaluate, for_random_cases};
use mishandle_stl::{DenseSignal, Formula, Interpolation, Windows, is_violated};

fn is_near(a: f64, b: f64) -> bool {
    a == b || (a - b).abs() <= 1e-9
}

/// The value at the first time, which needs no function of time for the outer operators, is that of
/// the function.
#[test]
fn the_first_value_is_that_of_the_function_up_to_the_horizon() {
    for_random_cases(21, 6_000, |_, text, signals, _| {
        let monitor = compile(text, signals).unwrap();
        let (start, _) = evaluate(text, signals).unwrap().domain().unwrap();
        let whole = monitor.robustness_within(signals, start, start, Windows::Cut).unwrap().first().unwrap();
        let found = monitor.robustness(signals).unwrap();
        assert_eq!(found.to_bits(), whole.to_bits(), "{text} on {signals:?}: {found}, not {whole}");
    });
}

#[test]
fn a_part_of_the_function_is_that_of_the_whole() {
    for_random_cases(22, 3_000, |_, text, signals, random| {
        let monitor = compile(text, signals).unwrap();
        let whole = evaluate(text, signals).unwrap();
        let (start, end) = whole.domain().unwrap();
        let mut time = || start + (end - start) * random.below(9) as f64 / 8.0;
        let a = time();
        let b = time();
        let part = monitor.robustness_within(signals, a.min(b), a.max(b), Windows::Cut).unwrap();
        assert_eq!(part.domain(), Some((a.min(b), a.max(b))), "{text} on {signals:?}");
        for step in 0..=16 {
            let time = a + (b - a) * f64::from(step) / 16.0;
            let found = part.at(time).unwrap();
            let expected = whole.at(time).unwrap();
            assert!(is_near(found, expected), "{text} at {time}: {found} {expected} on {signals:?}");
        }
    });
}

/// The decisive predicate has the robustness of the formula, up to its sign, at a time at which it
/// has this value or limit.
#[test]
fn a_diagnosis_leads_to_a_predicate_with_the_robustness_of_the_formula() {
    let mut predicates = 0;
    for_random_cases(23, 6_000, |_, text, signals, _| {
        let monitor = compile(text, signals).unwrap();
        let cut = monitor.diagnose(signals).unwrap();
        assert_eq!(cut.robustness.to_bits(), monitor.robustness(signals).unwrap().to_bits(), "{text}");
        let first = monitor.decided_robustness_signal(signals).unwrap().first();
        let decided = monitor.diagnose_decided(signals).unwrap();
        assert_eq!(decided.is_some(), first.is_some(), "{text} on {signals:?}");
        if let (Some(decided), Some(first)) = (&decided, first) {
            let found = decided.robustness;
            assert!(is_near(found, first), "{text}: {found} {first} on {signals:?}");
        }
        for found in [Some(cut), decided].into_iter().flatten() {
            let Some(predicate) = found.predicate else { continue };
            let sign = if predicate.is_negated { -1.0 } else { 1.0 };
            let context = format!("{text} on {signals:?}: {predicate:?}");
            assert!(is_near(sign * predicate.robustness, found.robustness), "{context}");
            let values = evaluate(&predicate.text, signals).unwrap();
            let here = values.breakpoints().filter(|point| (point.time - predicate.time).abs() < 1e-9);
            let mut known: Vec<f64> = here.flat_map(|point| [point.before, point.at, point.after]).collect();
            known.extend(values.at(predicate.time));
            let is_known = known.iter().any(|value| is_near(*value, predicate.robustness));
            assert!(is_known, "{context}: {known:?}");
            predicates += 1;
        }
    });
    assert!(predicates > 1_000, "{predicates}");
}

/// The least value of each violation is that of the function in it.
#[test]
fn a_violation_has_its_least_value() {
    for_random_cases(24, 3_000, |_, text, signals, _| {
        let found = evaluate(text, signals).unwrap();
        let violations = found.violations();
        for violation in &violations {
            let points = found
                .breakpoints()
                .filter(|point| (violation.start - 1e-12..=violation.end + 1e-12).contains(&point.time));
            let values: Vec<f64> = points
                .flat_map(|point| [point.before, point.at, point.after])
                .chain(found.at(violation.start))
                .collect();
            let context = format!("{text} on {signals:?}: {violation:?}, {values:?}");
            // The limit at an end can belong to the next violation.
            assert!(values.iter().any(|value| is_near(*value, violation.worst)), "{context}");
            let least = values.into_iter().fold(f64::INFINITY, f64::min);
            assert!(violation.worst >= least - 1e-9 && is_violated(violation.worst), "{context}");
        }
        let least = violations.iter().map(|violation| violation.worst).fold(f64::INFINITY, f64::min);
        let (_, minimum) = found.minimum().unwrap();
        assert!(violations.is_empty() || least == minimum, "{text}: {least} {minimum}");
    });
}

/// A window is cut or not whatever the values are.
#[test]
fn cut_windows_are_those_of_the_structure() {
    let cuts = |text: &str, value: f64| {
        let times = vec![0.0, 1.0, 4.0];
        let x = DenseSignal::new("x", times, vec![value, 1.0, value], Interpolation::Linear).unwrap();
        let formula = Formula::parse(text).unwrap();
        let monitor = mishandle_stl::DenseMonitor::new(&formula, &["x".to_owned()], None).unwrap();
        monitor.cuts_windows(&[x]).unwrap()
    };
    for (text, expected) in [
        ("x >= 0", false),
        ("always(x >= 0)", false),
        ("always[0:4s](x >= 0)", false),
        ("always[0:5s](x >= 0)", true),
        ("always[0:1s](eventually[1s:3s](x >= 0))", false),
        ("always[0:1s](eventually[1s:4s](x >= 0))", true),
        ("eventually(always[0:1s](x >= 0))", true),
        ("always(once[0:1s](x >= 0))", false),
        ("always(x >= 0 or once[2s:3s](eventually[0:1s](x >= 0)))", false),
        ("x >= 0 until always(x >= 0)", false),
        ("x >= 0 until always[0:0.5s](x >= 0)", true),
        ("once(always[0:4s](x >= 0))", false),
        ("once(always[0:9s](x >= 0))", true),
    ] {
        for value in [1.0, 0.0, -1.0] {
            assert_eq!(cuts(text, value), expected, "{text} of {value}");
        }
    }
}
