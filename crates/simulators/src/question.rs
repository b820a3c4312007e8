//! Questions about a simulation, written as lines.

use std::fmt::Write;

use mishandle_rollout::{Axis, AxisValues, Scenario, Seed, Space};

/// Writes the scenarios of a space for a simulator. It names every axis of the simulator: an axis
/// outside the space is nominal.
#[derive(Debug)]
pub(crate) struct ScenarioWriter {
    axes: Vec<WrittenAxis>,
}

#[derive(Debug)]
struct WrittenAxis {
    /// The name as JSON, with its colon.
    key: String,
    axis: Axis,
    /// Position in a scenario of the space.
    position: Option<usize>,
}

impl ScenarioWriter {
    pub(crate) fn new(axes: &[Axis], space: &Space) -> ScenarioWriter {
        let written = |axis: &Axis| WrittenAxis {
            key: format!("{}:", json_text(&axis.name)),
            axis: axis.clone(),
            position: space.axes().iter().position(|known| known.name == axis.name),
        };
        ScenarioWriter { axes: axes.iter().map(written).collect() }
    }

    /// Appends the seed and the scenario of a question.
    pub(crate) fn write(&self, line: &mut String, seed: Seed, scenario: &Scenario) {
        let _ = write!(line, ",\"seed\":\"{}\",\"scenario\":{{", seed.0);
        for (index, WrittenAxis { key, axis, position }) in self.axes.iter().enumerate() {
            if index > 0 {
                line.push(',');
            }
            line.push_str(key);
            let given = position.and_then(|position| scenario.get(position));
            let value = given.or(axis.nominal).unwrap_or(axis.low);
            match &axis.values {
                // The first name is that of the lower bound.
                AxisValues::Categorical(names) => {
                    let name = names.get((value - axis.low) as usize).map_or("", String::as_str);
                    line.push_str(&json_text(name));
                }
                AxisValues::Integer => {
                    let _ = write!(line, "{}", value as i64);
                }
                AxisValues::Continuous | AxisValues::Logarithmic => {
                    let _ = write!(line, "{value:?}");
                }
            }
        }
        line.push('}');
    }
}

/// Appends a list of finite numbers.
pub(crate) fn write_numbers(line: &mut String, numbers: &[f64]) {
    line.push('[');
    for (index, number) in numbers.iter().enumerate() {
        let _ = if index > 0 { write!(line, ",{number:?}") } else { write!(line, "{number:?}") };
    }
    line.push(']');
}

fn json_text(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}

#[cfg(test)]
mod tests {
    use mishandle_rollout::AxisKind;

    use super::*;

    #[test]
    fn a_scenario_names_every_axis_with_its_kind_of_value() {
        let axis = |name: &str, values, nominal| {
            Axis::new(AxisKind::Model, name, "", [0.0, 3.0], Some(nominal)).with_values(values)
        };
        let names = AxisValues::Categorical(["cold", "warm", "hot", "\"odd\""].map(String::from).into());
        let axes = [
            axis("level", AxisValues::Continuous, 1.0),
            axis("count", AxisValues::Integer, 2.0),
            axis("air", names, 0.0),
            axis("outside", AxisValues::Continuous, 0.5),
        ];
        let space =
            Space::new("some", vec![axes[2].clone(), axes[1].clone(), axes[0].clone()]).expect("a space");
        let mut line = String::new();
        let scenario = [3.0, 3.0, 1.5e-7].into();
        ScenarioWriter::new(&axes, &space).write(&mut line, Seed(u64::MAX), &scenario);
        let text = format!("{{\"id\":1{line}}}");
        let read: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        assert_eq!(read["seed"], "18446744073709551615");
        let expected = serde_json::json!({ "level": 1.5e-7, "count": 3, "air": "\"odd\"", "outside": 0.5 });
        assert_eq!(read["scenario"], expected);
    }
}
