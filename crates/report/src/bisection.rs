//! The page of a bisection: the candidates in order, and what the first failing one breaks.

use std::path::Path;

use mishandle::MishandleError;
use mishandle::inspect::compare;
use mishandle::results::{BisectedCandidate, BisectedResult, Bisection, Command, Words};
use mishandle::store::RunFile;
use mishandle_text::{path_text, plural};

use crate::comparison::comparison_section;
use crate::flipped_pairs::FlippedPairs;
use crate::html::{lines, percent, short, table, text};
use crate::load::RunReport;
use crate::page::Document;
use crate::section;
use crate::violated_counterexamples::ViolatedCounterexamples;

/// Runs and simulations of the last passing and the first failing candidate of a bisection.
#[derive(Debug, Default)]
pub struct BisectionEvidence {
    /// Of a test by a rate: the section about their comparison, pair by pair.
    comparison: String,
    /// The pages of these runs.
    pub reports: Vec<RunReport>,
    /// Of a test by counterexamples: those that the first failing one violates.
    pub violated: ViolatedCounterexamples,
}

impl BisectionEvidence {
    /// Collects the parts of the page: `violated` simulates the counterexamples that the second of
    /// two candidates violates, `read` reads a run. Returns `None` if one of them does.
    ///
    /// # Errors
    /// If a run cannot be read, or the runs cannot be compared.
    pub fn collect<E: From<MishandleError>>(
        found: &Bisection,
        violated: impl FnOnce([&BisectedCandidate; 2]) -> Option<ViolatedCounterexamples>,
        mut read: impl FnMut(&Path) -> Result<Option<(RunFile, RunReport)>, E>,
        words: Words,
    ) -> Result<Option<BisectionEvidence>, E> {
        let mut evidence = BisectionEvidence::default();
        let Some(neighbors) = found.neighbors() else { return Ok(Some(evidence)) };
        let Some(violated) = violated(neighbors) else { return Ok(None) };
        evidence.violated = violated;
        let mut runs = Vec::new();
        for path in neighbors.iter().filter_map(|candidate| candidate.run.as_ref()) {
            let Some((run, report)) = read(Path::new(path))? else { return Ok(None) };
            runs.push(run);
            evidence.reports.push(report);
        }
        if let [good, bad] = &runs[..] {
            evidence.comparison =
                comparison_section(&compare(good, bad, words)?, [good, bad], &FlippedPairs::default())?;
        }
        Ok(Some(evidence))
    }
}

/// Returns the page about a bisection: one HTML file without scripts, which loads nothing.
pub fn bisection_page(found: &Bisection, evidence: &BisectionEvidence, words: Words) -> String {
    let headline = match &found.first_bad {
        Some(name) if found.undecided.is_empty() => {
            format!("<code>{}</code> is the first that fails", text(&short(name, 80)))
        }
        Some(name) => format!(
            "one of the {} up to <code>{}</code> is the first that fails",
            plural(found.undecided.len() as u64 + 1, "candidate"),
            text(&short(name, 80))
        ),
        None if found.is_complete => "nothing to bisect".to_string(),
        None => "interrupted".to_string(),
    };
    let mut body = format!(
        "<section>\n<h2>{headline}</h2>\n<p class=\"requirement\"><b>Test:</b> {}.</p>\n<p>{}</p>\n{}{}",
        text(&found.test),
        text(&found.verdict),
        strip(found),
        candidates(found, evidence)
    );
    let has_rates = found.tested.iter().any(|tested| tested.success_rate.is_some());
    body += &format!(
        "<p class=\"notes\">{} of {} tested, {}{}.{}</p>\n",
        found.tested.len(),
        plural(found.candidates.len() as u64, "candidate"),
        plural(found.simulations, "simulation"),
        if found.tested.len() < found.candidates.len() {
            "; a box with a number alone is not tested"
        } else {
            ""
        },
        if has_rates {
            " Intervals of rates hold at any time (95 %); no correction is made for several candidates."
        } else {
            ""
        }
    );
    body += &format!("<h3>Run it again</h3>\n<pre>{}</pre>\n</section>\n", lines(&commands(found, words)));
    body += &evidence.violated.html();
    if !evidence.comparison.is_empty() {
        body +=
            "<p>Below, <b>A</b> is the last candidate that passes and <b>B</b> the first that fails.</p>\n";
        body += &evidence.comparison;
    }
    body.extend((1..).zip(&evidence.reports).map(|(id, report)| section::section(report, id)));
    let title = format!("bisection of {}", plural(found.candidates.len() as u64, "candidate"));
    Document { title: &title, up: None, body: &body }.html()
}

fn tested(found: &Bisection, place: usize) -> Option<&BisectedCandidate> {
    found.tested.iter().find(|tested| tested.place as usize == place)
}

/// Returns all candidates in their order, one box each; those that are not tested have their place.
fn strip(found: &Bisection) -> String {
    let one = |(place, name): (usize, &String)| {
        let tested = tested(found, place);
        let (class, mark, result) = match tested.map(|tested| tested.result) {
            Some(BisectedResult::Passes) => (" passes", "○", "passes"),
            Some(BisectedResult::Fails) => (" fails", "✕", "fails"),
            Some(BisectedResult::Undecided) => (" undecided", "?", "undecided"),
            None => ("", "·", "not tested"),
        };
        let is_first = found.first_bad.as_ref() == Some(name) && tested.is_some();
        let current = if is_first { " aria-current=\"true\"" } else { "" };
        // Many candidates are not tested, so their boxes are small.
        let shown = match tested {
            Some(_) => format!("{} <small>{result}</small>", text(&short(name, 40))),
            None => place.to_string(),
        };
        format!(
            "<li class=\"candidate{class}\"{current} title=\"{place}. {}: {result}\"><b>{mark}</b> {shown}</li>\n",
            text(name)
        )
    };
    let all: String = (1..).zip(&found.candidates).map(one).collect();
    format!("<ol class=\"candidates\">\n{all}</ol>\n")
}

/// Returns the table of the tested candidates, with links to what the page shows of them.
fn candidates(found: &Bisection, evidence: &BisectionEvidence) -> String {
    let address = |candidate: &BisectedCandidate| {
        let name = Some(&candidate.name);
        if evidence.reports.is_empty() {
            (!candidate.violated.is_empty() && name == found.first_bad.as_ref()).then_some("#counterexamples")
        } else if name == found.last_good.as_ref() {
            Some("#r1")
        } else {
            (name == found.first_bad.as_ref()).then_some("#r2")
        }
    };
    let row = |candidate: &BisectedCandidate| {
        let rate = candidate.success_rate.and_then(|rate| {
            Some(format!(
                "<span class=\"whole\">{} ({} to {})</span>",
                percent(rate.value?),
                percent(rate.low?),
                percent(rate.high?)
            ))
        });
        let class = match candidate.result {
            BisectedResult::Passes => "pass",
            BisectedResult::Fails => "fail",
            BisectedResult::Undecided => "count",
        };
        let name = text(&short(&candidate.name, 40));
        vec![
            candidate.place.to_string(),
            match address(candidate) {
                Some(href) => format!("<a class=\"whole\" href=\"{href}\"><code>{name}</code></a>"),
                None => format!("<code class=\"whole\">{name}</code>"),
            },
            format!("<span class=\"{class}\">{}</span>", candidate.result),
            rate.unwrap_or("–".to_string()),
            candidate.simulations.to_string(),
            candidate.reason.as_deref().map_or(String::new(), text),
        ]
    };
    let rows: Vec<Vec<String>> = found.tested.iter().map(row).collect();
    let head = ["place", "candidate", "result", "success rate", "simulations", "reason"];
    table("Tested candidates, the oldest first", &head, &rows)
}

/// Returns the command of the bisection, and those that show more about its answer.
fn commands(found: &Bisection, words: Words) -> Vec<String> {
    let mut commands = vec![found.command.clone()];
    if let Some([good, bad]) = found.neighbors() {
        if let (Some(good), Some(bad)) = (&good.run, &bad.run) {
            commands.push(words(&Command::Compare(Some([good.clone(), bad.clone()]))));
        }
        let folder = |file: &String| match Path::new(file).parent().map(path_text) {
            Some(folder) if !folder.is_empty() => folder,
            _ => ".".to_string(),
        };
        let mut suites: Vec<String> = bad.violated.iter().map(folder).collect();
        suites.dedup();
        commands.extend(suites.into_iter().map(|suite| {
            let controller = bad.controller.clone();
            words(&Command::Regress { suite, controller, baseline: Some(good.controller.clone()) })
        }));
    }
    commands
}
