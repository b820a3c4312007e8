//! Each supported operator against ONNX's reference evaluator: `tests/golden/onnx/make.py` runs it
//! and writes the golden file.

use crate::onnx::layout;
use mishandle_interchange::OnnxPolicy;
use mishandle_rollout::Controller;
use serde::Deserialize;

#[derive(Deserialize)]
struct Case {
    operator: String,
    opset: i64,
    numbers: String,
    /// The result; without one, the model is refused.
    expected: Option<String>,
    /// A part of the message.
    refused: Option<String>,
    model: String,
}

fn cases() -> Vec<Case> {
    serde_json::from_str(include_str!("golden/onnx/operators.json")).unwrap()
}

fn numbers(text: &str) -> Vec<f32> {
    text.split(' ').map(|number| number.parse().unwrap()).collect()
}

fn base64(text: &str) -> Vec<u8> {
    let digit = |c: u8| match c {
        b'A'..=b'Z' => u32::from(c - b'A'),
        b'a'..=b'z' => u32::from(c - b'a') + 26,
        b'0'..=b'9' => u32::from(c - b'0') + 52,
        b'+' => 62,
        _ => 63,
    };
    let digits = text.trim_end_matches('=').as_bytes();
    let group = |group: &[u8]| {
        let bits = group.iter().fold(0, |bits, c| bits << 6 | digit(*c)) << (6 * (4 - group.len()));
        bits.to_be_bytes()[1..group.len()].to_vec()
    };
    digits.chunks(4).flat_map(group).collect()
}

/// Returns what differs from the expectation.
fn difference(case: &Case) -> Option<String> {
    let observation = numbers(&case.numbers);
    let expected = case.expected.as_deref().map(numbers).unwrap_or_default();
    let layout = layout(observation.len(), expected.len().max(1));
    let policy = OnnxPolicy::from_bytes(&base64(&case.model), None, &["test"], &layout);
    if let Some(refused) = &case.refused {
        let found = policy.map_or_else(|error| error.to_string(), |_| "runs".to_string());
        return (!found.contains(refused)).then(|| format!("{found}; expected {refused}"));
    }
    let policy = match policy {
        Ok(policy) => policy,
        Err(error) => return Some(error.to_string()),
    };
    let mut found = vec![0.0; expected.len()];
    policy.worker().act(1, &observation, &mut [], &mut found);
    let is_near = |(found, expected): (&f32, &f32)| {
        found == expected
            || (found.is_nan() && expected.is_nan())
            || (found - expected).abs() <= 2e-6 + 2e-6 * expected.abs()
    };
    let differs: Vec<String> = found
        .iter()
        .zip(&expected)
        .filter(|pair| !is_near(*pair))
        .map(|(found, expected)| format!("{found} for {expected}"))
        .collect();
    (!differs.is_empty()).then(|| differs.join(", "))
}

#[test]
fn every_operator_computes_what_the_standard_says() {
    let found: Vec<String> = cases()
        .iter()
        .filter_map(|case| Some(format!("{} of opset {}: {}", case.operator, case.opset, difference(case)?)))
        .collect();
    assert!(found.is_empty(), "{} cases differ:\n{}", found.len(), found.join("\n"));
}
