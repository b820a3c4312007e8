//! The page about verdicts on logs.

use mishandle::inspect::common_unit;
use mishandle::results::{Decision, LogPredicate, LogVerdict, LogViolation, NoVerdict, Number};
use mishandle::stl::{EvaluationTime, Formula};
use mishandle_logs::{Evaluation, Requirement, Samples};
use mishandle_text::{number_text, plural};

use crate::html::{lines, number, table, text, with_code};
use crate::page::Document;
use crate::predicate_chart::{PredicateChart, predicates};
use crate::words;

/// Largest number of verdicts with charts.
const MAX_SECTIONS: usize = 20;

/// Largest number of charts of a verdict.
const MAX_CHARTS: usize = 8;

/// Largest number of violations in the list of a verdict.
const MAX_VIOLATIONS: usize = 50;

/// Number of the shortest spans that fit into a chart side by side.
const WIDTHS: f64 = 400.0;

const VIOLATED: &str = "Dashed: threshold. Orange: a part of the formula with this predicate is violated.";

const DECIDED: &str = "Dashed: threshold. Orange: a part of the formula with this predicate is violated. Vertical line: decisive instant.";

/// The verdict of a formula on a log, with its charts.
pub struct LogSection {
    verdict: LogVerdict,
    words: Option<Vec<String>>,
    sentences: Vec<String>,
    charts: Vec<String>,
}

impl LogSection {
    /// Draws the predicates of a requirement over the time of the log. `decision` says what decides
    /// its formula, if that is known.
    pub fn new(
        verdict: LogVerdict,
        requirement: &Requirement,
        evaluation: &Evaluation,
        samples: &Samples,
        decision: Option<&Decision>,
    ) -> LogSection {
        let formula = &requirement.formula;
        let clock = samples.clock(formula, evaluation).ok().flatten();
        let words = clock.and_then(|clock| formula.explain(&clock, EvaluationTime::Start, |_| "").ok());
        let sentences = match (decision, &verdict.predicate) {
            (Some(found), _) => found.sentences.clone(),
            (None, Some(predicate)) => vec![decided(predicate)],
            (None, None) => Vec::new(),
        };
        LogSection { words, sentences, charts: charts(&verdict, requirement, evaluation, samples), verdict }
    }

    /// Returns the verdict.
    pub fn verdict(&self) -> &LogVerdict {
        &self.verdict
    }
}

/// Says which predicate determines the robustness, and where.
fn decided(predicate: &LogPredicate) -> String {
    let [left, right] = predicate.values.map(|value| number(value.0));
    let at = at(predicate.time, predicate.sample);
    format!("`{}` decides at {at}: its sides are {left} and {right}.", predicate.formula)
}

/// Returns the page about verdicts on logs, in their order, and about requirements without one: one
/// HTML file without scripts, which loads nothing.
pub fn log_page(sections: &[LogSection], without: &[NoVerdict]) -> String {
    let title = match (sections, without) {
        ([only], []) => words::file_name(&only.verdict.log).to_string(),
        _ => plural(sections.len(), "verdict"),
    };
    let shown = sections.len().min(MAX_SECTIONS);
    let mut body = String::new();
    if sections.len() + without.len() > 1 || sections.is_empty() {
        body += &format!("<section>\n<h2>Verdicts</h2>\n{}", overview(sections, without));
        if shown < sections.len() {
            body += &format!("<p>Charts are those of the first {shown}.</p>\n");
        }
        body += "</section>\n";
    }
    body.extend((1..).zip(&sections[..shown]).map(|(id, found)| section(found, id)));
    Document { title: &text(&title), up: None, body: &body }.html()
}

/// Returns the table of the outcomes. Requirements without a verdict stand before satisfied ones.
fn overview(sections: &[LogSection], without: &[NoVerdict]) -> String {
    let mut names = sections.iter().map(|section| &section.verdict.name);
    let has_names = names.any(Option::is_some) || without.iter().any(|lacking| lacking.name.is_some());
    let row = |(id, LogSection { verdict, .. }): (usize, &LogSection)| {
        let log = text(&verdict.log);
        let log = if id <= MAX_SECTIONS { format!("<a href=\"#l{id}\">{log}</a>") } else { log };
        let name = text(verdict.name.as_deref().unwrap_or("–"));
        let first = verdict.violations.first().filter(|_| verdict.violated);
        let cells = [
            Some(log),
            has_names.then_some(name),
            Some(judgment(verdict)),
            Some(number(verdict.robustness.0)),
            Some(first.map_or("–".to_string(), |found| at(found.start, found.start_sample))),
            Some(format!("<code>{}</code>", text(&verdict.formula))),
        ];
        cells.into_iter().flatten().collect::<Vec<String>>()
    };
    let lacking = |lacking: &NoVerdict| {
        let cells = [
            Some(text(&lacking.log)),
            has_names.then(|| text(lacking.name.as_deref().unwrap_or("–"))),
            Some(format!("<span class=\"fail\">no verdict</span>: {}", text(&lacking.reason))),
            Some("–".to_string()),
            Some("–".to_string()),
            Some(format!("<code>{}</code>", text(&lacking.formula))),
        ];
        cells.into_iter().flatten().collect::<Vec<String>>()
    };
    let mut rows: Vec<Vec<String>> = (1..).zip(sections).map(row).collect();
    let violated = sections.partition_point(|section| section.verdict.violated);
    rows.splice(violated..violated, without.iter().map(lacking));
    let head = ["log", "requirement", "verdict", "robustness", "first violation", "formula"];
    let head: Vec<&str> = head.into_iter().filter(|name| has_names || *name != "requirement").collect();
    table("Verdicts, worst first", &head, &rows)
}

fn judgment(verdict: &LogVerdict) -> String {
    match (verdict.violated, verdict.fails()) {
        (true, true) => "<span class=\"fail\">violated</span>".to_string(),
        (true, false) => "violated (warning)".to_string(),
        (false, _) if verdict.asks_nothing.is_some() => verdict.words().to_string(),
        (false, _) => "<span class=\"pass\">satisfied</span>".to_string(),
    }
}

fn section(section: &LogSection, id: usize) -> String {
    let LogSection { verdict, words, sentences, charts } = section;
    let name = verdict.name.as_ref().map_or(String::new(), |name| format!("{} on ", text(name)));
    let requirement = match words {
        Some(words) => format!("<span class=\"words\">{}</span>", lines(words)),
        None => format!("<code>{}</code>", text(&verdict.formula)),
    };
    let mut out = format!(
        "<section class=\"run\" id=\"l{id}\">\n<h2>{name}{}: {}</h2>\n<p class=\"requirement\"><b>Requirement:</b> \
         {requirement}</p>\n",
        text(&verdict.log),
        judgment(verdict),
    );
    out.extend(verdict.description.as_ref().map(|description| format!("<p>{}</p>\n", text(description))));
    out += &tiles(verdict);
    const CUT: &str = "A window extends past the end of the log and is cut there: samples after the end could change the verdict";
    let nothing = verdict.asks_nothing.as_ref().map(|reason| format!("Asks nothing: {}", with_code(reason)));
    let traps = verdict.traps.iter().map(|trap| with_code(trap));
    let cut = verdict.cuts_windows.then(|| CUT.to_string());
    let notes: String =
        nothing.into_iter().chain(traps).chain(cut).map(|note| format!("<li>{note}.</li>")).collect();
    if !notes.is_empty() {
        out += &format!("<ul class=\"notes\">{notes}</ul>\n");
    }
    if !sentences.is_empty() {
        let items = sentences.iter().map(|sentence| format!("<li>{}</li>", with_code(sentence)));
        out += &format!("<h3>What decides it</h3>\n<ul class=\"why\">{}</ul>\n", items.collect::<String>());
    }
    if verdict.violated && !verdict.violations.is_empty() {
        out += &format!("<h3>When it is violated</h3>\n{}", violations(&verdict.violations));
    }
    out + &format!("<h3>Signals</h3>\n<div class=\"grid\">{}</div>\n</section>\n", charts.concat())
}

/// Returns the key numbers.
fn tiles(verdict: &LogVerdict) -> String {
    let mut tiles = vec![(number(verdict.robustness.0), "robustness at time 0")];
    if verdict.violated {
        let first = verdict.violations.first();
        tiles.extend(first.map(|found| (at(found.start, found.start_sample), "first violation")));
        let count = verdict.violations.len();
        tiles.push((count.to_string(), if count == 1 { "time of violation" } else { "times of violation" }));
    }
    tiles.extend(verdict.samples.map(|samples| (samples.to_string(), "samples")));
    if verdict.missing_values > 0 {
        tiles.push((verdict.missing_values.to_string(), "missing values"));
    }
    let tile = |(value, name): &(String, &str)| format!("<div><dd>{value}</dd><dt>{name}</dt></div>");
    format!("<dl class=\"tiles\">{}</dl>\n", tiles.iter().map(tile).collect::<String>())
}

fn violations(found: &[LogViolation]) -> String {
    let row = |violation: &LogViolation| {
        vec![
            format!("<code>{}</code>", text(&violation.formula)),
            at(violation.start, violation.start_sample),
            at(violation.end, violation.end_sample),
            violation.duration.map_or("–".to_string(), |duration| seconds(duration.0)),
            number(violation.worst.0),
        ]
    };
    // The worst ones, in the order of time.
    let mut worst: Vec<usize> = (0..found.len()).collect();
    worst.sort_by(|a, b| found[*a].worst.0.total_cmp(&found[*b].worst.0));
    worst.truncate(MAX_VIOLATIONS);
    worst.sort_unstable();
    let rows: Vec<Vec<String>> = worst.into_iter().map(|index| row(&found[index])).collect();
    let head = ["part of the formula", "from", "to", "duration", "lowest robustness"];
    let more = if found.len() > MAX_VIOLATIONS {
        format!("<p>The worst {MAX_VIOLATIONS} of {} times are shown.</p>\n", found.len())
    } else {
        String::new()
    };
    table("Times of violation", &head, &rows) + &more
}

/// Formats a time without the digits that errors of rounding leave behind.
fn seconds(secs: f64) -> String {
    let rounded: f64 = format!("{secs:.9e}").parse().unwrap_or(secs);
    format!("{} s", number_text(rounded).replace('-', "−"))
}

fn at(time: Option<Number>, sample: Option<u64>) -> String {
    match (time, sample) {
        (Some(time), _) => seconds(time.0),
        (None, Some(sample)) => format!("sample {sample}"),
        (None, None) => "–".to_string(),
    }
}

/// Draws the predicates of the formula: those of violated parts first.
fn charts(
    verdict: &LogVerdict,
    requirement: &Requirement,
    evaluation: &Evaluation,
    samples: &Samples,
) -> Vec<String> {
    let mut found: Vec<(String, Vec<[f64; 2]>)> = Vec::new();
    for violation in verdict.violations.iter().filter(|_| verdict.violated) {
        let Ok(part) = Formula::parse(&violation.formula) else { continue };
        for predicate in predicates(&part) {
            match found.iter_mut().find(|(known, _)| *known == predicate) {
                Some((_, spans)) => spans.push(ends(violation)),
                None => found.push((predicate, vec![ends(violation)])),
            }
        }
    }
    for predicate in predicates(&requirement.formula) {
        if found.iter().all(|(known, _)| *known != predicate) {
            found.push((predicate, Vec::new()));
        }
    }
    let range = samples.time_range();
    let unit = |side: &str| common_unit(side, |name| requirement.units.get(name).cloned());
    let draw = |(predicate, violated): (String, Vec<[f64; 2]>)| {
        let decided = verdict.predicate.as_ref().filter(|decided| decided.formula == predicate);
        let chart = PredicateChart {
            predicate: &predicate,
            time: if samples.is_timed() { "time (s)" } else { "sample" },
            range,
            window: None,
            violated: visible_spans(violated, range),
            decisive: decided.map(|decided| instant(decided.time, decided.sample)),
            is_failure: false,
            caption: if decided.is_some() { DECIDED } else { VIOLATED },
        };
        chart.figure(|side| samples.curve(side, evaluation).ok(), |_| None, unit)
    };
    found.into_iter().take(MAX_CHARTS).filter_map(draw).collect()
}

fn ends(violation: &LogViolation) -> [f64; 2] {
    [instant(violation.start, violation.start_sample), instant(violation.end, violation.end_sample)]
}

/// Returns a time in seconds, or in samples without one.
fn instant(time: Option<Number>, sample: Option<u64>) -> f64 {
    time.map_or_else(|| sample.unwrap_or(0) as f64, |time| time.0)
}

/// Widens spans, which are in the order of their starts, to what a chart can show, and joins those
/// that then touch.
fn visible_spans(spans: Vec<[f64; 2]>, [first, last]: [f64; 2]) -> Vec<[f64; 2]> {
    let half = (last - first) / WIDTHS / 2.0;
    let mut joined: Vec<[f64; 2]> = Vec::new();
    for [start, end] in spans {
        let span = [(start - half).max(first), (end + half).min(last)];
        match joined.last_mut() {
            Some(known) if span[0] <= known[1] => known[1] = known[1].max(span[1]),
            _ => joined.push(span),
        }
    }
    joined
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_violations_are_wide_enough_to_see_and_few_enough_to_draw() {
        let many = (0..100_000).map(|sample| [f64::from(sample); 2]).collect();
        assert_eq!(visible_spans(many, [0.0, 99_999.0]), [[0.0, 99_999.0]]);
        let found = visible_spans(vec![[0.0, 0.0], [50.0, 50.0]], [0.0, 100.0]);
        assert_eq!(found, [[0.0, 0.125], [49.875, 50.125]]);
    }
}
