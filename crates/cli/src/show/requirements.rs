//! Results of named requirements, as text.

use mishandle::results::{Requirement, RequirementVerdict};
use mishandle_text::decimal;

use super::{escape, output};

/// Returns a table of requirements over the simulations of a run, after an empty line; nothing
/// without requirements.
pub fn text(found: Option<&[Requirement]>) -> String {
    let Some(found) = found else { return String::new() };
    let head = ["requirement", "violated", "min robustness", "at", "formula"];
    let mut rows = vec![head.map(String::from).to_vec()];
    for requirement in found {
        let place = requirement.trial.zip(requirement.simulation);
        rows.push(vec![
            escape::name(&requirement.name).to_string(),
            requirement.violated_text(),
            requirement.minimum_robustness.map_or("-".to_string(), |least| decimal(least.0, 4)),
            place.map_or("-".to_string(), |(trial, number)| format!("trial {trial}, simulation {number}")),
            escape::name(&requirement.formula).to_string(),
        ]);
    }
    format!("\n\n{}{}", output::table(&rows), reasons(found, |found| (&found.name, &found.asks_nothing)))
}

/// Returns a line for each requirement that asks nothing.
fn reasons<T>(found: &[T], reason: impl Fn(&T) -> (&String, &Option<String>)) -> String {
    let line = |found: &T| {
        let (name, reason) = reason(found);
        let reason = escape::name(reason.as_ref()?);
        Some(format!("\n{} asks nothing: {reason}", escape::name(name)))
    };
    found.iter().filter_map(line).collect()
}

/// Returns a table of the verdicts of requirements on one trace, after an empty line; nothing
/// without requirements.
pub fn verdicts_text(found: Option<&[RequirementVerdict]>) -> String {
    let Some(found) = found else { return String::new() };
    let head = ["requirement", "verdict", "robustness", "formula"];
    let mut rows = vec![head.map(String::from).to_vec()];
    for requirement in found {
        let verdict = match requirement.violated {
            Some(true) => "violated",
            Some(false) if requirement.asks_nothing.is_some() => "satisfied: asks nothing",
            Some(false) => "satisfied",
            None => "no verdict",
        };
        rows.push(vec![
            escape::name(&requirement.name).to_string(),
            verdict.to_string(),
            requirement.robustness.map_or("-".to_string(), |rho| decimal(rho.0, 4)),
            escape::name(&requirement.formula).to_string(),
        ]);
    }
    format!("\n\n{}{}", output::table(&rows), reasons(found, |found| (&found.name, &found.asks_nothing)))
}
