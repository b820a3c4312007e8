//! Repeated simulations of a scenario, as text and as JSON.

use mishandle::evaluation::{Estimate, QUANTILES, RepeatReport};
use mishandle::plural;
use serde_json::{Value, json};

use super::output::{self, number};

/// Returns the JSON of repeated simulations.
pub fn document(report: &RepeatReport) -> Value {
    let quantiles = |values: [f64; QUANTILES.len()]| {
        let named =
            QUANTILES.iter().zip(values).map(|(p, value)| json!({ "p": p, "robustness": number(value) }));
        named.collect::<Vec<_>>()
    };
    json!({
        "simulations": report.simulations,
        "failures": report.failures,
        "failure_rate": output::estimate(&report.failure_rate),
        "quantiles": report.quantiles.map(quantiles),
    })
}

/// Describes how often repeated simulations fail, such as `fails in 188 of 2,000 repeats: 9.4 % [8.2, 10.8]`.
pub fn failure_text(report: &RepeatReport) -> String {
    let Estimate { value, low, high, n } = report.failure_rate;
    let percent = |value: Option<f64>| 100.0 * value.unwrap_or(f64::NAN);
    match n {
        0 => "no repeat has a verdict".to_string(),
        _ => format!(
            "fails in {} of {}: {:.1} % [{:.1}, {:.1}]",
            report.failures,
            plural(n, "repeat"),
            percent(value),
            percent(low),
            percent(high)
        ),
    }
}
