//! The page about requirements that were checked: a traceability matrix, and the evidence.

use mishandle::falsification::physics_text;
use mishandle::results::{Check, CheckCell, CheckCounterexample, CheckVerdict, CheckedRequirement};
use mishandle::stl::{Clock, EvaluationTime, Formula};

use super::{CheckFigures, counts, marked_verdict, summary};
use crate::html::{lines, number, percent, table, text};
use crate::page::Document;
use crate::words::without_verdict;

/// Returns the page about a check: one HTML file without scripts, which loads nothing.
pub fn check_page(found: &Check, figures: &CheckFigures) -> String {
    let title = text(found.title.as_deref().unwrap_or(&found.target));
    let mut body = format!("<section>\n<h2>{title}</h2>\n");
    body.extend(found.notice.as_ref().map(|notice| format!("<p><strong>{}</strong></p>\n", text(notice))));
    body += &format!(
        "<p>{}.{} Simulations are evidence about what was simulated: a requirement that is not \
         violated in them is not proved.</p>\n{}</section>\n",
        summary(found),
        without_verdict(&found.without_verdict),
        matrix(found)
    );
    let requirements = (1..).zip(&found.requirements);
    body.extend(requirements.map(|(id, requirement)| section(found, requirement, id, figures)));
    body += &format!("<section>\n<h2>What was tested</h2>\n{}{}</section>\n", facts(found), runs(found));
    Document { title: &title, up: None, body: &body }.html()
}

fn matrix(found: &Check) -> String {
    let names: Vec<String> =
        found.controllers.iter().map(|controller| controller_name(&controller.name)).collect();
    let mut head = vec!["requirement", "severity", "clause"];
    head.extend(names.iter().map(String::as_str));
    let row = |(id, requirement): (usize, &CheckedRequirement)| {
        let mut cells = vec![
            format!("<a href=\"#q{id}\">{}</a>", text(&requirement.name)),
            requirement.severity.name().to_string(),
            clauses(requirement),
        ];
        cells.extend(
            cells_of(found, requirement)
                .map(|cell| format!("{}<br><small>{}</small>", judgment(found, cell), counts(cell))),
        );
        cells
    };
    let rows: Vec<Vec<String>> = (1..).zip(&found.requirements).map(row).collect();
    let caption = "Requirements and controllers: verdict, violations of random scenarios and of scenarios that a search chose";
    table(caption, &head, &rows)
}

fn cells_of<'a>(
    found: &'a Check,
    requirement: &'a CheckedRequirement,
) -> impl Iterator<Item = &'a CheckCell> {
    found.cells.iter().filter(|cell| cell.requirement == requirement.name)
}

fn controller_name(name: &str) -> String {
    if name.is_empty() { "verdict".to_string() } else { text(name) }
}

fn clauses(requirement: &CheckedRequirement) -> String {
    if requirement.clauses.is_empty() { "–".to_string() } else { text(&requirement.clauses.join("; ")) }
}

fn judgment(found: &Check, cell: &CheckCell) -> String {
    let class = match cell.verdict {
        CheckVerdict::Violated if found.fails(cell) => "fail",
        CheckVerdict::NotViolated => "pass",
        _ => return text(&marked_verdict(found, cell)),
    };
    format!("<span class=\"{class}\">{}</span>", cell.verdict.name())
}

/// Returns the section of a requirement.
fn section(found: &Check, requirement: &CheckedRequirement, id: usize, figures: &CheckFigures) -> String {
    let mut out = format!("<section class=\"run\" id=\"q{id}\">\n<h2>{}</h2>\n", text(&requirement.name));
    out.extend(requirement.text.as_ref().map(|words| format!("<p>{}</p>\n", text(words))));
    out +=
        &format!("<p class=\"requirement\"><b>Formula:</b> {}</p>\n", in_words(requirement.formula_text()));
    let mut facts = vec![
        ("severity", requirement.severity.name().to_string()),
        ("clause", clauses(requirement)),
        ("scenario space", format!("<code>{}</code>", text(&requirement.space))),
        ("formula as text", format!("<code>{}</code>", text(requirement.formula_text()))),
    ];
    let name =
        requirement.named_formula.as_ref().map(|_| format!("<code>{}</code>", text(&requirement.formula)));
    facts.extend(name.map(|name| ("name of the formula", name)));
    facts.extend(requirement.source.as_ref().map(|source| ("source of the numbers", text(source))));
    facts.extend(requirement.max_failure_rate.map(|limit| ("largest failure rate", percent(limit))));
    out += &list(&facts);
    for cell in cells_of(found, requirement) {
        let controller =
            if cell.controller.is_empty() { String::new() } else { format!("{}: ", text(&cell.controller)) };
        out += &format!("<h3>{controller}{}</h3>\n<p>{}.</p>\n", judgment(found, cell), text(&cell.evidence));
        out.extend(cell.counterexample.as_ref().map(|violation| counterexample(found, violation)));
        out += figures.html(cell);
    }
    out + "</section>\n"
}

/// Returns a formula in words, or its text if it cannot be explained.
fn in_words(formula: &str) -> String {
    let words = Formula::parse(formula)
        .ok()
        .and_then(|found| found.explain(&Clock::unknown(), EvaluationTime::Start, |_| "").ok());
    match words {
        Some(words) => format!("<span class=\"words\">{}</span>", lines(&words)),
        None => format!("<code>{}</code>", text(formula)),
    }
}

fn counterexample(check: &Check, found: &CheckCounterexample) -> String {
    let runs = check.controllers.iter().flat_map(|controller| &controller.runs);
    let digest = runs.clone().find(|run| run.run == found.run).map_or("", |run| run.digest.as_str());
    let shown = |value: Option<f64>| value.map_or("random".to_string(), number);
    let rows: Vec<Vec<String>> = found
        .scenario
        .iter()
        .map(|value| vec![text(&value.axis), shown(value.value), shown(value.nominal), text(&value.unit)])
        .collect();
    let by = check.found_by(found).map(|by| ("worst violation", text(&by)));
    let mut facts: Vec<(&str, String)> = by.into_iter().collect();
    facts.extend([
        ("robustness", number(found.robustness.0)),
        ("seed", found.seed.0.to_string()),
        (
            "run",
            format!(
                "<code>{}</code>, trial {}, simulation {}",
                text(&found.run),
                found.trial,
                found.simulation
            ),
        ),
        ("digest of the run", format!("<code>{}</code>", text(digest))),
        ("simulate it again", format!("<code>{}</code>", text(&found.replay))),
    ]);
    facts.extend(found.physics.as_ref().map(|check| ("check of the physics", text(&physics_text(check)))));
    facts.extend(found.file.as_ref().map(|file| ("counterexample", format!("<code>{}</code>", text(file)))));
    let scenario = table("Scenario of the worst violation", &["axis", "value", "nominal", "unit"], &rows);
    list(&facts) + &scenario
}

fn facts(found: &Check) -> String {
    let code = |value: &str| format!("<code>{}</code>", text(value));
    list(&[
        ("requirements", code(&found.requirements_file)),
        ("SHA-256 of the requirements", code(&found.requirements_digest)),
        ("target", format!("{} ({})", code(&found.target), text(&found.target_kind))),
        ("search", code(&found.search)),
        ("seed", found.seed.0.to_string()),
        ("fails on violations from", found.fail_on.name().to_string()),
        ("program", text(&format!("mishandle {}", found.program))),
    ])
}

fn runs(found: &Check) -> String {
    let hashes: Vec<Vec<String>> = found
        .controllers
        .iter()
        .map(|controller| {
            let code = |value: &str| format!("<code>{}</code>", text(value));
            let hash = controller.hash.as_deref().map_or("–".to_string(), code);
            vec![controller_name(&controller.name), hash, code(&controller.target_hash)]
        })
        .collect();
    let rows: Vec<Vec<String>> = found
        .controllers
        .iter()
        .flat_map(|controller| {
            controller.runs.iter().map(|run| {
                vec![
                    controller_name(&controller.name),
                    text(
                        &run.requirement
                            .as_ref()
                            .map_or(run.kind.name().to_owned(), |name| format!("search for {name}")),
                    ),
                    text(&run.space),
                    run.simulations.to_string(),
                    format!("<code>{}</code>", text(&run.run)),
                    format!("<code>{}</code>", text(&run.digest)),
                ]
            })
        })
        .collect();
    let head = ["controller", "simulations of", "space", "number", "run file", "digest of the records"];
    table("Controllers", &["controller", "hash of the controller", "hash of the target"], &hashes)
        + &table("Runs", &head, &rows)
        + &found.idle_axes().iter().map(|axis| format!("<p>{}</p>\n", text(axis))).collect::<String>()
}

fn list(facts: &[(&str, String)]) -> String {
    let fact = |(name, value): &(&str, String)| format!("<div><dt>{name}</dt><dd>{value}</dd></div>\n");
    format!("<dl class=\"facts\">{}</dl>\n", facts.iter().map(fact).collect::<String>())
}
