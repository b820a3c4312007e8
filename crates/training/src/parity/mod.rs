//! Compares single updates with those of skrl 0.10.2, under the settings base `skrl-0.10`.

mod off_policy;
mod on_policy;

use serde_json::Value;

fn number(value: &Value, key: &str) -> f64 {
    value[key].as_f64().unwrap_or_else(|| panic!("`{key}` is not a number"))
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

fn singles(value: &Value) -> Vec<f32> {
    numbers(value).into_iter().map(|x| x as f32).collect()
}

#[track_caller]
fn close(what: &str, found: &[f32], expected: &Value) {
    close_within(1e-5, what, found, expected);
}

#[track_caller]
fn close_within(tolerance: f64, what: &str, found: &[f32], expected: &Value) {
    let expected = numbers(expected);
    assert_eq!(found.len(), expected.len(), "{what}");
    for (i, (found, expected)) in found.iter().zip(expected).enumerate() {
        let error = (f64::from(*found) - expected).abs();
        assert!(error < tolerance * expected.abs().max(1.0), "{what} {i}: found {found}, skrl {expected}");
    }
}
