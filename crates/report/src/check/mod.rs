//! Requirements that were checked: the reports in the folder of a check.

mod figures;
mod junit;
mod markdown;
mod page;

use mishandle::results::{
    Check, CheckCell, CheckCounterexample, CheckCounts, CheckVerdict, CheckedRequirement, CheckedValue,
};
use mishandle_text::{decimal, visible};

pub use figures::CheckFigures;
pub use markdown::{check_markdown, summary};
pub use page::check_page;

use junit::check_junit;

/// Names of the reports: the page, the matrix in Markdown, the verdicts as JUnit XML.
pub const CHECK_REPORTS: [&str; 3] = ["report.html", "report.md", "junit.xml"];

/// Returns the reports: the names of the files and their content.
pub fn check_reports(found: &Check, figures: &CheckFigures) -> [(&'static str, String); 3] {
    let [page, markdown, junit] = CHECK_REPORTS;
    [(page, check_page(found, figures)), (markdown, check_markdown(found)), (junit, check_junit(found))]
}

/// Returns the verdict of a cell, with the severity of a violation that does not count.
pub fn marked_verdict(found: &Check, cell: &CheckCell) -> String {
    match mark(found, cell) {
        Some(mark) => format!("{} ({mark})", cell.verdict),
        None => cell.verdict.to_string(),
    }
}

fn mark(found: &Check, cell: &CheckCell) -> Option<&'static str> {
    let is_passed = cell.verdict == CheckVerdict::Violated && !found.fails(cell);
    let requirement = found.requirement(cell).filter(|_| is_passed);
    requirement.map(|requirement| requirement.severity.name())
}

/// Returns the values of a counterexample that are off nominal, and what found it.
pub fn worst_place(check: &Check, found: &CheckCounterexample) -> String {
    let is_off = |value: &&CheckedValue| value.value != value.nominal;
    let shown = found.scenario.iter().filter(is_off).map(|value| {
        let number = |value: Option<f64>| value.map_or("random".to_string(), |value| decimal(value, 4));
        let unit = if value.unit.is_empty() { String::new() } else { format!(" {}", value.unit) };
        let nominal = number(value.nominal);
        visible(&format!("{} {}{unit} (nominal {nominal})", value.axis, number(value.value)))
    });
    let shown: Vec<String> = shown.collect();
    let place = if shown.is_empty() {
        "in the nominal scenario".to_string()
    } else {
        format!("at {}", shown.join(", "))
    };
    let by = check.found_by(found).map_or(String::new(), |by| format!(" ({})", visible(&by)));
    place + &by
}

/// Returns the formula of a requirement; one of the target with its name.
fn formula(requirement: &CheckedRequirement) -> String {
    match &requirement.named_formula {
        Some(text) => format!("{}: {text}", requirement.formula),
        None => requirement.formula.clone(),
    }
}

/// Returns the numbers of simulations in which it fails, those that a search chose apart, because
/// they say nothing about a rate.
fn counts(cell: &CheckCell) -> String {
    let started = |counts: &CheckCounts| counts.simulations + counts.without_verdict;
    let of = |counts: CheckCounts, what: &str| match started(&counts) {
        0 => None,
        all => Some(format!("{} of {all} {what}", counts.violated)),
    };
    let parts = [of(cell.random, "random"), of(cell.searched, "searched")];
    parts.into_iter().flatten().collect::<Vec<_>>().join(", ")
}
