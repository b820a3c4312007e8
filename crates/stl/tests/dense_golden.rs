//! Agreement with RTAMT in dense time: `tests/golden/rtamt_dense/make.py` runs RTAMT and writes the
//! golden file.

use mishandle_stl::{DenseMonitor, DenseSignal, Formula, Interpolation, TimeUnit};
use serde_json::Value;

/// Parses numbers separated by spaces, exactly.
fn numbers(value: &Value) -> Vec<f64> {
    value.as_str().unwrap().split(' ').map(|number| number.parse().unwrap()).collect()
}

/// Exact, except for `exp` and `pow`, whose last bits depend on the math library.
fn is_close(text: &str, got: f64, expected: f64) -> bool {
    let is_exact = !text.contains("exp(") && !text.contains("pow(");
    got == expected || (!is_exact && (got - expected).abs() <= 1e-12 * expected.abs().max(1.0))
}

/// RTAMT holds the last values forever, and we cut windows: the values are equal where no window is
/// cut.
#[test]
fn robustness_equals_that_of_rtamt_where_windows_are_inside_the_log() {
    let cases: Vec<Value> = serde_json::from_str(include_str!("golden/rtamt_dense/values.json")).unwrap();
    let names = ["a", "b", "c"].map(String::from);
    let mut compared = 0;
    let mut wrong = Vec::new();
    let mut decided = 0;
    let mut missing = 0;
    for case in &cases {
        let text = case["formula"].as_str().unwrap();
        let signals: Vec<DenseSignal> = names
            .iter()
            .zip(case["signals"].as_array().unwrap())
            .map(|(name, samples)| {
                let times = numbers(&samples[0]);
                let values = numbers(&samples[1]);
                DenseSignal::new(name.as_str(), times, values, Interpolation::Hold).unwrap()
            })
            .collect();
        let formula = Formula::parse(text).unwrap();
        let monitor = DenseMonitor::new(&formula, &names, Some(TimeUnit::Seconds)).unwrap();
        let found = monitor.decided_robustness_signal(&signals).unwrap();
        let Some((start, end)) = found.domain() else { continue };
        decided += 1;
        let times = numbers(&case["robustness"][0]);
        let values = numbers(&case["robustness"][1]);
        // All times are multiples of 1/8 s, so that values in the middle of two multiples are those
        // between them.
        let steps = ((end - start) * 16.0) as usize;
        for time in (0..=steps).map(|step| start + step as f64 / 16.0) {
            let index = times.partition_point(|known| *known <= time);
            if index == 0 {
                // RTAMT loses the start of a result of `since` that is −∞, and of all that contains
                // it.
                assert!(text.contains("since"), "{text} has no value at {time}: {case}");
                missing += 1;
                continue;
            }
            let got = found.at(time).unwrap();
            let expected = values[index - 1];
            compared += 1;
            if !is_close(text, got, expected) {
                wrong.push(format!("{text} at {time}: {got}, not {expected} in {case}"));
                break;
            }
        }
    }
    assert!(wrong.is_empty(), "{} of {} differ:\n{}", wrong.len(), cases.len(), wrong.join("\n"));
    assert!(decided >= 250 && compared > 3_000 && missing < 100, "{decided} {compared} {missing}");
}
