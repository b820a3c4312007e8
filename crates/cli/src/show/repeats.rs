//! Repeated simulations of a scenario, as text.

use mishandle::results::{Estimate, Repeats};
use mishandle_text::plural;

/// Describes how often repeated simulations fail, such as `fails in 188 of 2,000 repeats: 9.4 % [8.2, 10.8]`.
pub fn failure_text(report: &Repeats) -> String {
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
