//! Agreement with RTAMT, by files that `tests/golden/rtamt/make.py` wrote by running it.
#![allow(clippy::unwrap_used)] // the setting for tests does not reach the helpers of test files

use mishandle_stl::{Clock, Formula, Monitor, Trace, Unit};
use serde_json::Value;
use std::sync::Arc;

fn rows(file: &str) -> Vec<Value> {
    serde_json::from_str(file).unwrap()
}

/// Numbers in a text; Rust's own parser reads each to the last bit.
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

/// Exact but for `exp` and `pow`, which may come from another mathematical library.
fn is_close(text: &str, got: f64, expected: f64) -> bool {
    let is_exact = !text.contains("exp(") && !text.contains("pow(");
    got == expected || (!is_exact && (got - expected).abs() <= 1e-12 * expected.abs().max(1.0))
}

#[test]
fn robustness_is_rtamts() {
    let cases = rows(include_str!("golden/rtamt/values.json"));
    assert!(cases.len() >= 300);
    for case in &cases {
        let text = case["formula"].as_str().unwrap();
        let unit = Unit::ALL.into_iter().find(|unit| unit.symbol() == case["unit"]).unwrap();
        let clock = Clock::rtamt(case["period_secs"].as_f64().unwrap(), unit);
        let columns: Vec<Vec<f64>> = case["trace"].as_array().unwrap().iter().map(numbers).collect();
        let trace = trace_of(&columns);

        let formula = Formula::parse(text).unwrap_or_else(|error| panic!("{text}: {error}"));
        let mut monitor = Monitor::new(&formula, trace.names(), clock).unwrap();
        let expected = numbers(&case["robustness"]);
        let got = monitor.robustness_signal(&trace).unwrap().to_vec();
        let agrees = got.iter().zip(&expected).all(|(got, expected)| is_close(text, *got, *expected));
        assert!(
            agrees && got.len() == expected.len(),
            "{text} on {columns:?}: {got:?}, RTAMT has {expected:?}"
        );
        assert!(is_close(text, monitor.robustness(&trace).unwrap(), expected[0]), "{text} at time 0");
    }
}

#[test]
fn operators_bind_as_they_do_in_rtamt() {
    let pairs = rows(include_str!("golden/rtamt/trees.json"));
    assert!(pairs.len() >= 300);
    for pair in &pairs {
        let (text, tree) = (pair[0].as_str().unwrap(), pair[1].as_str().unwrap());
        // RTAMT's trees call the operator `prev` by another name than its grammar does.
        let tree = tree.replace("previous", "prev");
        let parse = |text: &str| Formula::parse(text).unwrap_or_else(|error| panic!("{text}: {error}"));
        assert_eq!(parse(text), parse(&tree), "{text} is {tree} in RTAMT");
    }
}
