//! Formulas as text, and monitors of them.

use std::sync::Arc;

use mishandle::stl::{Clock, Formula, Monitor, ParseError, Trace};

use crate::bytes::Bytes;

/// Checks the laws:
/// - the position of an error is in the text;
/// - a printed formula parses to the same formula and prints the same text. Named sub-formulas are
///   expanded, so the printed text can exceed a limit that the input does not;
/// - robustness is never NaN, and the robustness at time 0 is the first value of the robustness
///   signal;
/// - the robustness has parts, or the decided robustness signal has an error, too.
pub fn check(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let formula = match Formula::parse(text) {
        Ok(formula) => formula,
        Err(error) => return check_position(text, &error),
    };
    let printed = formula.to_string();
    match Formula::parse(&printed) {
        Ok(again) => {
            assert_eq!(again, formula, "printed as {printed}");
            assert_eq!(again.to_string(), printed);
        }
        Err(error) => {
            assert!(printed.len() > text.len() && is_limit(&error), "{error} in {printed}");
        }
    }
    check_values(&formula, bytes);
}

fn is_limit(error: &ParseError) -> bool {
    matches!(error, ParseError::TooDeep { .. } | ParseError::TooLong { .. })
}

fn check_position(text: &str, error: &ParseError) {
    let position = error.position();
    let line = text.split('\n').nth(position.line - 1).expect("the line of an error exists");
    assert!((1..=line.chars().count() + 1).contains(&error.column()), "{error}");
}

/// Evaluates the formula on a trace whose values are made from the text.
fn check_values(formula: &Formula, bytes: &[u8]) {
    let names: Arc<[String]> = formula.signals().iter().map(ToString::to_string).collect();
    let Ok(mut monitor) = Monitor::new(formula, &names, Clock::steps(1.0 / 60.0)) else { return };
    let mut bytes = Bytes(bytes);
    let mut trace = Trace::new(Arc::clone(&names));
    for _ in 0..1 + bytes.below(12) {
        let sample: Vec<f64> = names.iter().map(|_| f64::from(bytes.next()) / 4.0 - 20.0).collect();
        trace.push(&sample);
    }
    let first = monitor.robustness(&trace).ok();
    let signal = monitor.robustness_signal(&trace).map(<[f64]>::to_vec).ok();
    if let Some(signal) = &signal {
        assert_eq!(signal.len(), trace.len());
        assert!(signal.iter().all(|value| !value.is_nan()), "{signal:?}");
        assert_eq!(first, signal.first().copied(), "of {signal:?}");
    }
    let is_decided = monitor.decided_robustness_signal(&trace).is_ok();
    let decomposition = formula.decompose(&Clock::steps(1.0 / 60.0), trace.len(), 16);
    let decomposition = decomposition.expect("a formula with a monitor");
    assert_eq!(monitor.parts(&trace, &decomposition).is_ok(), is_decided);
}

pub fn seeds() -> Vec<Vec<u8>> {
    let texts = [
        "always[50:300](finger_target_distance <= 0.12)",
        "eventually[0:270](always[0:30](d <= 0.024 and h >= 0.045 and h <= 0.055 and v <= 0.05))",
        "G[0,30] d<=0.3 & v<1 | !(w -> x <-> y xor z)",
        "const float limit = 0.3; near = d <= limit; out = (near until[0s:5s] near) or a == b",
        "input float a; b = abs(a) + sqrt(a) * exp(a) / ln(a) - pow(a, 2); b >= -1 and b !== 2",
        "historically[0:2] a > 0 since[1:inf] once b < 1_000e-3 release[0:4] c unless d",
        "next prev s_next s_prev rise(a) implies fall(b) // comment\n /* more */ iff true and false",
        "0.2 <= v <= 0.3",
        "a = b and b; c = a and a; d = c and c; d and d",
        "F[1:100ms] (x >= inf)",
        "p = `a/b[0]` > 1\r\n`q``r` = x - y // c\n`q``r` > 0 and p",
        "input float x\nconst int k = 2\np = x > k\n(p) R[0:k] `R`\n;",
    ];
    texts.iter().map(|text| text.as_bytes().to_vec()).collect()
}
