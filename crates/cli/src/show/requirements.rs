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
            format!("{} of {}", requirement.violated, requirement.simulations),
            requirement.minimum_robustness.map_or("-".to_string(), |least| decimal(least.0, 4)),
            place.map_or("-".to_string(), |(trial, number)| format!("trial {trial}, simulation {number}")),
            escape::name(&requirement.formula).to_string(),
        ]);
    }
    format!("\n\n{}", output::table(&rows))
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
    format!("\n\n{}", output::table(&rows))
}
