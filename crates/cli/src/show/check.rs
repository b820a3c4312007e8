//! Requirements that were checked on a target, as text.

use anyhow::Result;
use mishandle::results::{Check, CheckCell};
use mishandle_report::{check_summary, marked_verdict, worst_place};
use mishandle_text::{decimal, plural};

use super::{answer, escape, output, physics};

/// Prints what a check means, and its matrix; with `verbose` the evidence of each cell.
///
/// # Errors
/// If stdout cannot be written.
pub fn print(found: &Check, verbose: bool) -> Result<()> {
    let below = if verbose { text(found) } else { output::table(&matrix(found)) };
    answer::print_parts(Some(&mishandle::verdict::check(found)), &below, "")
}

/// Returns the matrix, the numbers of verdicts, and the evidence of each cell.
pub fn text(found: &Check) -> String {
    let requirements = plural(found.requirements.len() as u64, "requirement");
    let mut parts = vec![
        format!(
            "{}{}: {requirements} of {}",
            answer::without_verdict(&found.without_verdict, "the bounds count them as failures"),
            escape::name(&found.target),
            escape::name(&found.requirements_file)
        ),
        output::table(&matrix(found)),
        check_summary(found),
    ];
    for cell in &found.cells {
        let mut lines =
            vec![format!("{}: {}", escape::name(&title(found, cell)), marked_verdict(found, cell))];
        lines.push(format!("  {}", escape::name(&cell.evidence)));
        if let Some(counterexample) = &cell.counterexample {
            let robustness = decimal(counterexample.robustness.0, 4);
            let place = worst_place(found, counterexample);
            lines.push(format!("  worst violation: robustness {robustness}, {place}"));
            lines.extend(counterexample.physics.as_ref().map(|check| format!("  {}", physics::text(check))));
            lines.push(format!("  replay: {}", escape::name(&counterexample.replay)));
        }
        parts.push(lines.join("\n"));
    }
    parts.extend(found.notice.as_ref().map(|notice| escape::name(notice).to_string()));
    parts.join("\n\n")
}

/// Names the requirement of a cell, and its controller if there are several.
pub fn title(found: &Check, cell: &CheckCell) -> String {
    match found.controllers.len() {
        1 => cell.requirement.clone(),
        _ => format!("{}, {}", cell.requirement, cell.controller),
    }
}

fn matrix(found: &Check) -> Vec<Vec<String>> {
    let mut head = ["requirement", "severity", "clause"].map(String::from).to_vec();
    let name = |name: &str| {
        if name.is_empty() { "verdict".to_string() } else { escape::name(name).to_string() }
    };
    head.extend(found.controllers.iter().map(|controller| name(&controller.name)));
    let mut rows = vec![head];
    for requirement in &found.requirements {
        let mut row = vec![
            escape::name(&requirement.name).to_string(),
            requirement.severity.name().to_string(),
            if requirement.clauses.is_empty() {
                "-".to_string()
            } else {
                escape::name(&requirement.clauses.join("; ")).to_string()
            },
        ];
        let cells = found.cells.iter().filter(|cell| cell.requirement == requirement.name);
        row.extend(cells.map(|cell| marked_verdict(found, cell)));
        rows.push(row);
    }
    rows
}
