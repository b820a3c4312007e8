//! Formulas with each known trap, and formulas without one.

use std::collections::BTreeMap;
use std::sync::Arc;

use mishandle_requirements::{Context, describe, start_traps};
use mishandle_stl::{Clock, Formula, Monitor, Trace, is_violated};

/// Returns the names of the traps.
fn traps(text: &str, context: &Context) -> Vec<String> {
    describe(text, context).expect("a formula").traps.into_iter().map(|trap| trap.name).collect()
}

#[track_caller]
fn check(text: &str, expected: &[&str]) {
    let context = Context { period: Some(0.1), ..Context::default() };
    assert_eq!(traps(text, &context), expected, "{text}");
}

#[test]
fn ordinary_requirements_have_no_trap() {
    for text in [
        "always[0:2s](force <= 20)",
        "always(force <= 20)",
        "eventually[0:5s](always[0:1s](distance <= 0.1))",
        "always(once[0:1s](x >= 1) implies y >= 1)",
        "always(rise(closed >= 1) implies force < 20)",
        "(not (q >= 1)) unless p >= 1",
        "always(abs(x - 1) <= 0.1 and y >= 2)",
        "always(a >= 1 or b >= 1 or c >= 1)",
        "always[1:inf](abs(x - (prev x)) <= 0.1)",
        "always(x - (prev x) <= 0.1)",
        "not eventually(x >= 1)",
        "always(p >= 1) or eventually[0:2s](q >= 1)",
        "eventually[0:5s](p >= 1 and q >= 1)",
        "always(low <= v and v <= 0.3)",
        "always(not (a >= 1 and b >= 1))",
    ] {
        check(text, &[]);
    }
}

#[test]
fn implications_without_content() {
    check("always(x > 2 and x < 1 implies y >= 1)", &["vacuous-implication"]);
    check("always(abs(x) < 0 implies y >= 1)", &["vacuous-implication"]);
    check(
        "always(2 * x > 4 and x + 1 <= 3 and x != 2 implies y >= 1)",
        &["vacuous-implication", "measured-equality"],
    );
    check("always(x - y > 1 and y - x > 1 implies z >= 1)", &["vacuous-implication"]);
    check("always(x >= 1 or x < 1 implies y >= 1)", &["condition-always-holds"]);
    check(
        "always((eventually[0:1s] x >= 1) implies y >= 1)",
        &["eventually-as-condition", "window-beyond-the-end"],
    );
}

#[test]
fn windows() {
    check("eventually[0:0](x >= 1)", &["one-sample-window"]);
    check("always[0.02s:0.07s](x >= 1)", &["window-without-sample"]);
    check("always[0:0.25s](x >= 1)", &["bound-between-samples"]);
    check("always[0:0.5](x >= 1)", &["samples-not-seconds"]);
    check("eventually(x >= 1)", &["unbounded-eventually"]);
    check("always(p >= 1 implies eventually(q >= 1))", &["unbounded-eventually"]);
    check("always(p >= 1 implies eventually[0:2s](q >= 1))", &["window-beyond-the-end"]);
    let fast = Context { period: Some(1.0 / 60.0), ..Context::default() };
    assert_eq!(traps("always[0:2](x >= 1)", &fast), ["samples-not-seconds"]);
    assert_eq!(traps("always[50:300](x >= 1)", &fast), [""; 0]);
    check("eventually[0:2] always[0:1s](x >= 1)", &["samples-not-seconds"]);
    check("eventually[0s:2s] always[0:1s](x >= 1)", &[]);
}

/// A cut window of `eventually` violates too early, one of `always` too late, and a negation swaps
/// the two.
#[test]
fn windows_beyond_the_end_respect_negation() {
    let why = |text: &str| {
        let traps = describe(text, &Context::default()).expect("a formula").traps;
        let trap = traps.into_iter().find(|trap| trap.name == "window-beyond-the-end").expect("cut");
        trap.why
    };
    let check = |text: &str, parts: [&str; 2]| {
        let why = why(text);
        assert!(parts.iter().all(|part| why.contains(part)), "{text}: {why}");
    };
    let fails = "would come after";
    let misses = "is not seen";
    let both = "either direction";
    check("always(p >= 1 implies eventually[0:2s](q >= 1))", ["last 2 s", fails]);
    check("always(p >= 1 implies always[0:2s](q >= 1))", ["last 2 s", misses]);
    check("always(not eventually[0:2s](q >= 1))", ["last 2 s", misses]);
    check("always(p >= 1 implies not always[0:2s](q >= 1))", ["last 2 s", fails]);
    check("always(p >= 1 implies eventually[0:1s] always[0:2s](q >= 1))", ["window of `eventually`", both]);
    assert!(why("always(eventually[0:1s] always[0:2s](q >= 1))").starts_with("in the last 3 s of a trace"));
}

/// The monitor decides on random traces whether every trace has the same verdict.
#[test]
fn what_lies_outside_of_every_trace_and_decides_it_is_a_warning() {
    let parts = [
        "p >= 0",
        "eventually[0:2](p >= 0)",
        "eventually[2:4](p >= 0)",
        "always[2:4](p >= 0)",
        "p >= 0 until[2:4] q >= 0",
        "p >= 0 until[0:4] q >= 0",
        "not eventually[2:4](p >= 0)",
        "q >= 0 implies eventually[2:4](p >= 0)",
        "q >= 0 and eventually[2:4](p >= 0)",
        "q >= 0 or eventually[2:4](p >= 0)",
        "always[1:2](q >= 0) implies eventually[2:4](p >= 0)",
        "eventually[0:2](eventually[1:1](p >= 0))",
        "eventually(always[1:3](p >= 0))",
        "always[1:3](p >= 0)",
        "once[1:3](p >= 0)",
        "not (historically[1:3](p >= 0))",
        "p >= 0 since[1:2] q >= 0",
        "prev(p >= 0)",
        "s_prev(p >= 0)",
        "prev(prev(p >= 0))",
        "not (next(p >= 0))",
        "s_next(p >= 0)",
        "p - (prev p) <= 0.1",
        "(prev p) - p <= 0.1",
        "p - (next p) <= 0.1",
        "abs(p - (s_prev q)) <= 0.1",
        "prev(p >= 0) implies q >= 0",
        "once[0:3](prev(p >= 0))",
        "historically[0:2](once[2:3](p >= 0) or q >= 0)",
    ];
    let outers =
        ["always(F)", "eventually(F)", "not always(F)", "always(F) and q >= 0", "always(F) or q >= 0", "F"];
    let mut random = 1_u64;
    let mut value = || {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (random >> 33) as f64 / f64::from(1_u32 << 30) - 1.0
    };
    let names: Arc<[String]> = Arc::from(["p".to_string(), "q".to_string()]);
    let mut traces = Vec::new();
    for _ in 0..200 {
        let mut trace = Trace::new(names.clone());
        (0..12).for_each(|_| trace.push(&[value(), value()]));
        traces.push(trace);
    }
    // Of each sign: a conjunction of random predicates can be violated on all of them by chance.
    for constant in [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]] {
        let mut trace = Trace::new(names.clone());
        (0..12).for_each(|_| trace.push(&constant));
        traces.push(trace);
    }
    for slope in [1.0, -1.0] {
        let mut trace = Trace::new(names.clone());
        (0..12)
            .for_each(|sample| trace.push(&[slope * f64::from(sample - 6), -slope * f64::from(sample - 6)]));
        traces.push(trace);
    }
    let mut warned = 0;
    for part in parts {
        for outer in outers {
            let text = outer.replace('F', &format!("({part})"));
            let formula = Formula::parse(&text).unwrap();
            let mut monitor = Monitor::new(&formula, &names, Clock::steps(0.1)).unwrap();
            let verdicts: Vec<bool> =
                traces.iter().map(|trace| is_violated(monitor.robustness(trace).unwrap())).collect();
            let is_decided = verdicts.iter().all(|verdict| *verdict == verdicts[0]);
            let found = describe(&text, &Context::default()).expect("a formula").traps;
            let why =
                found.iter().find(|trap| trap.why.contains("every trace")).map(|trap| trap.why.as_str());
            let expected = if verdicts[0] { "every trace violates" } else { "every trace satisfies" };
            // A formula that sees the first sample only has a warning about that.
            let sees_the_first_only = found.iter().any(|trap| {
                trap.formula == formula.to_string()
                    && matches!(trap.name.as_str(), "first-sample-only" | "past-at-the-start")
            });
            assert_eq!(why.is_some(), is_decided && !sees_the_first_only, "{text}: {why:?}");
            assert!(why.is_none_or(|why| why.contains(expected)), "{text}: {why:?}");
            warned += u32::from(is_decided);
        }
    }
    assert!(warned > 10, "{warned}");
}

#[test]
fn windows_longer_than_the_episode() {
    let episode = |episode_secs| Context { episode_secs: Some(episode_secs), ..Context::default() };
    assert_eq!(traps("always[0:10s](x >= 1)", &episode(5.0)), ["horizon-beyond-episode"]);
    assert_eq!(traps("always[0:10s](x >= 1)", &episode(10.0)), [""; 0]);
    assert_eq!(traps("always(historically[0:10s](x >= 1))", &episode(2.0)), ["horizon-beyond-episode"]);
    assert_eq!(traps("always(historically[0:2s](x >= 1))", &episode(2.0)), [""; 0]);
    let samples = Context { samples: Some(300), ..Context::default() };
    assert_eq!(traps("eventually[0:270](always[0:30](x >= 1))", &samples), ["horizon-beyond-episode"]);
    assert_eq!(traps("eventually[0:269](always[0:30](x >= 1))", &samples), [""; 0]);
}

#[test]
fn comparisons() {
    check("always(x == 0.3)", &["measured-equality"]);
    check("always(x != y)", &["measured-equality"]);
    check("always(abs(x) >= 0)", &["constant-comparison"]);
    check("always(x <= x)", &["constant-comparison"]);
    check("always(1 > 2 or y >= 1)", &["constant-comparison"]);
    check("always(x >= 2 and x <= 1)", &["contradiction"]);
    check("always(x >= 1 or x <= 2)", &["always-true"]);
    check("always(x >= 2 implies x >= 1)", &["always-true"]);
    check("always(0.2 <= v <= 0.3)", &["chained-comparison"]);
    check("always(closed implies force <= 20)", &["flag-always-holds"]);
    check("a = x >= 1\nb = y >= 1\nalways(z >= 1)", &["unused-definition", "unused-definition"]);
}

#[test]
fn equality_of_formulas_is_meant_as_iff() {
    for (text, meant) in [
        ("always((a >= 1) == (b >= 1))", "(a >= 1) iff (b >= 1)"),
        ("always((a >= 1) != (b >= 1))", "(a >= 1) xor (b >= 1)"),
    ] {
        let found = describe(text, &Context::default()).expect("a formula").traps;
        assert_eq!((found.len(), found[0].instead.as_deref()), (1, Some(meant)), "{text}");
    }
    let number = describe("always(x == (prev y))", &Context::default()).expect("a formula").traps;
    assert!(number[0].instead.as_deref().is_some_and(|text| text.starts_with("abs(")), "{number:?}");
}

#[test]
fn codes_of_a_log_may_be_compared_exactly() {
    let mut trace = Trace::new(vec!["mode".to_owned(), "x".to_owned()].into());
    for mode in [0.0, 2.0, 1.0] {
        trace.push(&[mode, 0.5 * mode]);
    }
    let context = Context { traces: vec![("rig".to_owned(), trace)], ..Context::default() };
    assert_eq!(traps("always(mode == 2 implies x >= 1)", &context), [""; 0]);
    assert_eq!(traps("always(x == 1)", &context), ["measured-equality"]);
    // No sample has the mode.
    assert_eq!(traps("always(mode == 3 implies x >= 1)", &context), ["vacuous-implication"]);
}

#[test]
fn precedence() {
    check("always p >= 1 implies q >= 1", &["precedence"]);
    check("always(p >= 1) implies q >= 1", &["precedence"]);
    check("always[0:2s] p >= 1 and q >= 1", &["precedence"]);
    check("always(p >= 1) since q >= 1", &["past-at-the-start"]);
    check("eventually[0:5s](not (p >= 1) or q >= 1)", &["eventually-implies"]);
    check("eventually[0:5s](q >= 1 or not (p >= 1))", &[]);
    check("always[0:2s](p >= 1) and q >= 1", &["first-sample-only"]);
    check("always(a >= 1 and b >= 1 or c >= 1)", &["precedence"]);
    check("always((a >= 1 and b >= 1) or c >= 1)", &[]);
    check("always(a >= 1 implies b >= 1 implies c >= 1)", &["precedence"]);
    check("always(a >= 1 implies (b >= 1 implies c >= 1))", &[]);
}

/// The suggestion is the comparison of the numbers that the text looks like.
#[test]
fn operators_written_like_functions() {
    for (text, meant) in [
        ("x - prev(x) <= 0.1", "x - (prev x) <= 0.1"),
        ("always(x - prev(x) <= 0.1)", "x - (prev x) <= 0.1"),
        ("prev(x) - y <= 0.1", "(prev x) - y <= 0.1"),
        ("next(x) - y <= 0.1 and z >= 1", "(next x) - y <= 0.1"),
        ("prev(x) - prev(y) <= 0.1", "(prev x) - (prev y) <= 0.1"),
        ("2 * (prev(x) - y) <= 0.1", "2 * ((prev x) - y) <= 0.1"),
        ("a - prev(x + y) * 2 <= (b - c)", "a - (prev (x + y)) * 2 <= (b - c)"),
    ] {
        let found = describe(text, &Context::default()).expect("a formula").traps;
        let found =
            found.iter().map(|trap| (trap.name.as_str(), trap.severity.name(), trap.instead.as_deref()));
        assert_eq!(found.collect::<Vec<_>>(), [("precedence", "warning", Some(meant))], "{text}");
        assert!(!traps(meant, &Context::default()).contains(&"precedence".to_owned()), "{meant}");
    }
    let found = describe("always[0:2s](x) <= 3", &Context::default()).expect("a formula").traps;
    assert_eq!((found.len(), found[0].severity.name()), (1, "note"));
    let instead = found[0].instead.as_deref().expect("a suggestion");
    assert!(instead.contains("(always[0s:2s] x) <= 3"), "{instead}");
    for text in [
        "always[1:inf](prev(x >= 1) implies y >= 1)",
        "d = x - y\nalways d <= 0.1",
        "always (prev (x <= 1))",
        "always abs(x) <= 3",
    ] {
        check(text, &[]);
    }
}

/// A formula is evaluated at the first sample: without an operator over time around it, a part sees
/// no other one, and an operator over the past sees nothing before it.
#[test]
fn parts_that_see_the_first_sample_only() {
    let found = |text: &str| {
        let traps = describe(text, &Context::default()).expect("a formula").traps;
        traps
            .into_iter()
            .map(|trap| (trap.name, trap.severity.name(), trap.instead.unwrap_or_default()))
            .collect::<Vec<_>>()
    };
    let first = "first-sample-only";
    let past = "past-at-the-start";
    for (text, name, meant) in [
        ("x <= 1", first, "always(x <= 1), or eventually(x <= 1)"),
        ("x >= 1 and y >= 1", first, "always(x >= 1 and y >= 1), or eventually(x >= 1 and y >= 1)"),
        ("x - (prev x) <= 1", first, "always(x - (prev x) <= 1), or eventually(x - (prev x) <= 1)"),
        ("not (x >= 1)", first, "always(not(x >= 1)), or eventually(not(x >= 1))"),
        ("x >= 1 implies eventually[0:1s] y >= 1", first, "always(x >= 1 implies eventually[0s:1s](y >= 1))"),
        ("historically(x <= 1)", past, "always(x <= 1)"),
        ("once[0:2s](x >= 1)", past, "eventually(x >= 1)"),
        ("(y >= 1) since (x >= 1)", past, "always(y >= 1 since x >= 1)"),
        ("prev(x >= 1)", past, "always(prev(x >= 1))"),
        ("not historically(x <= 1)", past, "always(x <= 1)"),
        ("rise(x >= 1) or always(y >= 1)", past, "always(rise(x >= 1))"),
    ] {
        assert_eq!(found(text), [(name.to_owned(), "warning", meant.to_owned())], "{text}");
    }
    // A start condition may be meant.
    let start = found("x <= 1 and always(y <= 1)");
    assert_eq!((start.len(), start[0].0.as_str(), start[0].1), (1, first, "note"));
    let every = Context { at_every_sample: true, ..Context::default() };
    assert_eq!(traps("x <= 1 and once(y >= 1)", &every), [""; 0]);
}

/// Each trap says what happens: no value of a later sample changes the verdict.
#[test]
fn later_samples_do_not_change_the_verdict_of_a_part_that_sees_the_first_one_only() {
    let mut checked = 0;
    for text in [
        "x <= 1",
        "x >= 1 or y >= 1",
        "historically(x <= 1)",
        "(y >= 1) since (x >= 1)",
        "prev(x >= 1)",
        "rise(x >= 1)",
        "x - (prev x) <= 1",
        "not once(x >= 1)",
    ] {
        assert!(!start_traps(&Formula::parse(text).expect("a formula")).is_empty(), "{text}");
        let names: Arc<[String]> = vec!["x".to_owned(), "y".to_owned()].into();
        for first in [[0.0, 0.0], [2.0, 0.0], [0.0, 2.0], [2.0, 2.0]] {
            let verdict = |later: f64| {
                let columns = first.map(|value| vec![value, later, later]).to_vec();
                let formula = Formula::parse(text).expect("a formula");
                let mut monitor = Monitor::new(&formula, &names, Clock::unknown()).expect("a monitor");
                is_violated(
                    monitor.robustness(&Trace::from_columns(Arc::clone(&names), columns)).expect("a value"),
                )
            };
            assert_eq!(verdict(-50.0), verdict(50.0), "{text}");
            checked += 1;
        }
    }
    assert_eq!(checked, 32);
}

#[test]
fn an_implication_that_has_to_hold_once() {
    for (text, instead) in [
        (
            "eventually[0:5s](p >= 1 implies q >= 1)",
            "eventually[0s:5s](p >= 1 and q >= 1), or always(p >= 1 implies eventually[0s:5s](q >= 1))",
        ),
        ("(r >= 1) until[0:5s] (p >= 1 implies q >= 1)", "(p >= 1 and q >= 1) in place of the implication"),
    ] {
        let found = describe(text, &Context::default()).expect("a formula").traps;
        let found =
            found.iter().map(|trap| (trap.name.as_str(), trap.instead.as_deref())).collect::<Vec<_>>();
        assert_eq!(found, [("eventually-implies", Some(instead))], "{text}");
    }
    // Negated, the condition is required: always(p >= 1 and not q >= 1).
    check("not eventually[0:5s](p >= 1 implies q >= 1)", &[]);
}

/// Outside of the trace, `prev` and `next` of a number are infinite.
#[test]
fn neighbors_outside_of_the_trace() {
    check("always(abs(x - (prev x)) <= 0.1)", &["no-neighbor"]);
    check("always[0:2s](abs((prev x) - x) < 0.1)", &["no-neighbor"]);
    check("not eventually(abs(x - (s_prev x)) > 0.1)", &["no-neighbor"]);
    check("always(p >= 1 implies x == (prev x))", &["measured-equality", "no-neighbor"]);
    check("always(abs(x - (next x)) <= 0.1)", &["no-neighbor"]);
    // Of truth values, they hold or fail there.
    check("always(prev(x >= 1) implies y >= 1)", &["no-neighbor"]);
    check("always(s_prev(x >= 1) or y >= 1)", &["no-neighbor"]);
    check("always(prev(x >= 1) or y >= 1)", &[]);
    check("always(not prev(x >= 1))", &["no-neighbor"]);
    // Without parentheses, the operand continues.
    for text in
        ["always(x - prev x <= 0.1)", "always(x - next x <= 0.1)", "always(abs(x - prev x - 1) <= 0.1)"]
    {
        check(text, &["precedence"]);
    }
    for text in [
        "always[1:inf](abs(x - (prev x)) <= 0.1)",
        "always(next(abs(x - (prev x)) <= 0.1))",
        "always[0:2s](abs(x - (next x)) <= 0.1)",
        "always(x - (prev x) <= 0.1)",
        "eventually[0:2s](abs(x - (prev x)) <= 0.1)",
    ] {
        check(text, &[]);
    }
    let names: Arc<[String]> = vec!["x".to_owned()].into();
    let violated = |text: &str| {
        let formula = Formula::parse(text).expect("a formula");
        let mut monitor = Monitor::new(&formula, &names, Clock::steps(0.1)).expect("a monitor");
        is_violated(
            monitor
                .robustness(&Trace::from_columns(Arc::clone(&names), vec![vec![1.0; 30]]))
                .expect("a value"),
        )
    };
    assert!(violated("always(abs(x - (prev x)) <= 0.1)") && violated("always(abs(x - (next x)) <= 0.1)"));
    assert!(!violated("always[1:inf](abs(x - (prev x)) <= 0.1)"));
}

#[test]
fn units() {
    check("always(x_deg <= y_rad)", &["unit-mismatch"]);
    check("always(x_mm + y_mm <= 3)", &[]);
    check("always(x_mm + y_m <= 3)", &["unit-mismatch"]);
    check("always(angle_deg <= 0.1)", &[]);
    check("always(angle_rad <= 20)", &["degrees-as-radians"]);
    check("always(gap_m >= 0.1 and angle_deg <= 5)", &["mixed-units"]);
    let units = BTreeMap::from([("f".to_owned(), "N".to_owned()), ("t".to_owned(), "N m".to_owned())]);
    let context = Context { units, ..Context::default() };
    assert_eq!(traps("always(f <= t)", &context), ["unit-mismatch"]);
}

#[test]
fn words_have_the_unit_of_bounds_without_one() {
    let context = Context { unit: Some(mishandle_stl::TimeUnit::Seconds), ..Context::default() };
    let found = describe("always[0:2](x <= 1)", &context).expect("a formula");
    assert_eq!(found.words, ["at every step from 0 s to 2 s: x is at most 1"]);
}

#[test]
fn a_trap_names_its_place() {
    let found = describe("always(x >= 1 and\n  y == 0.5)", &Context::default()).expect("a formula");
    assert_eq!((found.traps[0].line, found.traps[0].column), (Some(2), Some(5)));
}

#[test]
fn flags_of_a_log_have_a_better_limit() {
    let mut trace = Trace::new(vec!["closed".to_owned(), "force".to_owned()].into());
    for closed in [0.0, 1.0, 1.0] {
        trace.push(&[closed, 7.0 * closed]);
    }
    let context = Context { traces: vec![("rig".to_owned(), trace)], ..Context::default() };
    assert_eq!(traps("always(closed >= 1 implies force >= 5)", &context), ["flag-at-its-limit"]);
    assert_eq!(traps("always(closed >= 0.5 implies force >= 5)", &context), [""; 0]);
    assert_eq!(traps("always(closed implies force >= 5)", &context), ["flag-always-holds"]);
}
