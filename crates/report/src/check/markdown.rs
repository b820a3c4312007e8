use mishandle::results::{Check, CheckCell, CheckVerdict, CheckedRequirement};
use mishandle_text::plural;

use super::{counts, formula, marked_verdict};
use crate::markdown::{code, escaped, table};
use crate::words::without_verdict;

/// Returns the numbers of verdicts in a sentence.
pub fn summary(found: &Check) -> String {
    let count = |verdict| format!("{} {verdict}", found.count(verdict));
    let is_shown =
        |verdict: &CheckVerdict| *verdict != CheckVerdict::AsksNothing || found.count(*verdict) > 0;
    let counts: Vec<String> = CheckVerdict::ALL.iter().copied().filter(is_shown).map(count).collect();
    format!("{}: {}", plural(found.cells.len() as u64, "verdict"), counts.join(", "))
}

/// Returns the matrix and the evidence in Markdown.
pub fn check_markdown(found: &Check) -> String {
    let title = found.title.as_deref().unwrap_or("Requirements");
    let mut text = format!("# {}\n\n", escaped(title));
    if let Some(notice) = &found.notice {
        text += &format!("> {}\n\n", escaped(&notice.split_whitespace().collect::<Vec<_>>().join(" ")));
    }
    text += &format!(
        "Target {}, requirements {}. {}.{}\n\n{}## Evidence\n\n{}## Runs\n\n{}",
        code(&found.target),
        code(&found.requirements_file),
        summary(found),
        without_verdict(&found.without_verdict),
        matrix(found),
        evidence(found),
        runs(found)
    );
    text += &format!(
        "SHA-256 of the requirements: {}. Seed {}. Mishandle {}.\n",
        found.requirements_digest,
        found.seed.0,
        escaped(&found.program)
    );
    text
}

fn matrix(found: &Check) -> String {
    let mut head = ["requirement", "severity", "clause", "formula"].map(String::from).to_vec();
    let name = |name: &str| if name.is_empty() { "verdict".to_string() } else { escaped(name) };
    head.extend(found.controllers.iter().map(|controller| name(&controller.name)));
    let row = |requirement: &CheckedRequirement| {
        let cells = found.cells.iter().filter(|cell| cell.requirement == requirement.name);
        let mut row = vec![
            escaped(&requirement.name),
            requirement.severity.name().to_string(),
            escaped(&requirement.clauses.join("; ")),
            code(&formula(requirement)),
        ];
        row.extend(cells.map(|cell| marked_verdict(found, cell)));
        row
    };
    let rows: Vec<Vec<String>> = found.requirements.iter().map(row).collect();
    let head: Vec<&str> = head.iter().map(String::as_str).collect();
    table(&head, head.len(), &rows)
}

fn evidence(found: &Check) -> String {
    let row = |cell: &CheckCell| {
        let worst = cell.counterexample.as_ref();
        let replay = worst.map(|worst| code(&worst.replay));
        let by = worst.and_then(|worst| found.found_by(worst)).map(|by| escaped(&by));
        vec![
            escaped(&cell.requirement),
            escaped(&cell.controller),
            marked_verdict(found, cell),
            counts(cell),
            escaped(&cell.evidence),
            by.unwrap_or_default(),
            replay.unwrap_or_default(),
        ]
    };
    let rows: Vec<Vec<String>> = found.cells.iter().map(row).collect();
    table(&["requirement", "controller", "verdict", "violations", "evidence", "worst", "replay"], 7, &rows)
}

fn runs(found: &Check) -> String {
    let runs = found.controllers.iter().flat_map(|controller| {
        controller.runs.iter().map(|run| {
            vec![
                escaped(&controller.name),
                controller.hash.clone().unwrap_or_default(),
                code(&run.run),
                run.simulations.to_string(),
                run.digest.clone(),
            ]
        })
    });
    let idle: String = found.idle_axes().iter().map(|axis| format!("\n{}\n", escaped(axis))).collect();
    table(&["controller", "hash", "run", "simulations", "digest"], 3, &runs.collect::<Vec<_>>()) + &idle
}
