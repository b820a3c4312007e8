//! Requirements that were checked on a target: as text, Markdown and JUnit.

use mishandle::results::{
    Check, CheckCell, CheckCounterexample, NO_VERDICT, NOT_APPLICABLE, NOT_VIOLATED, VIOLATED,
};
use mishandle_text::{decimal, number_text, plural};

use super::log_verdicts::{without_tags, xml};
use super::{escape, output};

/// Returns the matrix, the numbers of verdicts, and the evidence of each cell.
pub fn text(found: &Check) -> String {
    let requirements = plural(found.requirements.len() as u64, "requirement");
    let mut parts = vec![
        format!(
            "{}: {requirements} of {}",
            escape::name(&found.target),
            escape::name(&found.requirements_file)
        ),
        output::table(&matrix(found)),
        summary(found),
    ];
    for cell in &found.cells {
        let mut lines = vec![format!("{}: {}", escape::name(&title(found, cell)), verdict(found, cell))];
        lines.push(format!("  {}", escape::name(&cell.evidence)));
        if let Some(counterexample) = &cell.counterexample {
            let robustness = decimal(counterexample.robustness.0, 4);
            lines.push(format!("  worst violation: robustness {robustness}, {}", scenario(counterexample)));
            lines.push(format!("  replay: {}", escape::name(&counterexample.replay)));
        }
        parts.push(lines.join("\n"));
    }
    parts.extend(found.notice.as_ref().map(|notice| escape::name(notice).to_string()));
    parts.join("\n\n")
}

/// Returns the numbers of verdicts in a sentence.
pub fn summary(found: &Check) -> String {
    let count = |verdict| format!("{} {verdict}", found.count(verdict));
    let counts = [VIOLATED, NOT_VIOLATED, NO_VERDICT, NOT_APPLICABLE].map(count).join(", ");
    format!("{}: {counts}", plural(found.cells.len() as u64, "verdict"))
}

/// Names the requirement of a cell, and its controller if there are several.
pub fn title(found: &Check, cell: &CheckCell) -> String {
    match found.controllers.len() {
        1 => cell.requirement.clone(),
        _ => format!("{}, {}", cell.requirement, cell.controller),
    }
}

/// Returns the verdict, with the severity of a violation that does not count.
fn verdict(found: &Check, cell: &CheckCell) -> String {
    let severity = found.requirement(cell).map(|requirement| requirement.severity);
    match severity.filter(|_| cell.verdict == VIOLATED && !found.fails(cell)) {
        Some(severity) => format!("{} ({})", cell.verdict, severity.name()),
        None => cell.verdict.clone(),
    }
}

/// Returns the values of a scenario that are off nominal.
fn scenario(found: &CheckCounterexample) -> String {
    let is_off = |value: &&mishandle::results::CheckedValue| value.value != value.nominal;
    let shown = found.scenario.iter().filter(is_off).map(|value| {
        let number = |value: Option<f64>| value.map_or("random".to_string(), |value| decimal(value, 4));
        let unit = if value.unit.is_empty() { String::new() } else { format!(" {}", value.unit) };
        let nominal = number(value.nominal);
        escape::name(&format!("{} {}{unit} (nominal {nominal})", value.axis, number(value.value))).to_string()
    });
    let shown: Vec<String> = shown.collect();
    if shown.is_empty() { "in the nominal scenario".to_string() } else { format!("at {}", shown.join(", ")) }
}

fn matrix(found: &Check) -> Vec<Vec<String>> {
    let mut head = ["requirement", "severity", "clause"].map(String::from).to_vec();
    let name =
        |name: &str| if name.is_empty() { "verdict".to_string() } else { escape::name(name).to_string() };
    head.extend(found.controllers.iter().map(|controller| name(&controller.name)));
    let mut rows = vec![head];
    for requirement in &found.requirements {
        let mut row = vec![
            escape::name(&requirement.name).to_string(),
            requirement.severity.name().to_string(),
            match requirement.clauses.is_empty() {
                true => "-".to_string(),
                false => escape::name(&requirement.clauses.join("; ")).to_string(),
            },
        ];
        let cells = found.cells.iter().filter(|cell| cell.requirement == requirement.name);
        row.extend(cells.map(|cell| verdict(found, cell)));
        rows.push(row);
    }
    rows
}

/// Returns the matrix and the evidence in Markdown.
pub fn markdown(found: &Check) -> String {
    let title = found.title.as_deref().unwrap_or("Requirements");
    let mut text = format!("# {}\n\n", cell_text(title));
    if let Some(notice) = &found.notice {
        text += &format!("> {}\n\n", cell_text(notice));
    }
    text += &format!(
        "Target `{}`, {}. {}.\n\n",
        code(&found.target),
        cell_text(&format!("requirements `{}`", code(&found.requirements_file))),
        summary(found)
    );
    text += &rows(matrix(found));
    text += "\n## Evidence\n\n";
    let head = ["requirement", "controller", "verdict", "evidence", "replay"].map(String::from).to_vec();
    let evidence = found.cells.iter().map(|cell| {
        let replay = cell.counterexample.as_ref().map(|found| format!("`{}`", code(&found.replay)));
        vec![
            cell.requirement.clone(),
            cell.controller.clone(),
            verdict(found, cell),
            cell.evidence.clone(),
            replay.unwrap_or_default(),
        ]
    });
    text += &rows(std::iter::once(head).chain(evidence).collect());
    text += "\n## Runs\n\n";
    let head = ["controller", "hash", "run", "simulations", "digest"].map(String::from).to_vec();
    let runs = found.controllers.iter().flat_map(|controller| {
        controller.runs.iter().map(|run| {
            vec![
                controller.name.clone(),
                controller.hash.clone().unwrap_or_default(),
                format!("`{}`", code(&run.run)),
                run.simulations.to_string(),
                run.digest.clone(),
            ]
        })
    });
    text += &rows(std::iter::once(head).chain(runs).collect());
    text += &format!(
        "\nSHA-256 of the requirements: {}. Seed {}. Mishandle {}.\n",
        found.requirements_digest, found.seed.0, found.program
    );
    text
}

fn code(text: &str) -> String {
    escape::name(text).replace('`', "'")
}

fn cell_text(text: &str) -> String {
    without_tags(&escape::name(&text.split_whitespace().collect::<Vec<_>>().join(" ")))
}

/// Returns a Markdown table.
fn rows(rows: Vec<Vec<String>>) -> String {
    let mut text = String::new();
    for (index, row) in rows.into_iter().enumerate() {
        let cells: Vec<String> = row.iter().map(|cell| cell_text(cell)).collect();
        text += &format!("| {} |\n", cells.join(" | "));
        if index == 0 {
            text += &format!("| {} |\n", vec!["---"; row.len()].join(" | "));
        }
    }
    text
}

/// Returns the verdicts as a report of JUnit: a suite for each controller, a case for each
/// requirement.
pub fn junit(found: &Check) -> String {
    let mut text = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites>\n");
    for controller in &found.controllers {
        let cells: Vec<&CheckCell> =
            found.cells.iter().filter(|cell| cell.controller == controller.name).collect();
        let element = |cell: &CheckCell| match cell.verdict.as_str() {
            _ if found.fails(cell) => Some("failure"),
            _ if found.is_open(cell) => Some("error"),
            NOT_APPLICABLE | NO_VERDICT => Some("skipped"),
            _ => None,
        };
        let count = |name| cells.iter().filter(|cell| element(cell) == Some(name)).count();
        let suite = xml(&format!("{} {}", found.target, controller.name));
        text += &format!(
            "  <testsuite name=\"{suite}\" tests=\"{}\" failures=\"{}\" errors=\"{}\" skipped=\"{}\">\n",
            cells.len(),
            count("failure"),
            count("error"),
            count("skipped")
        );
        for cell in &cells {
            text += &format!("    <testcase classname=\"{suite}\" name=\"{}\">\n", xml(&cell.requirement));
            let requirement = found.requirement(cell);
            if let Some(requirement) = requirement {
                let property = |name: &str, value: &str| {
                    format!("        <property name=\"{name}\" value=\"{}\"/>\n", xml(value))
                };
                text += "      <properties>\n";
                text += &property("severity", requirement.severity.name());
                text.extend(requirement.clauses.iter().map(|clause| property("clause", clause)));
                text += "      </properties>\n";
            }
            let summary = xml(&format!("{}: {}", verdict(found, cell), cell.evidence));
            let formula = requirement.map_or("", |requirement| requirement.formula.as_str());
            let mut message = format!("{formula}\n{}", cell.evidence);
            if let Some(counterexample) = &cell.counterexample {
                let robustness = number_text(counterexample.robustness.0);
                message += &format!(
                    "\nrobustness {robustness} {}\n{}",
                    scenario(counterexample),
                    counterexample.replay
                );
            }
            let message = xml(&message);
            text += &match element(cell) {
                Some(name) => format!("      <{name} message=\"{summary}\">{message}</{name}>\n"),
                None => format!("      <system-out>{summary}\n{message}</system-out>\n"),
            };
            text += "    </testcase>\n";
        }
        text += "  </testsuite>\n";
    }
    text + "</testsuites>\n"
}
