use mishandle::results::{Check, CheckCell, CheckVerdict};
use mishandle_text::{number_text, xml_text};

use super::{formula, mark, marked_verdict, worst_place};

/// Returns the verdicts as a report of JUnit: a suite for each controller, a case for each
/// requirement.
pub fn check_junit(found: &Check) -> String {
    let mut text = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites>\n");
    for controller in &found.controllers {
        let cells: Vec<&CheckCell> =
            found.cells.iter().filter(|cell| cell.controller == controller.name).collect();
        let count = |name| cells.iter().filter(|cell| element(found, cell) == Some(name)).count();
        let suite = xml_text(&format!("{} {}", found.target, controller.name));
        text += &format!(
            "  <testsuite name=\"{suite}\" tests=\"{}\" failures=\"{}\" errors=\"{}\" skipped=\"{}\">\n",
            cells.len(),
            count("failure"),
            count("error"),
            count("skipped")
        );
        text.extend(cells.iter().map(|cell| case(found, cell, &suite)));
        text += "  </testsuite>\n";
    }
    text + "</testsuites>\n"
}

/// Returns the element of a cell that is not passed.
fn element(found: &Check, cell: &CheckCell) -> Option<&'static str> {
    match cell.verdict {
        _ if found.fails(cell) => Some("failure"),
        _ if found.is_open(cell) => Some("error"),
        CheckVerdict::NotApplicable | CheckVerdict::NoVerdict | CheckVerdict::AsksNothing => Some("skipped"),
        _ => None,
    }
}

fn case(found: &Check, cell: &CheckCell, suite: &str) -> String {
    let mut text = format!("    <testcase classname=\"{suite}\" name=\"{}\">\n", xml_text(&cell.requirement));
    let requirement = found.requirement(cell);
    if let Some(requirement) = requirement {
        let property = |name: &str, value: &str| {
            format!("        <property name=\"{name}\" value=\"{}\"/>\n", xml_text(value))
        };
        text += "      <properties>\n";
        text += &property("severity", requirement.severity.name());
        text.extend(requirement.clauses.iter().map(|clause| property("clause", clause)));
        text.extend(mark(found, cell).map(|mark| property("mark", mark)));
        text += "      </properties>\n";
    }
    let summary = xml_text(&format!("{}: {}", marked_verdict(found, cell), cell.evidence));
    let mut message = format!("{}\n{}", requirement.map_or(String::new(), formula), cell.evidence);
    if let Some(counterexample) = &cell.counterexample {
        let robustness = number_text(counterexample.robustness.0);
        let place = worst_place(found, counterexample);
        message += &format!("\nrobustness {robustness} {place}\n{}", counterexample.replay);
    }
    let message = xml_text(&message);
    text += &match element(found, cell) {
        Some(name) => format!("      <{name} message=\"{summary}\">{message}</{name}>\n"),
        None => format!("      <system-out>{summary}\n{message}</system-out>\n"),
    };
    text + "    </testcase>\n"
}
