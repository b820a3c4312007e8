//! Error messages for wrong formulas, traces and clocks, and the parsing of unusual formulas.

use crate::processor_time::processor_secs;
use mishandle_stl::{
    Clock, CutMonitor, Formula, Monitor, MonitorError, OnlineMonitor, ParseError, TimeUnit, Trace,
};
use std::sync::Arc;

const CONTROL_DT: f64 = 1.0 / 60.0;

#[track_caller]
fn check(text: &str, column: usize, message: &str) {
    let error = Formula::parse(text).expect_err(text);
    assert_eq!((error.column(), error.to_string().as_str()), (column, message), "{text:?}");
}

const OPERAND: &str = "expected a signal, a number, `(` or a prefix operator";
const BACKQUOTES: &str = "names with other characters are written in backquotes: `a/b[0]`";
const BOUND: &str = "expected a bound: a nonnegative number, a constant or `inf`";

#[test]
fn a_missing_operand_is_reported_at_its_position() {
    check("", 1, &format!("column 1: {OPERAND}, found the end of the formula"));
    check("always[0:30](d <= )", 19, &format!("column 19: {OPERAND}, found `)`"));
    check("a and", 6, &format!("column 6: {OPERAND}, found the end of the formula"));
    check("a and or b", 7, &format!("column 7: {OPERAND}, found `or`"));
    check("a ** b", 4, &format!("column 4: {OPERAND}, found `*`"));
    check("()", 2, &format!("column 2: {OPERAND}, found `)`"));
    let letter = "a signal of this name needs backquotes: `U`";
    check("a until U b", 9, &format!("column 9: {OPERAND}, found `U`; {letter}"));
    check("always(U <= 2)", 8, &format!("column 8: {OPERAND}, found `U`; {letter}"));
    check("a > +1", 5, &format!("column 5: {OPERAND}, found `+`"));
}

#[test]
fn unmatched_brackets_are_errors() {
    check(
        "(a > 0",
        7,
        "column 7: expected an operator or `)` to match the `(` at column 1, found the end of the formula",
    );
    check("a > 0)", 6, "column 6: expected an operator or the end of the formula, found `)`");
    check(
        "abs(a",
        6,
        "column 6: expected an operator or `)` to end the `abs(` at column 1, found the end of the formula",
    );
    check("abs a", 5, "column 5: expected `(` after `abs`, found `a`");
    check("pow(a)", 6, "column 6: expected `,` and another operand of `pow`, found `)`");
    check(
        "pow(a, 2, 3)",
        9,
        "column 9: expected an operator or `)` to end the `pow(` at column 1, found `,`",
    );
    check("(a, b)", 3, "column 3: expected an operator or `)` to match the `(` at column 1, found `,`");
    check("rise a", 6, "column 6: expected `(` after `rise`, found `a`");
}

#[test]
fn malformed_intervals_are_errors() {
    check("always[3:1] a", 7, "column 7: expected an interval [begin:end] with begin <= end, found [3:1]");
    check(
        "always[2s:500ms] a",
        7,
        "column 7: expected an interval [begin:end] with begin <= end, found [2s:500ms]",
    );
    check("always[-1:2] a", 8, &format!("column 8: {BOUND}, found `-`"));
    check("always[0:] a", 10, &format!("column 10: {BOUND}, found `]`"));
    check("always[0:k] a", 10, &format!("column 10: {BOUND}, found `k`"));
    check("always[inf:inf] a", 8, "column 8: expected a finite begin, found `inf`");
    check(
        "always[2] a",
        9,
        "column 9: expected a unit (s, ms, us, ns), `:` or `,` and the interval's end, found `]`",
    );
    check("always[0:3 min] a", 12, "column 12: expected a unit (s, ms, us, ns) or `]`, found `min`");
    check("always[0:3ms a", 14, "column 14: expected `]` to end the interval, found `a`");
    let unit = "column 11: expected a unit (s, ms, us, ns) at the interval's end, since its begin has one, found `]`";
    check("always[0s:] a", 11, &format!("column 11: {BOUND}, found `]`"));
    check("always[1s:] a".replace(":]", ":3]").as_str(), 12, &unit.replace("11", "12"));
    let no_interval = "expected an operand; only always, eventually, historically, once, until, release, unless and \
                       since take an interval, found `[`";
    check("next[1:2] a", 5, &format!("column 5: {no_interval}"));
    check("a and[1:2] b", 6, &format!("column 6: {no_interval}"));
}

#[test]
fn a_misspelled_operator_is_reported_with_a_suggestion() {
    let check = |text: &str, column: usize, found: &str, hint: &str| {
        let expected = "expected an operator or the end of the formula";
        check(text, column, &format!("column {column}: {expected}, found `{found}`{hint}"));
    };
    check("allways[0:3](d < 1)", 8, "[", "; did you mean `always`?");
    check("d > 0 and eventualy(d < 1)", 20, "(", "; did you mean `eventually`?");
    check("nott d < 1", 6, "d", "; did you mean `not`?");
    check("squrt(d) < 1", 6, "(", "; did you mean `sqrt`?");
    check("x unti y", 3, "unti", "; did you mean `until`?");
    check("x > 0 AND y > 0", 7, "AND", "; did you mean `and`?");
    // Not similar to an infix operator, and not similar to any operator.
    check("x alway y", 3, "alway", "");
    check("door_yaw (d)", 10, "(", "");
    check("x y", 3, "y", "");
    check("x not y", 3, "not", "");
    check("always d[0:3]", 9, "[", "");
}

/// A column of a log has this name. `X - 1 <= 2` would be `next(-1 <= 2)`, which no trace violates.
#[test]
fn a_letter_is_an_operator_only_where_no_signal_can_be() {
    for letter in ["G", "F", "H", "O", "Y", "X", "sY", "sX"] {
        let hint = format!("a signal of this name needs backquotes: `{letter}`");
        for text in [
            "@ - 1 <= 2",
            "@ <= 1",
            "abs(@) <= 2",
            "x >= @",
            "@ + @ <= 2",
            "(@)",
            "@ and x >= 1",
            "@ / 2 <= 1",
        ] {
            let text = format!("always({})", text.replace('@', letter));
            let error = Formula::parse(&text).expect_err(&text).to_string();
            assert!(error.contains(&hint), "{text}: {error}");
            let quoted = text.replace(letter, &format!("`{letter}`"));
            assert!(Formula::parse(&quoted).expect(&quoted).signals().contains(&letter), "{quoted}");
        }
        let number = format!("{letter} 2 <= x");
        assert!(Formula::parse(&number).expect_err(&number).to_string().contains(&hint), "{number}");
        for text in
            ["@(x >= 1)", "@ x", "@ !(x >= 1)", "@ not x", "@ abs(x) <= 1", "@ @ x", "@ `x` >= 1", "@ true"]
        {
            let text = text.replace('@', letter);
            let formula = Formula::parse(&text).expect(&text);
            assert!(!formula.signals().contains(&letter), "{text}");
        }
    }
}

#[test]
fn a_letter_that_is_also_a_signal_of_the_trace_is_refused() {
    for (text, letter, operator) in [
        ("X(p >= 0)", "X", "next"),
        ("always(p >= 0 and O[0:2] p >= 1)", "O", "once"),
        ("p until F p", "F", "eventually"),
    ] {
        let formula = Formula::parse(text).unwrap();
        let names: Vec<String> = vec!["p".to_owned(), letter.to_owned()];
        let expected =
            MonitorError::LetterIsSignal { letter: letter.to_owned(), operator: operator.to_owned() };
        let found = [
            formula.check_names(&names).unwrap_err(),
            Monitor::new(&formula, &names, Clock::unknown()).unwrap_err(),
            OnlineMonitor::new(std::slice::from_ref(&formula), &names, Clock::unknown(), None).unwrap_err(),
            CutMonitor::new(std::slice::from_ref(&formula), &names, Clock::unknown()).unwrap_err(),
        ];
        for error in found {
            assert_eq!(error, expected, "{text}");
            assert!(error.to_string().contains(&format!("`{letter}`")), "{error}");
        }
        let words: Formula = formula.to_string().parse().unwrap();
        assert!(words.check_names(&names).is_ok(), "{words}");
        assert!(formula.check_names(&names[..1]).is_ok(), "{text}");
    }
    let infix: Formula = "p U q".parse().unwrap();
    assert!(infix.check_names(&["p", "q", "U"].map(str::to_owned)).is_ok());
}

#[test]
fn a_formula_that_reads_no_signal_asks_nothing_of_a_trace() {
    let names = ["p".to_owned()];
    for text in ["true", "always(1 <= 2)", "next(false)", "k = 3; always(k >= 2)"] {
        let formula = Formula::parse(text).unwrap();
        let formulas = ["p <= 1".parse().unwrap(), formula.clone()];
        let found = [
            formula.check_names(&names).unwrap_err(),
            OnlineMonitor::new(&formulas, &names, Clock::unknown(), None).unwrap_err(),
            CutMonitor::new(&formulas, &names, Clock::unknown()).unwrap_err(),
        ];
        assert!(found.iter().all(|error| *error == MonitorError::NoSignal), "{text}: {found:?}");
    }
    assert_eq!(Formula::parse("p and true").unwrap().check_names(&names), Ok(()));
}

/// Formulas of Breach, MoonLight, FRET and S-TaLiRo.
#[test]
fn words_of_other_tools_have_a_hint_with_ours() {
    for (text, hint) in [
        ("alw_[0,10](x > 1)", "did you mean `always`?"),
        ("alw (x > 1)", "did you mean `always`?"),
        ("not (ev_[6,12](x > 10))", "did you mean `eventually`?"),
        ("globally [0, 0.2] (x > y)", "did you mean `always`?"),
        ("hist_[0,3](x > 1)", "did you mean `historically`?"),
        ("(x > 1) until_[0,3] (y > 1)", "did you mean `until`?"),
        ("always(x > 1 => y > 1)", "did you mean `implies`?"),
        ("x > 1 <=> y > 1", "did you mean `iff`?"),
        ("x ^ 2 <= 1", "a power is `pow(x, y)`"),
        (r"x > 1 /\ y > 1", r"`/\` is `and`, and `\/` is `or`"),
        ("min(x, y) >= 1", "`min(a, b) >= c` is `a >= c and b >= c`"),
        ("max(x, y) >= 1", "`max(a, b) >= c` is `a >= c or b >= c`"),
        ("x[t] > 1", "by its name alone, without `[t]`"),
        ("[]_[0,5](x > 1)", "`[]` is `always`"),
        ("not <>_[0,5](x > 1)", "`<>` is `eventually`"),
    ] {
        let error = Formula::parse(text).expect_err(text).to_string();
        assert!(error.contains(hint), "{text}: {error}");
    }
}

#[test]
fn malformed_numbers_and_unknown_characters_are_errors() {
    check("a > 1e", 5, "column 5: expected digits in the exponent, found the number `1e`");
    check(
        "a > 1e400",
        5,
        "column 5: expected a number within the range of a 64-bit float, found the number `1e400`",
    );
    let no_unit = "a number has no unit: `x <= 2` compares with 2 in the unit of the signal `x`, and only bounds such as \
                   [0:2s] have one";
    for (text, word) in [("a > 2b", "b"), ("a > 5s", "s")] {
        let message = "column 6: expected an operator or the end of the formula, found";
        check(text, 6, &format!("{message} `{word}`; {no_unit}"));
    }
    check("a b", 3, "column 3: expected an operator or the end of the formula, found `b`");
    let token = "expected a name, a number or an operator, found the character";
    check("~a", 1, &format!("column 1: {token} `~`; {BACKQUOTES}"));
    check("größe ≥ 1", 7, &format!("column 7: {token} `≥`; did you mean `>=`?"));
    check("\u{7}a", 1, &format!("column 1: {token} `\\u{{7}}`; {BACKQUOTES}"));
    check(
        "a > 0 /* b",
        7,
        "column 7: expected `*/` to end the comment that starts here, found the end of the formula",
    );
    check(
        "a > 0 and\n  b >",
        6,
        "line 2, column 6: expected a signal, a number, `(` or a prefix operator, found the end of the formula",
    );
}

#[test]
fn malformed_statements_are_errors() {
    let ros = "expected a formula; RTAMT's ROS annotations and imports are not supported";
    check("@topic(a, b) a > 0", 1, &format!("column 1: {ros}, found `@`"));
    check("from m import T a > 0", 1, &format!("column 1: {ros}, found `from`"));
    check(
        "a > 0; b > 0",
        8,
        "column 8: expected the end of the formula; only the last statement may omit `name =`, found `b`",
    );
    check("p = a; p = b; p", 8, "column 8: `p` is already defined; expected a new name");
    check("const float k = a; k", 17, "column 17: expected the constant's value, a number, found `a`");
    check(
        "const double k = 1; k",
        7,
        "column 7: expected the constant's type: float, int, long, found `double`",
    );
    check("input float d", 14, &format!("column 14: {OPERAND}, found the end of the formula"));
}

#[track_caller]
fn check_same(text: &str, other: &str) {
    let parse = |text: &str| Formula::parse(text).unwrap_or_else(|error| panic!("{text:?}: {error}"));
    assert_eq!(parse(text), parse(other), "{text:?} against {other:?}");
}

#[test]
fn declarations_definitions_and_comments_do_not_change_the_formula() {
    check_same("out = a > 0;", "a > 0");
    check_same("specification near input float a output float out out = a > 0", "a > 0");
    check_same("const float limit = -3.5; a > limit", "a > -3.5");
    check_same("const int k = 3 always[0:k s] a", "always[0:3s] a");
    check_same("c = a + b\nd = c > 0\nout = always d", "always(a + b > 0)");
    check_same("float sum = a + b; sum > 0", "a + b > 0");
    check_same("a > 0 // up\n and /* both */ b > 0", "a > 0 and b > 0");
    // Words that are keywords in some positions only.
    check_same("s > 1 and input > ms", "(s > 1) and (input > ms)");
    check_same("R R R", "R release R");
    check_same("ln(ln) > 0", "(ln(ln)) > 0");
    let unused = Formula::parse("p = x > 0; q = a > 0; q").unwrap();
    assert_eq!(unused.signals(), ["a"]);
}

#[test]
fn formulas_that_rtamt_rejects_or_misparses_have_their_usual_meaning() {
    check_same("a != b", "a !== b");
    check_same("a-1 > 0", "(a) - (1) > 0");
    check_same("-a * b", "(-a) * b");
    check_same("x/0 > 1", "(x) / (0) > 1");
    check_same("always[1:2s] a", "always[1s:2s] a");
    check_same("TRUE && a || false", "(true and a) or false");
    check_same("a > 0x1F", "a > 31");
    check_same("a - -1 > - 2", "a - (-1) > (-2)");
}

#[test]
fn a_printed_formula_shows_its_structure_by_parentheses() {
    let check = |text: &str, printed: &str| assert_eq!(Formula::parse(text).unwrap().to_string(), printed);
    check("a - b + c > 0", "(a - b) + c > 0");
    check("a / b * c > 0", "(a / b) * c > 0");
    check("a - (b + c) > a / (b * c)", "a - (b + c) > a / (b * c)");
    check("(a + b) - c - a > 0", "a + b - c - a > 0");
    check("a + (b - c) > a * (b / c)", "a + (b - c) > a * (b / c)");
    check("a -> b -> c", "a implies b implies c");
    check("a -> (b -> c)", "a implies (b implies c)");
    check("G[0,5] F[0ms,3s] a>0 & !b<-1e-9", "always[0:5] eventually[0ms:3s](a > 0) and not(b < -1e-9)");
    check("((not a)) * 2 until[3:inf] true", "(not a) * 2 until[3:inf] true");
}

#[test]
fn a_state_predicate_has_no_temporal_operator() {
    for text in ["a", "true", "not (a > 0 and abs(b) < 3) iff a == b"] {
        assert!(Formula::parse(text).unwrap().is_state_predicate(), "{text}");
    }
    for text in ["always a", "a > 0 and next b", "rise(a)", "a since b", "prev a > 0"] {
        assert!(!Formula::parse(text).unwrap().is_state_predicate(), "{text}");
    }
}

#[test]
fn nesting_beyond_the_limit_is_an_error_and_not_a_stack_overflow() {
    let deep = |levels: usize| format!("{}a{}", "(b and ".repeat(levels), ")".repeat(levels));
    assert!(Formula::parse(&deep(63)).is_ok());
    assert!(Formula::parse(&deep(64)).is_err());
    let error = Formula::parse(&deep(20_000)).unwrap_err();
    assert!(matches!(error, ParseError::TooDeep { limit: 64, .. }), "{error}");
    // Nesting that needs no additional buffer has no limit.
    let names = ["a".to_owned()];
    let mut trace = Trace::new(names.clone().into());
    trace.push(&[2.0]);
    let wrapped = format!("{}a{}", "(not ".repeat(40_000), ")".repeat(40_000));
    for text in [wrapped, vec!["a > 0"; 20_000].join(" and "), vec!["a"; 20_000].join(" -> ")] {
        let formula = Formula::parse(&text).unwrap();
        assert_eq!(Formula::parse(&formula.to_string()).as_ref(), Ok(&formula));
        let mut monitor = Monitor::new(&formula, &names, Clock::steps(CONTROL_DT)).unwrap();
        assert_eq!(monitor.robustness(&trace), Ok(2.0));
    }
}

#[test]
fn exponential_growth_by_named_sub_formulas_is_an_error() {
    let mut text = "p0 = a > 0;".to_owned();
    for i in 0..40 {
        text += &format!("p{} = p{i} and p{i};", i + 1);
    }
    let error = Formula::parse(&format!("{text} p40")).unwrap_err();
    assert!(matches!(error, ParseError::TooLong { .. }), "{error}");
}

#[test]
fn all_named_sub_formulas_count_together() {
    // p(i + 1) has 2 p(i) + 1 operators and operands, so p(i) has 4 · 2^i - 1: p10 4,095, and p0 to
    // p9 together 4,082.
    let mut text = "p0 = a > 0;".to_owned();
    for i in 0..10 {
        text += &format!("p{} = p{i} and p{i};", i + 1);
    }
    // p10, 29 more names and the formula itself: 4,082 + 31 · 4,095 = 131,027.
    for i in 0..29 {
        text += &format!("q{i} = p10;");
    }
    assert!(Formula::parse(&format!("{text} p10")).is_ok());
    let error = Formula::parse(&format!("{text} q29 = p10; p10")).unwrap_err();
    assert!(matches!(error, ParseError::TooLong { limit: 131_072, .. }), "{error}");
}

#[test]
fn a_text_beyond_the_limit_is_an_error() {
    let text = |bytes: usize| format!("a > 0{}", " ".repeat(bytes - 5));
    assert!(Formula::parse(&text(1 << 18)).is_ok());
    let error = Formula::parse(&text((1 << 18) + 1)).unwrap_err();
    assert_eq!(error.to_string(), "the formula has 262145 bytes; at most 262144 are allowed");
}

#[test]
fn a_message_lists_at_most_50_signals() {
    let names: Vec<String> = (0..80_000).map(|i| format!("s{i}")).collect();
    let error = Monitor::new(&Formula::parse("x > 0").unwrap(), &names, Clock::steps(1.0)).unwrap_err();
    assert!(error.to_string().ends_with("s48, s49 and 79950 more"), "{error}");
}

fn trace_of(name: &str, values: &[f64]) -> Trace {
    let mut trace = Trace::new(Arc::from([name.to_owned()]));
    values.iter().for_each(|value| trace.push(&[*value]));
    trace
}

/// Returns the robustness signal of `text` on the signal `d` with these samples.
fn evaluate(text: &str, d: &[f64]) -> Result<Vec<f64>, MonitorError> {
    let trace = trace_of("d", d);
    let mut monitor = Monitor::new(&Formula::parse(text).unwrap(), trace.names(), Clock::steps(0.5))?;
    monitor.robustness_signal(&trace).map(<[f64]>::to_vec)
}

#[test]
fn an_unknown_signal_is_reported_with_the_known_ones_and_a_suggestion() {
    let known = ["cube_height".to_owned(), "cube_speed".to_owned()];
    let formula = Formula::parse("always(cube_hight > 0)").unwrap();
    let error = Monitor::new(&formula, &known, Clock::steps(CONTROL_DT)).unwrap_err();
    assert_eq!(
        error.to_string(),
        "signal `cube_hight` is not in the trace; known signals: cube_height, cube_speed"
    );
    assert!(
        matches!(error, MonitorError::UnknownSignal { nearest: Some(name), .. } if name == "cube_height")
    );
    let error = Monitor::new(&formula, &[], Clock::steps(CONTROL_DT)).unwrap_err();
    assert_eq!(error.to_string(), "signal `cube_hight` is not in the trace; known signals: no signals");
}

#[test]
fn a_bound_between_two_samples_is_reported_with_the_period() {
    let check = |text: &str, clock: Clock, message: &str| {
        let error = Monitor::new(&Formula::parse(text).unwrap(), &["d".to_owned()], clock).unwrap_err();
        assert_eq!(error.to_string(), message, "{text}");
    };
    let control = Clock::steps(CONTROL_DT);
    let steps = "steps of 0.016666666666666666 s; it must be a whole number of steps";
    check("always[0:0.01s] d", control, &format!("bound 0.01 s of `always` is 0.6 {steps}"));
    check("d until[0:0.5] d", control, &format!("bound 0.5 (steps) of `until` is 0.5 {steps}"));
    let rtamt = Clock::rtamt(0.1, TimeUnit::Seconds);
    check(
        "once[0:0.25] d",
        rtamt,
        "bound 0.25 s of `once` is 2.5 steps of 0.1 s; it must be a whole number of steps",
    );
    for period in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        check(
            "d",
            Clock::steps(period),
            &format!("the sampling period is {period} s; it must be positive and finite"),
        );
    }
}

#[test]
fn samples_that_are_not_finite_are_reported_with_their_time() {
    let message = |d: &[f64]| evaluate("d > 0", d).unwrap_err().to_string();
    assert_eq!(
        message(&[0.0, f64::NAN]),
        "signal `d` is NaN at step 1 (t = 0.5 s); every sample must be finite"
    );
    let infinite = [0.0, 0.0, f64::NEG_INFINITY];
    assert_eq!(message(&infinite), "signal `d` is -inf at step 2 (t = 1 s); every sample must be finite");
    assert_eq!(message(&[]), "the trace is empty; it must have at least one sample");
    // A signal that the formula does not read may have any value.
    let names: Arc<[String]> = ["d", "e"].map(String::from).into();
    let mut trace = Trace::new(Arc::clone(&names));
    trace.push(&[1.0, f64::NAN]);
    let mut monitor = Monitor::new(&Formula::parse("d").unwrap(), &names, Clock::steps(1.0)).unwrap();
    assert_eq!(monitor.robustness(&trace), Ok(1.0));
}

#[test]
fn arithmetic_without_a_finite_value_is_reported_with_its_operands() {
    let message = |text: &str| evaluate(text, &[1.0, 0.0]).unwrap_err().to_string();
    assert_eq!(message("2 / d > 0"), "`2 / 0` has no finite value at step 1 (t = 0.5 s)");
    assert_eq!(message("sqrt(d - 1) > 0"), "`sqrt(-1)` has no finite value at step 1 (t = 0.5 s)");
    assert_eq!(message("ln(d) > 0"), "`ln(0)` has no finite value at step 1 (t = 0.5 s)");
    assert_eq!(message("pow(d, -1) > 0"), "`pow(0, -1)` has no finite value at step 1 (t = 0.5 s)");
    assert_eq!(message("exp(1000 * d) > 0"), "`exp(1000)` has no finite value at step 0 (t = 0 s)");
    // Infinities from truncated windows are values, but arithmetic on them can also have no value.
    assert_eq!(evaluate("1 + (always[5:6] d) > 0", &[1.0]), Ok(vec![f64::INFINITY]));
    assert!(evaluate("(always[5:6] d) * 0 > 0", &[1.0]).is_err());
}

#[test]
fn a_trace_of_other_signals_is_an_error() {
    let mut monitor =
        Monitor::new(&Formula::parse("d > 0").unwrap(), &["d".to_owned()], Clock::steps(1.0)).unwrap();
    assert_eq!(monitor.robustness(&trace_of("d", &[1.0])), Ok(1.0));
    let error = monitor.robustness(&trace_of("e", &[1.0])).unwrap_err();
    assert_eq!(error.to_string(), "expected `d` as signal 0 of the trace, found the signals: e");
    assert_eq!(monitor.robustness(&trace_of("d", &[3.0])), Ok(3.0));
}

#[test]
#[should_panic(expected = "one value per signal")]
fn a_sample_of_the_wrong_length_panics() {
    Trace::new(Arc::from(["d".to_owned()])).push(&[1.0, 2.0]);
}

#[test]
fn a_bound_beyond_the_limit_is_an_error_and_horizons_do_not_overflow() {
    let names = ["d".to_owned()];
    let horizon = |text: &str| {
        Monitor::new(&Formula::parse(text).unwrap(), &names, Clock::steps(1.0))
            .map(|monitor| monitor.horizon())
    };
    // 2^64 - 2048, 2^64 and beyond; the next number above 2^43.
    for bound in ["18446744073709549568", "18446744073709551616", "1e300", "8796093022209"] {
        for text in [format!("always[0:{bound}] d"), format!("d until[{bound}:inf] d")] {
            let error = horizon(&text).unwrap_err();
            assert!(matches!(error, MonitorError::BoundTooLarge { .. }), "{text}: {error}");
        }
    }
    assert_eq!(
        horizon("always[0:1e16] d").unwrap_err().to_string(),
        "bound 1e16 (steps) of `always` is 1e16 samples, more than any trace has; write `inf` for an unbounded \
         interval"
    );
    // The largest bound times the largest nesting depth does not overflow.
    let latest = 1_usize << 43;
    assert_eq!(horizon(&format!("always[0:{latest}] d")), Ok(Some(latest)));
    let nested = format!("{}d", format!("always[0:{latest}] ").repeat(1000));
    assert_eq!(horizon(&nested), Ok(Some(1000 * latest)));
    assert_eq!(horizon("always[0:inf] d"), Ok(None));
}

#[test]
fn an_assignment_in_place_of_a_comparison_is_an_error() {
    let names = ["ball_speed".to_owned()];
    check(
        "ball_sped = 0.1",
        1,
        "column 1: `ball_sped = ...` defines a number, but the last statement must be a formula; did you mean `==`?",
    );
    check(
        "p = 1; q = -p * 2",
        8,
        "column 8: `q = ...` defines a number, but the last statement must be a formula; did you mean `==`?",
    );
    let found = "expected an operator or `)` to match the `(` at column 7, found `=`; did you mean `==`?";
    check("always(ball_speed = 0.1)", 19, &format!("column 19: {found}"));
    let monitor = |text: &str| Monitor::new(&Formula::parse(text).unwrap(), &names, Clock::steps(1.0));
    for text in
        ["ball_speed = abs(v)", "ball_speed = 3; always ball_speed", "const float ball_speed = 3 true"]
    {
        let error = monitor(text).unwrap_err().to_string();
        assert!(
            error.contains("`ball_speed = ...`") && error.contains("did you mean `==`?"),
            "{text}: {error}"
        );
    }
    // The usual form of a formula in RTAMT.
    assert!(monitor("out = ball_speed <= 0.1").is_ok());
    assert!(monitor("limit = 0.1; out = ball_speed <= limit").is_ok());
}

#[test]
fn chained_comparisons_are_detected() {
    let chains = |text: &str| Formula::parse(text).unwrap().chains_comparisons();
    for text in ["0.2 <= v <= 0.3", "always(1 < v - 2 >= w)", "a and b > c > d or e"] {
        assert!(chains(text), "{text}");
    }
    for text in ["0.2 <= v and v <= 0.3", "v <= (w <= 3)", "(a < b) == (c < d)", "a", "1 < 2"] {
        assert!(!chains(text), "{text}");
    }
    // As in RTAMT: 0.3 - (v - 0.2).
    assert_eq!(evaluate("0.2 <= v <= 0.3".replace('v', "d").as_str(), &[0.0]), Ok(vec![0.5]));
}

#[test]
fn the_sub_formulas_of_the_longest_formula_are_counted_without_writing_them() {
    // 2^16 operands and 2^16 - 1 operators. The texts of all sub-formulas together have 13 GB.
    let formula = Formula::parse(&format!("{}a", "a&".repeat((1 << 16) - 1))).unwrap();
    let started = processor_secs();
    assert_eq!(formula.subformulas().len(), (1 << 17) - 1);
    assert!(processor_secs() - started < 5.0, "{} s", processor_secs() - started);
}
