//! Scenarios and values of axes, as text and as JSON.

use mishandle::decimal;
use mishandle::rollout::{Axis, AxisValues};
use mishandle::store::AxisRecord;
use serde_json::{Value, json};

use super::escape;

/// Formats a number of axes.
pub fn axes(count: usize) -> String {
    if count == 1 { "1 axis".to_string() } else { format!("{count} axes") }
}

/// Returns a scenario as JSON: value by axis name.
pub fn document(axes: &[Axis], values: &[Option<f64>]) -> Value {
    let entries = axes.iter().zip(values).map(|(axis, value)| (axis.name.clone(), json!(value)));
    Value::Object(entries.collect())
}

/// Number of values in the summary of a scenario.
const SUMMARY_VALUES: usize = 4;

/// Formats a scenario for a table: all its values if they are few, otherwise the values farthest from nominal.
pub fn summary(axes: &[Axis], values: &[Option<f64>]) -> String {
    format(axes, values, SUMMARY_VALUES)
}

/// Formats all values of a scenario.
pub fn text(axes: &[Axis], values: &[Option<f64>]) -> String {
    format(axes, values, usize::MAX)
}

fn format(axes: &[Axis], values: &[Option<f64>], max_values: usize) -> String {
    let mut shown: Vec<(usize, &Axis, f64)> = (0..)
        .zip(axes.iter().zip(values))
        .filter_map(|(index, (axis, value))| Some((index, axis, (*value)?)))
        .collect();
    // ", and 1 more" would be as long as the value itself.
    let omitted = if shown.len() > max_values.saturating_add(1) { shown.len() - max_values } else { 0 };
    if omitted > 0 {
        let distance = |(_, axis, value): &(usize, &Axis, f64)| {
            (axis.unit_coordinate(*value) - axis.unit_coordinate(axis.nominal.unwrap_or_default())).abs()
        };
        shown.sort_by(|a, b| distance(b).total_cmp(&distance(a)));
        shown.truncate(max_values);
        shown.sort_by_key(|(index, ..)| *index);
    }
    let value = |(_, axis, value): &(usize, &Axis, f64)| axis_text(axis, Some(*value));
    let values: Vec<String> = shown.iter().map(value).collect();
    let rest = if omitted > 0 { format!(", and {omitted} more") } else { String::new() };
    values.join(", ") + &rest
}

/// Formats the first values of a recorded scenario.
pub fn recorded_text(axes: &[AxisRecord], values: &[Option<f64>], max_values: usize) -> String {
    let named = axes.iter().zip(values).take(max_values);
    let values: Vec<String> =
        named.map(|(axis, value)| axis_text(&mishandle::recorded_axis(axis), *value)).collect();
    let omitted = axes.len().saturating_sub(max_values);
    let rest = if omitted > 0 { format!(", and {omitted} more") } else { String::new() };
    values.join(", ") + &rest
}

pub fn axis_text(axis: &Axis, value: Option<f64>) -> String {
    axis_value(&escape::name(&axis.name), &value_text(axis, value), &escape::name(&axis.unit))
}

/// Formats a value of an axis: the name of a category, an integer, or a number with four decimals.
pub fn value_text(axis: &Axis, value: Option<f64>) -> String {
    match (value, &axis.values) {
        (None, _) => "random".to_string(),
        (Some(value), AxisValues::Categorical(names)) => {
            let name = names.get((value - axis.low) as usize);
            name.map_or(value.to_string(), |name| escape::name(name))
        }
        (Some(value), _) if axis.levels().is_some() && value.abs() < 1e9 => value.to_string(),
        (Some(value), _) => decimal(value, 4),
    }
}

/// Formats the value of an axis with its unit: `gap = 1.5 m`, `delay = 1 control step`.
pub fn axis_value(name: &str, value: &str, unit: &str) -> String {
    // Other units are symbols: `s` is seconds.
    let unit = if value == "1" && unit.ends_with("steps") { unit.trim_end_matches('s') } else { unit };
    format!("{name} = {value} {unit}").trim_end().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_unit_of_counted_things_is_singular_after_1() {
        assert_eq!(axis_value("delay", "1", "control steps"), "delay = 1 control step");
        assert_eq!(axis_value("delay", "2", "control steps"), "delay = 2 control steps");
        assert_eq!(axis_value("time", "1", "s"), "time = 1 s");
        assert_eq!(axis_value("scale", "1", ""), "scale = 1");
    }
}
