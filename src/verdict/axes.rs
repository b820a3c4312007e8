//! Values of axes, as text.

use mishandle_results::{AxisFacts, AxisValues};
use mishandle_text::{measured, short, short_unit};

/// Largest number of characters of a name from a run file.
const NAME: usize = 80;

/// Shortens a name from a run file, of an axis, a category, a target or a controller, so that it
/// hides no other words of its sentence.
pub(super) fn shown(name: &str) -> String {
    short(name, NAME)
}

/// Formats an axis and its value: `gap = 1.5 m`.
pub fn axis_text(axis: &AxisFacts, value: Option<f64>) -> String {
    axis_value(&axis.name, &value_text(axis, value), &axis.unit)
}

/// Formats a value of an axis: the name of a category, an integer, or a number with four
/// significant digits.
pub fn value_text(axis: &AxisFacts, value: Option<f64>) -> String {
    match (value, &axis.values) {
        (None, _) => "random".to_string(),
        (Some(value), AxisValues::Categories(names)) => {
            names.get((value - axis.low) as usize).map_or_else(|| value.to_string(), |name| shown(name))
        }
        (Some(value), _) if axis.is_discrete() && value.abs() < 1e9 => value.to_string(),
        (Some(value), _) => measured(value),
    }
}

/// Formats the value of an axis with its unit: `gap = 1.5 m`, `delay = 1 control step`.
pub fn axis_value(name: &str, value: &str, unit: &str) -> String {
    // Other units are symbols: `s` is seconds.
    let unit = if value == "1" && unit.ends_with("steps") { unit.trim_end_matches('s') } else { unit };
    format!("{} = {value} {}", shown(name), short_unit(unit)).trim_end().to_string()
}

/// Formats a range of an axis: `gap from 1 to 2 m`.
pub(super) fn axis_range(name: &str, [low, high]: [String; 2], unit: &str) -> String {
    format!("{} from {low} to {high} {}", shown(name), short_unit(unit)).trim_end().to_string()
}

/// Formats a value off nominal: `observation_delay = 2 control steps (33 ms; nominal 0)`.
pub(super) fn off_nominal(axis: &AxisFacts, value: Option<f64>, control_dt: f64) -> String {
    let steps = value.filter(|_| axis.unit == "control steps" && control_dt != 1.0);
    let time = steps.map(|steps| milliseconds(1000.0 * steps * control_dt));
    let nominal = axis.nominal.map(|nominal| format!("nominal {}", value_text(axis, Some(nominal))));
    let known: Vec<String> = time.into_iter().chain(nominal).collect();
    let known = if known.is_empty() { String::new() } else { format!(" ({})", known.join("; ")) };
    axis_text(axis, value) + &known
}

fn milliseconds(value: f64) -> String {
    if value.abs() < 10.0 { format!("{} ms", measured(value)) } else { format!("{value:.0} ms") }
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

    #[test]
    fn a_delay_is_also_a_time() {
        let axis = AxisFacts {
            name: "observation_delay".to_string(),
            kind: "model".to_string(),
            unit: "control steps".to_string(),
            low: 0.0,
            high: 6.0,
            nominal: Some(0.0),
            values: AxisValues::Kind("integer".to_string()),
            only_if: None,
        };
        let text = off_nominal(&axis, Some(2.0), 1.0 / 60.0);
        assert_eq!(text, "observation_delay = 2 control steps (33 ms; nominal 0)");
        let payload =
            AxisFacts { unit: "kg".to_string(), values: AxisValues::Kind("continuous".to_string()), ..axis };
        assert_eq!(off_nominal(&payload, Some(2.28149), 0.01), "observation_delay = 2.281 kg (nominal 0)");
    }
}
