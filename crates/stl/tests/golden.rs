//! Agreement with RTAMT: `tests/golden/rtamt/make.py` runs RTAMT and writes the golden files.

use mishandle_stl::{Clock, Formula, Monitor, TimeUnit, Trace};
use serde_json::Value;
use std::sync::Arc;

fn rows(file: &str) -> Vec<Value> {
    serde_json::from_str(file).unwrap()
}

/// Parses numbers separated by spaces, exactly.
fn numbers(value: &Value) -> Vec<f64> {
    value.as_str().unwrap().split(' ').map(|number| number.parse().unwrap()).collect()
}

fn trace_of(columns: &[Vec<f64>]) -> Trace {
    let names: Arc<[String]> = ["a", "b", "c"].map(String::from).into();
    let mut trace = Trace::new(names);
    for ((a, b), c) in columns[0].iter().zip(&columns[1]).zip(&columns[2]) {
        trace.push(&[*a, *b, *c]);
    }
    trace
}

/// Returns the text with words for operators that are letters in front of a number, as in `H -3 <=
/// c`, which is `H - 3` to a reader and an error here.
fn without_letters(text: &str) -> String {
    let words = [
        ("G", "always"),
        ("F", "eventually"),
        ("H", "historically"),
        ("O", "once"),
        ("Y", "prev"),
        ("X", "next"),
        ("sY", "s_prev"),
        ("sX", "s_next"),
    ];
    let is_part = |c: char| c.is_alphanumeric() || c == '_';
    let mut out = String::new();
    let mut rest = text;
    while !rest.is_empty() {
        let end = rest.find(|c| !is_part(c)).unwrap_or(rest.len()).max(1);
        let (word, after) = rest.split_at(end);
        let is_before_number =
            after.trim_start().starts_with(|c: char| c == '-' || c == '.' || c.is_ascii_digit());
        let letter = words.iter().find(|(letter, _)| *letter == word && is_before_number);
        out += letter.map_or(word, |(_, word)| word);
        rest = after;
    }
    out
}

/// Exact, except for `exp` and `pow`, whose last bits depend on the math library.
fn is_close(text: &str, got: f64, expected: f64) -> bool {
    let is_exact = !text.contains("exp(") && !text.contains("pow(");
    got == expected || (!is_exact && (got - expected).abs() <= 1e-12 * expected.abs().max(1.0))
}

fn parse(text: &str) -> Formula {
    Formula::parse(&without_letters(text)).unwrap_or_else(|error| panic!("{text}: {error}"))
}

/// Returns the trace of a case, and a monitor of `text` for its signals and clock.
fn set_up(case: &Value, text: &str) -> (Trace, Monitor) {
    let unit = TimeUnit::ALL.into_iter().find(|unit| unit.symbol() == case["unit"]).unwrap();
    let clock = Clock::rtamt(case["period_secs"].as_f64().unwrap(), unit);
    let columns: Vec<Vec<f64>> = case["trace"].as_array().unwrap().iter().map(numbers).collect();
    let trace = trace_of(&columns);
    let formula = parse(text);
    let monitor = Monitor::new(&formula, trace.names(), clock).unwrap();
    (trace, monitor)
}

#[test]
fn robustness_equals_that_of_rtamt() {
    let cases = rows(include_str!("golden/rtamt/values.json"));
    // RTAMT's `iff` is negative where both operands hold, so its sign is not the verdict.
    let has_iff = |text: &str| ["iff", "<->", "xor"].iter().any(|word| text.contains(word));
    let texts = cases.iter().map(|case| (case, case["formula"].as_str().unwrap()));
    let compared: Vec<_> = texts.filter(|(_, text)| !has_iff(text)).collect();
    assert!(compared.len() >= 300, "{}", compared.len());
    for (case, text) in compared {
        let (trace, mut monitor) = set_up(case, text);
        let expected = numbers(&case["robustness"]);
        let got = monitor.robustness_signal(&trace).unwrap().to_vec();
        let agrees = got.iter().zip(&expected).all(|(got, expected)| is_close(text, *got, *expected));
        assert!(
            agrees && got.len() == expected.len(),
            "{text} on {}: {got:?}, RTAMT has {expected:?}",
            case["trace"]
        );
        assert!(is_close(text, monitor.robustness(&trace).unwrap(), expected[0]), "{text} at time 0");
    }
}

#[test]
fn operators_have_the_precedence_of_rtamt() {
    let pairs = rows(include_str!("golden/rtamt/trees.json"));
    assert!(pairs.len() >= 300);
    for pair in &pairs {
        let text = pair[0].as_str().unwrap();
        let tree = pair[1].as_str().unwrap();
        // RTAMT's trees print the operator `prev` as `previous`.
        let tree = tree.replace("previous", "prev");
        assert_eq!(parse(text), parse(&tree), "{text} is {tree} in RTAMT");
    }
}

/// RTAMT gives `+` a higher precedence than `-`, and `*` a higher one than `/`. Here values follow
/// arithmetic.
#[test]
fn sums_and_products_associate_to_the_left_unlike_in_rtamt() {
    // At the two samples a = 8, 4; b = 2, 4; c = 4, 1/2. Columns: our values, RTAMT's values.
    let expected = [
        ("a - b + c", [10.0, 0.5], [2.0, -0.5]), // 6 + 4, 0 + 1/2; 8 - 6, 4 - 9/2
        ("a / b * c", [16.0, 0.5], [1.0, 2.0]),  // 4 · 4, 1 · 1/2; 8 / 8, 4 / 2
        ("a - b + c - a + b", [4.0, 0.5], [-8.0, -8.5]), // 10 - 8 + 2, 1/2 - 4 + 4; 8 - 6 - 10, 4 - 9/2 - 8
        ("a / b * c / a * b", [4.0, 0.5], [0.0625, 0.125]), // 16 / 8 · 2, 1/2 / 4 · 4; 8 / 8 / 16, 4 / 2 / 16
        ("a - b / c * a + c", [8.0, -27.5], [3.9375, 1.5]), // 8 - 4 + 4, 4 - 32 + 1/2; 8 - (1/16 + 4), 4 - (2 + 1/2)
        ("always(a / b * c - b + c > a)", [-7.0; 2], [-13.0, -6.5]), // 18 - 8, -3 - 4; 1 - 6 - 8, 2 - 9/2 - 4
    ];
    let cases = rows(include_str!("golden/rtamt/differences.json"));
    assert_eq!(cases.len(), expected.len());
    for (case, (text, ours, rtamts)) in cases.iter().zip(expected) {
        assert_eq!(case["formula"], text);
        let (trace, mut monitor) = set_up(case, text);
        assert_eq!(monitor.robustness_signal(&trace).unwrap(), ours, "{text}");
        assert_eq!(numbers(&case["robustness"]), rtamts, "{text} in RTAMT");

        // RTAMT parses our printed text as we do.
        assert_eq!(case["mended"], Formula::parse(text).unwrap().to_string());
        assert_eq!(numbers(&case["mended_robustness"]), ours, "{text} in RTAMT, mended");
    }
}
