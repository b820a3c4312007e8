//! No text makes the analyses panic or take long, and drawings are those of the monitor.

use std::sync::Arc;

use crate::processor_time::processor_secs;
use mishandle_random::Sequence;
use mishandle_requirements::{Context, describe, draw, find_examples};
use mishandle_stl::{Clock, Formula, Monitor, Trace, is_violated};

#[test]
fn long_and_deep_formulas_take_little_time() {
    let start = processor_secs();
    let texts = [
        "not ".repeat(10_000) + "(x >= 1)",
        "(".repeat(10_000) + "x >= 1" + &")".repeat(10_000),
        vec!["x >= 1"; 20_000].join(" and "),
        vec!["x >= 1"; 900].join(" implies "),
        vec!["(x >= 1 or y <= 2)"; 300].join(" and "),
        vec!["x == 1"; 600].join(" or "),
        "x + ".repeat(20_000) + "x >= 1",
        "always[0:99999999s] eventually[0:99999999s] (x >= 1)".to_owned(),
        "always[0:1e-9s](x >= 1)".to_owned(),
        "always[0:1e300](x >= 1)".to_owned(),
        "`größe \u{202e}`  >= 1 and x / 0 >= 1e308 * 10".to_owned(),
        "true".to_owned(),
        "1 <= 2".to_owned(),
    ];
    for text in &texts {
        for period in [None, Some(0.1)] {
            let context = Context { period, ..Context::default() };
            let shown: String = text.chars().take(60).collect();
            let found = describe(text, &context);
            assert!(found.is_ok() || text.starts_with('('), "{shown}: {found:?}");
            if let Ok(formula) = Formula::parse(text) {
                let _ = find_examples(&formula, &context);
            }
        }
    }
    assert!(processor_secs() - start < 60.0, "{} s", processor_secs() - start);
}

#[test]
fn texts_that_are_no_formula_are_errors() {
    for text in ["", " ", "always", "x >", "[0:2]", "x >= 1 )", "always[nan:2](x >= 1)", "\0"] {
        assert!(describe(text, &Context::default()).is_err(), "{text:?}");
    }
}

/// Builds a random formula of the signals x and y.
fn formula(random: &mut Sequence, depth: u32) -> String {
    let pick =
        |random: &mut Sequence, from: &[&str]| from[random.below(from.len() as u64) as usize].to_owned();
    if depth == 0 || random.below(6) == 0 {
        let term = pick(random, &["x", "y", "abs(x)", "x - y", "2 * x + 1", "-y"]);
        let comparison = pick(random, &["<=", ">=", "<", ">", "==", "!="]);
        return format!("({term} {comparison} {})", random.below(5) as f64 - 2.0);
    }
    let mut part = || formula(random, depth - 1);
    let a = part();
    let b = part();
    match random.below(12) {
        0 => format!("(not {a})"),
        1 => format!("(always[0:3] {a})"),
        2 => format!("(eventually[1:4] {a})"),
        3 => format!("(once {a})"),
        4 => format!("({a} until[0:3] {b})"),
        5 => format!("({a} unless {b})"),
        6 => format!("rise({a})"),
        7 | 8 => format!("({a} implies {b})"),
        9 => format!("({a} or {b})"),
        10 => format!("({a} xor {b})"),
        _ => format!("({a} and {b})"),
    }
}

/// A part that the analysis of values calls a contradiction fails on every trace; one that it calls
/// true holds.
#[test]
fn constant_parts_are_constant_on_random_traces() {
    let mut random = Sequence::new(3, 0);
    let names: Arc<[String]> = vec!["x".to_owned(), "y".to_owned()].into();
    let mut checked = 0;
    for _ in 0..3000 {
        let text = formula(&mut random, 3);
        let found = describe(&text, &Context::default()).expect("a formula");
        for trap in found.traps {
            let expected = match trap.name.as_str() {
                "contradiction" => false,
                "always-true" => true,
                "constant-comparison" => trap.why.contains("always holds"),
                "vacuous-implication" => false,
                "condition-always-holds" => true,
                _ => continue,
            };
            let part = Formula::parse(&trap.formula).expect("a formula");
            let mut monitor = Monitor::new(&part, &names, Clock::unknown()).expect("a monitor");
            let mut trace = Trace::new(Arc::clone(&names));
            for _ in 0..200 {
                trace.push(&[random.below(13) as f64 / 2.0 - 3.0, random.below(13) as f64 / 2.0 - 3.0]);
            }
            checked += 1;
            for value in monitor.robustness_signal(&trace).expect("values") {
                assert_eq!(!is_violated(*value), expected, "{} in {text}", trap.formula);
            }
        }
    }
    assert!(checked > 100, "{checked}");
}

/// The verdict of an example is that of the monitor on its values, and the lanes are those of the
/// sub-formulas.
#[test]
fn examples_have_the_verdict_of_the_monitor() {
    let mut random = Sequence::new(4, 0);
    let mut satisfied = 0;
    let mut violated = 0;
    for _ in 0..150 {
        let text = formula(&mut random, 3);
        let formula = Formula::parse(&text).expect("a formula");
        for example in find_examples(&formula, &Context::default()) {
            let values = example.values.expect("an example has values");
            let names: Arc<[String]> = values.iter().map(|signal| signal.signal.clone()).collect();
            let trace = Trace::from_columns(
                Arc::clone(&names),
                values.into_iter().map(|signal| signal.values).collect(),
            );
            let mut monitor = Monitor::new(&formula, &names, Clock::unknown()).expect("a monitor");
            let robustness = monitor.robustness(&trace).expect("a value");
            assert_eq!(robustness.to_bits(), example.robustness.0.to_bits(), "{text}");
            assert_eq!(is_violated(robustness), example.name == "violated", "{text}");
            *(if example.violated { &mut violated } else { &mut satisfied }) += 1;
            for lane in &example.lanes {
                let part = Formula::parse(&lane.formula).expect("a formula");
                let mut monitor = Monitor::new(&part, &names, Clock::unknown()).expect("a monitor");
                let signal = monitor.robustness_signal(&trace).expect("values").to_vec();
                let mut covered = 0;
                for span in &lane.spans {
                    assert_eq!(span.first, covered, "{text}");
                    covered = span.last + 1;
                    for sample in span.first..=span.last {
                        let value = signal[usize::try_from(sample).expect("a sample")];
                        match span.state.name() {
                            "holds" => assert!(!is_violated(value), "{text}"),
                            "violated" => assert!(is_violated(value), "{text}"),
                            _ => {}
                        }
                    }
                }
                assert_eq!(covered, example.samples, "{text}");
            }
        }
    }
    assert!(satisfied > 100 && violated > 100, "{satisfied} {violated}");
}

/// An edge at the first sample, where no sample is before it, shows nothing.
#[test]
fn examples_show_real_edges() {
    for (text, before, after) in [
        ("always(rise(x >= 1) implies y >= 1)", false, true),
        ("always(fall(x >= 1) implies always[0:2](not (x >= 1)))", true, false),
    ] {
        let formula = Formula::parse(text).expect("a formula");
        let examples = find_examples(&formula, &Context::default());
        assert_eq!(examples.len(), 2, "{text}");
        for example in examples {
            let x = example.values.expect("values").remove(0).values;
            let is_edge = |pair: &[f64]| (pair[0] >= 1.0, pair[1] >= 1.0) == (before, after);
            assert!(x.windows(2).any(is_edge), "{text}, {}: {x:?}", example.name);
        }
    }
}

/// The drawing of a trap shows it: another sample decides otherwise than the first one, and the
/// implication that has to hold once fails at some sample of a satisfied trace.
#[test]
fn examples_show_the_trap() {
    for (text, part) in [
        ("x <= 1", "x <= 1"),
        ("x >= 1 and y <= 2", "x >= 1 and y <= 2"),
        ("historically(x <= 1)", "x <= 1"),
        ("once(x >= 1)", "x >= 1"),
        ("x >= 1 implies eventually[0:2](y >= 1)", "x >= 1"),
        ("eventually[0:5](x >= 1 implies y >= 1)", "x >= 1 implies y >= 1"),
    ] {
        let formula = Formula::parse(text).expect("a formula");
        let part = Formula::parse(part).expect("a formula");
        let examples = find_examples(&formula, &Context::default());
        assert_eq!(examples.len(), 2, "{text}");
        for example in examples {
            let values = example.values.expect("values");
            let names: Arc<[String]> = values.iter().map(|signal| signal.signal.clone()).collect();
            let columns = values.into_iter().map(|signal| signal.values).collect();
            let trace = Trace::from_columns(Arc::clone(&names), columns);
            let mut monitor = Monitor::new(&part, &names, Clock::unknown()).expect("a monitor");
            let verdicts: Vec<bool> = monitor
                .robustness_signal(&trace)
                .expect("values")
                .iter()
                .map(|value| is_violated(*value))
                .collect();
            assert!(
                verdicts.contains(&true) && verdicts.contains(&false),
                "{text}, {}: {trace:?}",
                example.name
            );
        }
    }
}

/// At the last sample, p holds and q does not: the monitor violates the formula, and each row shows
/// the sample that this comes from.
#[test]
fn a_cut_window_does_not_hide_the_violating_sample() {
    let formula = Formula::parse("always(p >= 1 implies eventually[0:2](q >= 1))").expect("a formula");
    let names: Arc<[String]> = vec!["p".to_owned(), "q".to_owned()].into();
    let trace = Trace::from_columns(names, vec![vec![0.0, 0.0, 0.0, 0.0, 2.0], vec![0.0; 5]]);
    let drawn =
        draw(&formula, mishandle_results::ExampleKind::Log, "a", &trace, Clock::unknown()).expect("drawn");
    assert!(drawn.violated);
    for lane in &drawn.lanes[..2] {
        let last = lane.spans.last().expect("a span");
        assert_eq!((last.state.name(), last.last), ("violated", 4), "{}", lane.formula);
    }
}
