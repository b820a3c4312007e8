//! Verdicts of formulas on logs: whole windows, and formulas that a log cannot answer.

use std::io::Cursor;

use mishandle_logs::{Evaluation, LogError, OpenLog, Options, Result, Samples};
use mishandle_stl::Formula;

fn formula(text: &str) -> Formula {
    Formula::parse(text).unwrap_or_else(|error| panic!("{text}: {error}"))
}

fn samples(csv: &str, text: &str) -> Result<Samples> {
    let options = Options::default();
    let log = OpenLog::open_csv(Box::new(Cursor::new(csv.as_bytes().to_vec())), &options)?;
    let mut runs = log.samples_of_runs([&formula(text)], &options)?;
    assert_eq!(runs.len(), 1);
    Ok(runs.remove(0))
}

/// Returns the robustness with whole windows.
fn strict(csv: &str, text: &str) -> Result<f64> {
    let evaluation = Evaluation { unit: None, strict_horizon: true };
    Ok(samples(csv, text)?.verdict(&formula(text), &evaluation)?.robustness)
}

const LOG: &str = "x,z\n-1,0.5\n-1,0.5\n";

/// Before the first sample, the window of `prev` is empty and its value infinite. The other
/// conjunct decides.
#[test]
fn a_conjunct_with_an_empty_window_does_not_refuse_a_decided_formula() {
    for (text, robustness) in [
        ("prev(z >= 0) and x >= 0", -1.0),
        ("x >= 0 and prev(z >= 0)", -1.0),
        ("always(prev(z >= 0) and x >= 0)", -1.0),
        ("historically[1:2](z >= 1) and x >= -3", 2.0),
        ("x >= 0 or (s_prev(z >= 0) and prev(z >= 0))", -1.0),
    ] {
        assert_eq!(strict(LOG, text).expect(text), robustness, "{text}");
    }
    let alone = strict(LOG, "prev(z >= 0)").expect_err("no sample decides it");
    assert!(matches!(&alone, LogError::TooShort(text) if text.contains("depends on no sample")), "{alone}");
}

/// z is at least 0 up to the last sample but one; no sample has whole windows of the right operand
/// in which x is at least 5.
#[test]
fn unless_is_its_expansion_with_whole_windows() {
    let log = "x,z\n1,1\n1,1\n1,1\n1,-2\n";
    let expanded = "(always(z >= 0)) or ((z >= 0) until (eventually[0:2](x >= 5)))";
    for text in ["(z >= 0) unless (eventually[0:2](x >= 5))", expanded] {
        assert_eq!(strict(log, text).expect(text), -2.0, "{text}");
    }
}

/// Columns of robots are called X, Y and F. Read as operators, these formulas ask nothing.
#[test]
fn a_letter_that_is_a_column_is_never_read_as_an_operator() {
    for letter in ["X", "Y", "F", "G", "H", "O"] {
        let log = format!("time,{letter},v\n0,10,1\n1,10,1\n");
        assert!(Formula::parse(&format!("always({letter} - 1 <= 2)")).is_err(), "{letter}");
        let text = format!("always({letter}(v >= 0))");
        let error = samples(&log, &text).expect_err("the column has the name").to_string();
        assert!(error.contains(&format!("backquotes for the signal: `{letter}`")), "{error}");
        assert_eq!(strict(&log, &format!("always(`{letter}` - 1 <= 2)")).expect("a verdict"), -7.0);
    }
    let error = samples(LOG, "always(1 <= 2)").expect_err("it asks nothing").to_string();
    assert!(error.contains("reads no signal"), "{error}");
}
