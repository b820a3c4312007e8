//! Scenarios and values of axes, as text.

use mishandle::results::{AxisFacts, AxisValues, Scenario};
use mishandle::rollout::{self, Axis, AxisKind};
use mishandle_text::decimal;

use super::escape;

/// Formats a number of axes.
pub fn axes(count: usize) -> String {
    if count == 1 { "1 axis".to_string() } else { format!("{count} axes") }
}

/// Number of values in the summary of a scenario.
const SUMMARY_VALUES: usize = 4;

/// Formats a scenario for a table: all its values if they are few, otherwise the values farthest
/// from nominal.
pub fn summary(axes: &[AxisFacts], scenario: &Scenario) -> String {
    format(axes.iter().zip(scenario.values().copied()), SUMMARY_VALUES)
}

/// Formats the values of a scenario that are not drawn at random.
pub fn text<'a>(values: impl IntoIterator<Item = (&'a AxisFacts, Option<f64>)>) -> String {
    format(values, usize::MAX)
}

fn format<'a>(values: impl IntoIterator<Item = (&'a AxisFacts, Option<f64>)>, max_values: usize) -> String {
    let values: Vec<(&AxisFacts, Option<f64>)> = values.into_iter().collect();
    let mut shown: Vec<(usize, &AxisFacts, f64)> = values
        .iter()
        .enumerate()
        .filter(|(_, (axis, _))| has_effect(axis, &values))
        .filter_map(|(index, (axis, value))| Some((index, *axis, (*value)?)))
        .collect();
    if shown.is_empty() && values.iter().any(|(_, value)| value.is_some()) {
        return "nominal".to_string();
    }
    // ", and 1 more" would be as long as the value itself.
    let omitted = if shown.len() > max_values.saturating_add(1) { shown.len() - max_values } else { 0 };
    if omitted > 0 {
        let distance = |(_, axis, value): &(usize, &AxisFacts, f64)| {
            let scale = scale(axis);
            (scale.unit_coordinate(*value) - scale.unit_coordinate(axis.nominal.unwrap_or_default())).abs()
        };
        shown.sort_by(|a, b| distance(b).total_cmp(&distance(a)));
        shown.truncate(max_values);
        shown.sort_by_key(|(index, ..)| *index);
    }
    let value = |(_, axis, value): &(usize, &AxisFacts, f64)| axis_text(axis, Some(*value));
    let values: Vec<String> = shown.iter().map(value).collect();
    let rest = if omitted > 0 { format!(", and {omitted} more") } else { String::new() };
    values.join(", ") + &rest
}

/// Returns whether an axis has an effect with the values of the others. Without one, it is nominal
/// whatever the search chose.
fn has_effect(axis: &AxisFacts, values: &[(&AxisFacts, Option<f64>)]) -> bool {
    axis.has_effect(|name| values.iter().find(|(other, _)| other.name == name).and_then(|(_, value)| *value))
}

/// Returns an axis with the bounds and the scale that the facts describe.
fn scale(axis: &AxisFacts) -> Axis {
    let values = match &axis.values {
        AxisValues::Categories(names) => rollout::AxisValues::Categorical(names.clone().into()),
        AxisValues::Kind(kind) => match kind.as_str() {
            "logarithmic" => rollout::AxisValues::Logarithmic,
            "integer" => rollout::AxisValues::Integer,
            _ => rollout::AxisValues::Continuous,
        },
    };
    let bounds = [axis.low, axis.high];
    Axis::new(AxisKind::Start, &axis.name, &axis.unit, bounds, axis.nominal).with_values(values)
}

/// Formats the first values of a scenario, also those that are drawn at random.
pub fn first_text(axes: &[AxisFacts], scenario: &Scenario, max_values: usize) -> String {
    let all: Vec<(&AxisFacts, Option<f64>)> = axes.iter().zip(scenario.values().copied()).collect();
    let shown: Vec<_> = all.iter().filter(|(axis, _)| has_effect(axis, &all)).collect();
    let values: Vec<String> =
        shown.iter().take(max_values).map(|(axis, value)| axis_text(axis, *value)).collect();
    let omitted = shown.len().saturating_sub(max_values);
    let rest = if omitted > 0 { format!(", and {omitted} more") } else { String::new() };
    values.join(", ") + &rest
}

pub fn axis_text(axis: &AxisFacts, value: Option<f64>) -> String {
    axis_value(&escape::name(&axis.name), &value_text(axis, value), &escape::name(&axis.unit))
}

/// Formats a value of an axis: the name of a category, an integer, or a number with four decimals.
pub fn value_text(axis: &AxisFacts, value: Option<f64>) -> String {
    match (value, &axis.values) {
        (None, _) => "random".to_string(),
        (Some(value), AxisValues::Categories(names)) => {
            let name = names.get((value - axis.low) as usize);
            name.map_or(value.to_string(), |name| escape::name(name))
        }
        (Some(value), _) if axis.is_discrete() && value.abs() < 1e9 => value.to_string(),
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
