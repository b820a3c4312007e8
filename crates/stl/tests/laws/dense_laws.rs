//! Laws of robustness in dense time, and inputs at the limits.

use super::naive::{NAMES, Random};
use super::random_signals::{compile, evaluate, for_random_cases};
use crate::processor_time::processor_secs;
use mishandle_stl::{
    DenseError, DenseMonitor, DenseRobustness, DenseSignal, Formula, Interpolation, Violation, is_satisfied,
    is_violated,
};

fn signal(times: &[f64], values: &[f64], interpolation: Interpolation) -> DenseSignal {
    DenseSignal::new("x", times.to_vec(), values.to_vec(), interpolation).unwrap()
}

fn linear(times: &[f64], values: &[f64]) -> DenseSignal {
    signal(times, values, Interpolation::Linear)
}

fn hold(times: &[f64], values: &[f64]) -> DenseSignal {
    signal(times, values, Interpolation::Hold)
}

/// Applies functions to the times and values of signals.
fn mapped(
    signals: &[DenseSignal],
    samples: impl Fn(&DenseSignal) -> (Vec<f64>, Vec<f64>),
) -> Vec<DenseSignal> {
    let map = |signal: &DenseSignal| {
        let (times, values) = samples(signal);
        DenseSignal::new(signal.name(), times, values, signal.interpolation()).unwrap()
    };
    signals.iter().map(map).collect()
}

fn with_times(signals: &[DenseSignal], time: impl Fn(f64) -> f64) -> Vec<DenseSignal> {
    mapped(signals, |signal| (signal.times().iter().copied().map(&time).collect(), signal.values().to_vec()))
}

fn is_near(a: f64, b: f64) -> bool {
    a == b || (a - b).abs() <= 1e-9
}

/// Checks that two functions are equal up to rounding, at 97 times.
#[track_caller]
fn check_equal(one: &DenseRobustness, other: &DenseRobustness, context: &str) {
    assert_eq!(one.domain(), other.domain(), "{context}");
    let Some((start, end)) = one.domain() else { return };
    for step in 0..=96 {
        let time = start + (end - start) * f64::from(step) / 96.0;
        let a = one.at(time).unwrap();
        let b = other.at(time).unwrap();
        assert!(is_near(a, b), "{a} and {b} at {time}: {context}: {one:?} {other:?}");
    }
}

#[test]
fn a_shift_of_all_times_shifts_the_result() {
    for_random_cases(1, 3_000, |_, text, signals, random| {
        let shift = random.pick(&[-1000.0, 0.5, 1.7e9]);
        let found = evaluate(text, signals).unwrap();
        let shifted = evaluate(text, &with_times(signals, |time| time + shift)).unwrap();
        let times = |found: &DenseRobustness, shift: f64| -> Vec<f64> {
            found.breakpoints().map(|point| point.time + shift).collect()
        };
        // Crossings are not multiples of 1/8 s. Nearby ones can become one.
        if times(&found, 0.0).iter().all(|time| (time * 8.0).fract() == 0.0) {
            assert_eq!(times(&found, shift), times(&shifted, 0.0), "{text} on {signals:?}");
        }
        let (start, end) = found.domain().unwrap();
        assert_eq!(shifted.domain(), Some((start + shift, end + shift)), "{text}");
        for time in (0..=((end - start) * 8.0) as usize).map(|time| time as f64 / 8.0) {
            let a = found.at(time).unwrap();
            let b = shifted.at(time + shift).unwrap();
            assert!(is_near(a, b), "{text} at {time}: {a} {b} on {signals:?}");
        }
    });
}

#[test]
fn a_scale_of_times_and_bounds_scales_the_result() {
    for_random_cases(2, 3_000, |tree, text, signals, random| {
        let found = evaluate(text, signals).unwrap();
        let factor = random.pick(&[2, 10, 1000]);
        let text = tree.scaled(factor).write(random);
        let other = evaluate(&text, &with_times(signals, |time| time * factor as f64)).unwrap();
        let back = |time: f64| found.at(time / factor as f64).unwrap();
        let (_, end) = other.domain().unwrap();
        for step in 0..=64 {
            let time = end * f64::from(step) / 64.0;
            assert!(is_near(back(time), other.at(time).unwrap()), "{text} at {time} on {signals:?}");
        }
    });
}

#[test]
fn a_sample_that_adds_no_information_changes_nothing() {
    for_random_cases(3, 3_000, |_, text, signals, random| {
        let place = random.below(1000);
        let more = mapped(signals, |signal| {
            let mut times = signal.times().to_vec();
            let mut values = signal.values().to_vec();
            let at = 1 + place % (times.len() - 1);
            let value = match signal.interpolation() {
                Interpolation::Hold => values[at - 1],
                Interpolation::Linear => 0.5 * (values[at - 1] + values[at]),
            };
            times.insert(at, 0.5 * (times[at - 1] + times[at]));
            values.insert(at, value);
            (times, values)
        });
        let context = format!("{text} on {signals:?}");
        let one = evaluate(text, signals).unwrap();
        let other = evaluate(text, &more).unwrap();
        check_equal(&one, &other, &context);
        if signals.iter().all(|signal| signal.interpolation() == Interpolation::Hold) {
            assert_eq!(one, other, "{context}");
        }
    });
}

#[test]
fn operators_are_the_negations_of_their_duals() {
    for_random_cases(4, 1_500, |_, text, signals, random| {
        let begin = random.below(4);
        let end = random.below(4);
        let window = format!("[{begin}:{}]", begin + end);
        for (one, other) in [("always", "eventually"), ("historically", "once")] {
            let found = evaluate(&format!("{one}{window}({text})"), signals).unwrap();
            let dual = evaluate(&format!("not {other}{window}(not ({text}))"), signals).unwrap();
            assert_eq!(found, dual, "{one}{window}({text}) on {signals:?}");
        }
        let found = evaluate(&format!("({text}) release{window} (a >= b)"), signals).unwrap();
        let dual = evaluate(&format!("not ((not ({text})) until{window} not (a >= b))"), signals).unwrap();
        assert_eq!(found, dual, "{text} on {signals:?}");
        let found = evaluate(&format!("eventually{window}({text})"), signals).unwrap();
        let until = evaluate(&format!("true until{window} ({text})"), signals).unwrap();
        check_equal(&found, &until, text);
    });
}

#[test]
fn no_continuation_changes_a_decided_value() {
    for_random_cases(5, 3_000, |tree, text, signals, random| {
        if !tree.is_bounded() {
            return;
        }
        let end = signals[0].end();
        let steps = 1 + random.below(20);
        let extra: Vec<Vec<f64>> = signals.iter().map(|_| random.column(steps)).collect();
        let index = |signal: &DenseSignal| NAMES.iter().position(|name| *name == signal.name()).unwrap();
        let longer = mapped(signals, |signal| {
            let times = signal.times().iter().copied().chain((1..=steps).map(|step| end + step as f64 / 4.0));
            (times.collect(), [signal.values(), &extra[index(signal)]].concat())
        });
        let monitor = compile(text, signals).unwrap();
        let decided = monitor.decided_robustness_signal(signals).unwrap();
        let Some((first, last)) = decided.domain() else { return };
        let cut = monitor.robustness_signal(signals).unwrap();
        let continued = monitor.robustness_signal(&longer).unwrap();
        for step in 0..=32 {
            let time = first + (last - first) * f64::from(step) / 32.0;
            let value = decided.at(time).unwrap();
            assert!(is_near(value, cut.at(time).unwrap()), "{text} at {time} on {signals:?}");
            assert!(
                is_near(value, continued.at(time).unwrap()),
                "{text} at {time} on {signals:?}, continued"
            );
        }
    });
}

#[test]
fn the_first_value_is_that_of_the_whole_signal() {
    for_random_cases(6, 3_000, |_, text, signals, _| {
        let monitor = compile(text, signals).unwrap();
        let first = monitor.robustness(signals).unwrap();
        let all = monitor.robustness_signal(signals).unwrap();
        assert!(is_near(first, all.first().unwrap()), "{text} on {signals:?}: {first} {all:?}");
    });
}

/// A time is inside a violation if and only if the value there is violated, except at the ends of
/// violations.
#[test]
fn violations_are_the_times_of_violated_values() {
    for_random_cases(7, 3_000, |_, text, signals, _| {
        let found = evaluate(text, signals).unwrap();
        let violations = found.violations();
        let context = format!("{text} on {signals:?}: {violations:?} in {found:?}");
        assert!(violations.windows(2).all(|pair| pair[0].end <= pair[1].start), "{context}");
        let (start, end) = found.domain().unwrap();
        for step in 0..=200 {
            let time = start + (end - start) * f64::from(step) / 200.0;
            let is_end = |v: &Violation| (v.start - time).abs() < 1e-9 || (v.end - time).abs() < 1e-9;
            if !violations.iter().any(is_end) {
                let is_inside = violations.iter().any(|v| v.start < time && time < v.end);
                assert_eq!(is_violated(found.at(time).unwrap()), is_inside, "at {time}: {context}");
            }
        }
    });
}

fn times_of(found: &DenseRobustness) -> Vec<(f64, f64)> {
    found.violations().iter().map(|violation| (violation.start, violation.end)).collect()
}

#[test]
fn violations_start_and_end_at_crossings_and_samples() {
    let found = evaluate("x <= 1", &[linear(&[0.0, 3.0, 4.0], &[0.0, 3.0, 0.0])]).unwrap();
    assert_eq!(times_of(&found), [(1.0, 3.0 + 2.0 / 3.0)]);
    // A peak of exactly 1 violates the strict comparison at one instant.
    let peak = [linear(&[0.0, 1.0, 2.0], &[0.0, 1.0, 0.0])];
    assert_eq!(times_of(&evaluate("x < 1", &peak).unwrap()), [(1.0, 1.0)]);
    assert_eq!(times_of(&evaluate("x <= 1", &peak).unwrap()), []);
    let held = [hold(&[0.0, 0.5, 0.7, 2.0], &[0.0, 2.0, 3.0, 0.0])];
    assert_eq!(times_of(&evaluate("x <= 1", &held).unwrap()), [(0.5, 2.0)]);
    assert_eq!(times_of(&evaluate("always[0:0.2s](x <= 1)", &held).unwrap()), [(0.3, 2.0)]);
    assert_eq!(times_of(&evaluate("x >= 0", &held).unwrap()), []);
}

#[test]
fn the_sign_of_a_zero_is_the_verdict() {
    let peak = [linear(&[0.0, 1.0, 2.0], &[0.0, 1.0, 0.0])];
    let rise = [linear(&[0.0, 2.0], &[0.0, 3.0])];
    let flat = [hold(&[0.0, 1.0], &[0.0, 0.0])];
    for (text, signals, holds) in [
        ("always(x <= 1)", &peak, true),
        ("always(x < 1)", &peak, false),
        ("eventually(x >= 1)", &peak, true),
        ("eventually(x > 1)", &peak, false),
        // The line passes through 1 between its samples.
        ("eventually(x == 1)", &rise, true),
        ("always(x != 1)", &rise, false),
        ("always(x == 0)", &flat, true),
        ("eventually(x < 0)", &flat, false),
        ("(x >= 0) until[1:1] (x == 0)", &flat, true),
        ("(x > 0) until (x == 0)", &flat, false),
    ] {
        let value = evaluate(text, signals).unwrap().first().unwrap();
        assert_eq!((value, is_satisfied(value)), (0.0, holds), "{text}");
    }
}

/// Times of signals with decimals meet the ends of windows, although they have no exact `f64`.
#[test]
fn ends_of_windows_meet_samples_at_decimal_times() {
    let x = [hold(&[0.0, 1.0, 1.1, 1.5], &[0.0, 7.0, 0.0, 0.0])];
    for (text, time, expected) in [
        // The pulse of 7 is [1, 1.1).
        ("eventually[0.1:0.7](x)", 0.3, 7.0),
        ("eventually[0.1:0.7](x)", 0.2999, 0.0),
        ("always[0.1:0.15](x)", 0.9, 7.0),
        ("always[0.1:0.15](x)", 0.8999, 0.0),
        ("once[0.2:0.3](x)", 1.2, 7.0),
        ("once[0.2:0.3](x)", 1.1999, 0.0),
        ("once[0.2:0.3](x)", 1.3999, 7.0),
        ("once[0.2:0.3](x)", 1.4, 0.0),
    ] {
        assert_eq!(evaluate(text, &x).unwrap().at(time), Some(expected), "{text} at {time}");
    }
}

#[test]
fn signals_of_different_spans() {
    let of = |name: &str, times: &[f64], values: &[f64], interpolation| {
        DenseSignal::new(name, times.to_vec(), values.to_vec(), interpolation).unwrap()
    };
    let fast = |interpolation| of("a", &[0.0, 0.9, 1.0], &[1.0, 1.0, -2.0], interpolation);
    let slow = |interpolation| of("b", &[0.5, 0.75], &[3.0, 4.0], interpolation);
    let held = Interpolation::Hold;
    let line = Interpolation::Linear;
    let domain = |text: &str, signals: &[DenseSignal]| evaluate(text, signals).unwrap().domain();
    // A held value holds until the end of the log, so that the last sample of `a` counts.
    let signals = [fast(held), slow(held)];
    assert_eq!(domain("a <= b", &signals), Some((0.5, 1.0)));
    assert_eq!(evaluate("always(a + b >= 3)", &signals).unwrap().first(), Some(-1.0));
    // A line ends at its last sample.
    assert_eq!(domain("a <= b", &[fast(line), slow(line)]), Some((0.5, 0.75)));
    assert_eq!(domain("a <= b", &[fast(held), slow(line)]), Some((0.5, 0.75)));
    // The windows of an operand reach its own end.
    let found = evaluate("always(a >= 0) and b >= 0", &[fast(line), slow(line)]).unwrap();
    assert_eq!((found.domain(), found.first()), (Some((0.5, 0.75)), Some(-2.0)));
    assert_eq!(domain("a >= 0", &signals), Some((0.0, 1.0)));
    assert_eq!(domain("true", &signals), Some((0.0, 1.0)));
    let late = of("b", &[2.0, 3.0], &[0.0, 0.0], line);
    let error = evaluate("a <= b", &[fast(line), late]).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the signals have no time in common: `b` starts at 2 s, after `a` ends at 1 s"
    );
}

#[test]
fn signals_that_are_no_functions_of_time_are_errors() {
    let new = |times: &[f64], values: &[f64]| {
        DenseSignal::new("f/x", times.to_vec(), values.to_vec(), Interpolation::Hold).unwrap_err().to_string()
    };
    assert_eq!(new(&[], &[]), "signal `f/x` has no samples; it must have at least one");
    assert!(new(&[0.0], &[]).contains("1 times and 0 values"));
    assert!(new(&[0.0, 1.0, 1.0], &[0.0; 3]).contains("time 2 of signal `f/x` is 1 s, after 1 s"));
    assert!(new(&[0.0, -1.0], &[0.0; 2]).contains("times must increase"));
    assert!(new(&[0.0, 1e-30], &[0.0; 2]).contains("by at least 1e-24 s"));
    assert!(new(&[f64::NAN], &[0.0]).contains("time 0 of signal `f/x` is NaN s"));
    assert!(new(&[f64::INFINITY], &[0.0]).contains("inf"));
    assert!(new(&[1e14], &[0.0]).contains("at most 1e13 s"));
    assert!(new(&[0.0, 2.5], &[0.0, f64::NAN]).contains("is NaN at 2.5 s"));
}

#[test]
fn formulas_without_a_meaning_in_dense_time_are_errors() {
    let line = [linear(&[0.0, 1.0], &[0.0, 2.0])];
    let held = [hold(&[0.0, 1.0], &[0.0, 2.0])];
    let error = |text: &str, signals: &[DenseSignal]| evaluate(text, signals).unwrap_err().to_string();
    for operator in ["next", "prev", "s_next", "s_prev", "rise", "fall"] {
        assert!(
            error(&format!("{operator}(x >= 0)"), &held).starts_with(&format!("`{operator}` has no meaning"))
        );
    }
    for term in ["x * x", "1 / x", "x / x", "sqrt(x)", "exp(x)", "ln(x)", "pow(x, 2)", "pow(2, x)"] {
        let message = error(&format!("always({term} >= 0)"), &line);
        assert!(message.starts_with(&format!("`{term}` is not piecewise linear")), "{message}");
    }
    for term in ["2 * x", "x * 2", "x / 2", "sqrt(2) * x", "(1 + 2) * x"] {
        assert!(evaluate(&format!("{term} >= 0"), &line).is_ok(), "{term}");
    }
    assert_eq!(error("1 / x >= 0", &held), "`1 / 0` has no finite value at 0 s");
    assert_eq!(error("1e308 * x >= 0", &line), "`1e308 * 2` has no finite value at 1 s");
    assert!(error("y >= 0", &line).contains("signal `y` is not in the trace"));
    assert!(error("x = 2 > 1; x", &line).contains("already a signal"));
    let formula = Formula::parse("always[0:2](x >= 0)").unwrap();
    let names = ["x".to_owned()];
    let message = DenseMonitor::new(&formula, &names, None).unwrap_err().to_string();
    assert!(
        message.starts_with("bound 2 of `always` has no unit") && message.contains("such as `2 s`"),
        "{message}"
    );
    for text in ["always[0:inf](x >= 0)", "always[0:0](x >= 0)", "always[0:2s](x >= 0)", "always(x >= 0)"] {
        assert!(DenseMonitor::new(&Formula::parse(text).unwrap(), &names, None).is_ok(), "{text}");
    }
    let none = DenseMonitor::new(&Formula::parse("true").unwrap(), &[], None).unwrap();
    assert_eq!(none.robustness(&[]), Err(DenseError::NoSignals));
}

#[test]
fn extreme_inputs_have_values() {
    for interpolation in [Interpolation::Hold, Interpolation::Linear] {
        let one = [signal(&[5.0], &[-3.0], interpolation)];
        for (text, expected) in [
            ("x", -3.0),
            ("always[0:1](x)", -3.0),
            ("eventually[1:2](x)", f64::NEG_INFINITY),
            ("x until x", -3.0),
            ("x since[0:1] x", -3.0),
            ("x unless[0:5] x", -3.0),
            ("once[0:1e300](x)", -3.0),
            ("always[1e300:inf](x)", f64::INFINITY),
        ] {
            let found = evaluate(text, &one).unwrap();
            assert_eq!((found.domain(), found.first()), (Some((5.0, 5.0)), Some(expected)), "{text}");
        }
        // Values whose difference overflows, and times a few ulps or 1e-23 s apart.
        let large = [signal(&[0.0, 1.0, 1.0 + 4.0 * f64::EPSILON], &[1e308, -1e308, 1.7e308], interpolation)];
        for text in ["x >= 0", "x >= 1e308", "x <= -1e308 or x >= 1.5e308", "abs(x) >= 1", "x == -1.7e308"] {
            for text in
                [text.to_owned(), format!("always[0:1e-9]({text})"), format!("({text}) until[0:1] (x > 3)")]
            {
                let found = evaluate(&text, &large).unwrap();
                assert!(found.breakpoints().all(|point| !point.at.is_nan()), "{text}: {found:?}");
                assert_eq!(found.violations(), found.violations());
            }
        }
        let close = [signal(&[0.0, 1e-23, 2e-23], &[0.0, 1.0, 0.0], interpolation)];
        let found = evaluate("eventually[0:1e-23s](x >= 0.5)", &close).unwrap();
        assert_eq!((found.first(), found.domain()), (Some(0.5), Some((0.0, 2e-23))));
    }
    // Windows that no log has, nested: nothing is decided, and nothing overflows.
    let x = [linear(&[0.0, 1.0], &[-1.0, 1.0])];
    let text = "always[0:1e300](historically[1e300:1e301](x) since[1e300:inf] eventually[1e300:1e300](x))";
    let monitor = compile(text, &x).unwrap();
    assert!(monitor.decided_robustness_signal(&x).unwrap().is_empty());
    assert_eq!(monitor.robustness(&x), Ok(f64::NEG_INFINITY));
    assert_eq!(compile("once[5:inf](always(x))", &x).unwrap().horizon(), None);
    assert_eq!(compile("once[0.5:1](always[0:2](x))", &x).unwrap().horizon(), Some(1.5));
}

/// Ten times as many breakpoints take about ten times as long, for short and long windows, and
/// without any.
#[test]
fn the_cost_is_linear_in_the_number_of_breakpoints() {
    let texts = [
        "always[0:20](x >= -0.9)",
        "eventually[5:5000](x >= 0.5)",
        "(x >= -0.5) until[1:3000] (x >= 0.5)",
        "(x >= -0.5) since (abs(x) <= 0.1)",
        "always[0:50](eventually[0:50](x >= 0.3) or x <= -0.3)",
    ];
    for interpolation in [Interpolation::Hold, Interpolation::Linear] {
        let log = |n: usize| {
            let mut random = Random(9);
            let times: Vec<f64> =
                (0..n).map(|i| i as f64 / 8.0 + random.below(100) as f64 / 1000.0).collect();
            let values: Vec<f64> = (0..n).map(|_| random.below(2001) as f64 / 1000.0 - 1.0).collect();
            [signal(&times, &values, interpolation)]
        };
        let short = log(10_000);
        let long = log(100_000);
        for text in texts {
            let monitor = compile(text, &short).unwrap();
            let time = |signals: &[DenseSignal], repetitions: usize| {
                let before = processor_secs();
                for _ in 0..repetitions {
                    std::hint::black_box(monitor.robustness_signal(signals).unwrap());
                }
                processor_secs() - before
            };
            // The least of several times, because other programs share the caches.
            let best = |signals, repetitions| {
                (0..3).map(|_| time(signals, repetitions)).fold(f64::INFINITY, f64::min)
            };
            let parts = best(&short, 10);
            let whole = best(&long, 1);
            assert!(
                whole < 4.0 * parts + 0.05,
                "{text}: {whole} s for 100,000 samples, {parts} s for ten of 10,000"
            );
            let breakpoints = monitor.robustness_signal(&long).unwrap().breakpoints().len();
            assert!(breakpoints < 600_000, "{text}: {breakpoints}");
        }
    }
}
