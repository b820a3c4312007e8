//! Scenarios and values of axes, as text.

use mishandle::results::{AxisFacts, AxisValues, Scenario};
use mishandle::rollout::{self, Axis, AxisKind};

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

/// Formats an axis and its value.
pub fn axis_text(axis: &AxisFacts, value: Option<f64>) -> String {
    escape::name(&mishandle::verdict::axis_text(axis, value))
}

/// Formats a value of an axis.
pub fn value_text(axis: &AxisFacts, value: Option<f64>) -> String {
    escape::name(&mishandle::verdict::value_text(axis, value))
}
