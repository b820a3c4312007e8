//! A replay, as text.

use mishandle::results::{AxisFacts, Replay};
use mishandle::verdict::axis_value;
use mishandle_text::plural;

use super::{escape, scenario, simulation, subject};

/// Returns the replay of a simulation of a run file.
pub fn text(found: &Replay) -> String {
    lines(found, &simulation::name(found.trial, found.point, found.simulation))
}

/// Returns the replay of an exported counterexample.
pub fn counterexample_text(found: &Replay) -> String {
    lines(found, &escape::name(&found.target))
}

fn lines(found: &Replay, name: &str) -> String {
    let value = |(axis, value): (&AxisFacts, &Option<f64>)| {
        let value = match value {
            // All digits.
            Some(value) if !axis.is_discrete() => value.to_string(),
            value => scenario::value_text(axis, *value),
        };
        axis_value(&escape::name(&axis.name), &value, &escape::name(&axis.unit))
    };
    let values = found.space_axes.iter().zip(&found.initial_configuration).map(value);
    format!(
        "{name}, {}, seed {}{}\nformula {}\nrobustness {} after {}",
        values.collect::<Vec<_>>().join(", "),
        found.seed.0,
        subject::guard_line(found.guard.as_ref()),
        escape::name(&found.formula),
        found.robustness.map_or("undecided".to_string(), |rho| rho.0.to_string()),
        plural(found.steps, "control step"),
    )
}
