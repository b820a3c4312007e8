//! Whether a target meets the requirements of a file.

use mishandle_results::{Check, CheckCell, CheckVerdict};
use mishandle_text::measured;

use super::axes::axis_value;
use super::subject::file_name;
use super::{Conclusion, Verdict, undecided};

/// Returns what a check means.
pub fn check(found: &Check) -> Verdict {
    let conclusion = match found.exit_code() {
        1 => Conclusion::Fails,
        2 => Conclusion::NoVerdict,
        _ => Conclusion::NothingFound,
    };
    let kinds = [
        CheckVerdict::Violated,
        CheckVerdict::NotViolated,
        CheckVerdict::AsksNothing,
        CheckVerdict::NoVerdict,
        CheckVerdict::NotApplicable,
    ];
    let counts = kinds.map(|kind| (found.count(kind), kind));
    let counts = counts.iter().filter(|(count, _)| *count > 0);
    let counts: Vec<String> = counts.map(|(count, kind)| format!("{count} {kind}")).collect();
    let headline = format!(
        "{}{}, requirements of {}: {}",
        undecided(&found.without_verdict, "the bounds count them as failures"),
        file_name(&found.target),
        file_name(&found.requirements_file),
        counts.join(", ")
    );
    let mut verdict = Verdict::new(conclusion, headline);
    for cell in &found.cells {
        match cell.verdict {
            CheckVerdict::Violated => verdict.add("violated", violated(found, cell)),
            CheckVerdict::NotViolated => {}
            _ => verdict.add("open", format!("{}: {}", title(found, cell), cell.evidence)),
        }
    }
    for sentence in found.idle_axes() {
        verdict.add("but", sentence);
    }
    verdict
}

/// Names the requirement of a cell, and its controller if there are several.
fn title(found: &Check, cell: &CheckCell) -> String {
    match found.controllers.len() {
        1 => cell.requirement.clone(),
        _ => format!("{}, {}", cell.requirement, cell.controller),
    }
}

fn violated(found: &Check, cell: &CheckCell) -> String {
    let worst = cell.counterexample.as_ref().map_or(String::new(), |violation| {
        let values = violation.scenario.iter().filter(|value| value.value != value.nominal);
        let values: Vec<String> = values
            .map(|value| {
                let number = value.value.map_or("random".to_string(), measured);
                axis_value(&value.axis, &number, &value.unit)
            })
            .collect();
        let values = if values.is_empty() { "nominal".to_string() } else { values.join(", ") };
        let by = found.found_by(violation).map_or(String::new(), |by| format!(" ({by})"));
        format!("; worst at {values}{by}")
    });
    format!("{}: {}{worst}", title(found, cell), cell.evidence)
}
