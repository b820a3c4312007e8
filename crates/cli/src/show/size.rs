//! How many simulations a question takes, as text.

use mishandle::results::{Number, SampleSize};
use mishandle_text::{number_text, plural};

use super::output;

/// Returns the numbers as a table.
pub fn text(found: &SampleSize) -> String {
    let unit = if found.expected_pairs.is_some() { "pair" } else { "simulation" };
    let percent = |value: Number| format!("{} %", number_text((1e4 * value.0).round() / 100.0));
    let wish = match (&found.rate, &found.margin) {
        (Some(rate), _) => format!("decided about {}", percent(*rate)),
        (_, Some(margin)) => format!("{}, margin {}", found.until, percent(*margin)),
        _ => found.until.clone(),
    };
    let expected = match (&found.expected_rate, &found.expected_pairs) {
        (Some(rate), _) => format!("success rate {}", percent(*rate)),
        (None, Some(pairs)) => format!(
            "both succeed in {}, only A in {}, only B in {}, neither in {}",
            percent(pairs.both),
            percent(pairs.first_only),
            percent(pairs.second_only),
            percent(pairs.neither)
        ),
        (None, None) => String::new(),
    };
    let number = |value: Option<u64>| {
        value.map_or(format!("more than {}", found.max_simulations), |value| value.to_string())
    };
    let rows = [
        vec![String::new(), format!("{unit}s")],
        vec!["fixed beforehand, with 90 % power".to_string(), number(found.fixed)],
        vec!["stops by itself, median".to_string(), number(found.median)],
        vec!["stops by itself, 90 % of all".to_string(), number(found.ninety_percent)],
        vec!["stops by itself, mean".to_string(), format!("{:.0}", found.mean.0)],
    ];
    format!(
        "until {wish}; expected: {expected}\n\n{}\n\nit decides within {} in {} of {} (a look after each {}, seed {})",
        output::table(&rows),
        plural(found.max_simulations, unit),
        percent(found.decided),
        plural(found.replications, "replication"),
        plural(found.batch, unit),
        found.seed.0,
    )
}
