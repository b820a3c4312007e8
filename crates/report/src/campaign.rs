//! Pages of a campaign: one page per run, and an index that leads to them.

use mishandle::evaluation::wilson;
use mishandle::store::TrialStatus;

use crate::html::{number, percent, text};
use crate::load::RunReport;
use crate::page::Document;
use crate::{section, words};

/// Entry of the index for a run.
#[derive(Clone, Debug)]
pub struct RunSummary {
    name: String,
    /// Link to the page or section of the run.
    href: String,
    subject: String,
    search: String,
    space: String,
    is_evaluation: bool,
    /// Numbers of failing and of all trials, or of failing and of decided random simulations of an evaluation.
    failures: (u64, u64),
    is_complete: bool,
    median: Option<u32>,
    modes: usize,
    worst: Option<f64>,
    simulations: u64,
}

impl RunSummary {
    /// Summarizes a run whose page or section is at `href`. `name` is its name in the campaign.
    pub fn new(report: &RunReport, name: &str, href: &str) -> RunSummary {
        let is_evaluation = report.is_evaluation();
        let falsified = words::falsified(report);
        let planned =
            report.plan.as_ref().and_then(|plan| plan.falsify.as_ref()).map_or(1, |plan| plan.trials);
        let has_ended = |trial: &&crate::load::Trial| trial.summary.trial.status != TrialStatus::Running;
        let ended = report.trials.iter().filter(has_ended).count();
        RunSummary {
            name: name.to_string(),
            href: href.to_string(),
            subject: words::subject(report),
            search: report.header.search.clone(),
            space: report.header.space.clone(),
            is_evaluation,
            failures: match is_evaluation {
                true => words::evaluated(report),
                false => (falsified.0 as u64, falsified.1 as u64),
            },
            is_complete: ended == report.trials.len() && ended as u64 >= u64::from(planned),
            median: words::median(report).filter(|_| !is_evaluation),
            modes: report.modes.modes.len(),
            worst: words::worst(report),
            simulations: report.counts.simulations,
        }
    }

    fn share(&self) -> f64 {
        let (failing, all) = self.failures;
        failing as f64 / (all as f64).max(1.0)
    }

    fn cells(&self) -> Vec<String> {
        let (failing, all) = self.failures;
        let what = if self.is_evaluation { "scenarios fail" } else { "trials falsified" };
        let rate = wilson(failing, all);
        let interval = match (rate.low, rate.high) {
            (Some(low), Some(high)) => {
                format!("<span class=\"whole\">{} to {}</span>", percent(low), percent(high))
            }
            _ => "–".to_string(),
        };
        let mark = match (all, failing) {
            (0, _) => "not started".to_string(),
            (_, 0) => format!("<b class=\"pass\">•</b> 0 of {all} {what}"),
            _ => format!("<b class=\"fail\">✕</b> {failing} of {all} {what}"),
        };
        let unfinished = if self.is_complete || all == 0 { "" } else { ", not finished" };
        vec![
            format!("<a class=\"whole\" href=\"{}\">{}</a>", text(&self.href), text(&self.name)),
            format!(
                "<span class=\"whole\"><span class=\"bar\"><i style=\"width:{:.0}%\"></i></span> {mark}{unfinished}</span>",
                100.0 * self.share()
            ),
            interval,
            self.median.map_or("–".into(), |median| median.to_string()),
            self.modes.to_string(),
            self.worst.map_or("–".to_string(), number),
            self.simulations.to_string(),
            self.subject.clone(),
            if self.is_evaluation { "–".to_string() } else { text(&self.search) },
            text(&self.space),
        ]
    }
}

/// Names of the cells of a run. The last ones say what was tested.
const COLUMNS: [&str; 10] = [
    "run",
    "result",
    "95 % interval",
    "simulations to a failure (median)",
    "failure modes",
    "lowest robustness",
    "simulations",
    "target",
    "search",
    "space",
];

/// Number of columns that say what was found.
const RESULTS: usize = 7;

/// Returns the table of runs: the highest share of failures first. What was tested has no column if all runs share it, or if
/// `names_say_it`; a sentence above the table says what they share.
pub fn table(runs: &[RunSummary], names_say_it: bool) -> String {
    let mut sorted: Vec<&RunSummary> = runs.iter().collect();
    let median = |run: &RunSummary| run.median.unwrap_or(u32::MAX);
    let worst = |run: &RunSummary| run.worst.unwrap_or(f64::INFINITY);
    sorted.sort_by(|a, b| {
        let by_share = b.share().total_cmp(&a.share());
        by_share.then_with(|| median(a).cmp(&median(b))).then_with(|| worst(a).total_cmp(&worst(b)))
    });
    let rows: Vec<Vec<String>> = sorted.iter().map(|run| run.cells()).collect();
    let is_shared =
        |column: &usize| rows.len() > 1 && rows.iter().all(|row| row[*column] == rows[0][*column]);
    let (shared, varied): (Vec<usize>, Vec<usize>) = (RESULTS..COLUMNS.len()).partition(is_shared);
    let shown: Vec<usize> = (0..RESULTS).chain(varied.into_iter().filter(|_| !names_say_it)).collect();
    let facts: Vec<String> = shared
        .iter()
        .filter(|column| rows[0][**column] != "–")
        .map(|column| format!("{} {}", COLUMNS[*column], rows[0][*column]))
        .collect();
    let facts = match facts.is_empty() {
        true => String::new(),
        false => format!("<p>All runs: {}.</p>\n", facts.join(", ")),
    };
    let head: Vec<&str> = shown.iter().map(|column| COLUMNS[*column]).collect();
    let rows: Vec<Vec<String>> =
        rows.iter().map(|row| shown.iter().map(|column| row[*column].clone()).collect()).collect();
    facts + &crate::html::table("Runs, the most failures first", &head, &rows)
}

/// Returns the index of a campaign. `tables` are other pages: their addresses and titles.
pub fn campaign_page(name: &str, runs: &[RunSummary], tables: &[(String, String)]) -> String {
    let failing = runs.iter().filter(|run| run.failures.0 > 0).count();
    let title = match failing {
        0 => format!("None of {} has a failure.", mishandle_text::plural(runs.len() as u64, "run")),
        _ => format!(
            "{failing} of {} {} failures.",
            mishandle_text::plural(runs.len() as u64, "run"),
            if failing == 1 { "has" } else { "have" }
        ),
    };
    let mut out = format!("<section>\n<h2>{}: {title}</h2>\n", text(name));
    let open = runs.iter().filter(|run| !run.is_complete).count();
    if open > 0 {
        out.push_str(&format!(
            "<p>Not finished: {open} of {}.</p>\n",
            mishandle_text::plural(runs.len() as u64, "run")
        ));
    }
    out.push_str(
        "<p>Each run has its page, with failure modes, robustness maps and the commands that run each failure again. An interval \
         is that of the share of falsified trials or failing scenarios.</p>\n",
    );
    if !tables.is_empty() {
        let link = |(href, title): &(String, String)| {
            format!("<li><a href=\"{}\">{}</a></li>", text(href), text(title))
        };
        out.push_str(&format!("<ul>{}</ul>\n", tables.iter().map(link).collect::<String>()));
    }
    // The name of a run has the values that differ between the runs.
    out.push_str(&table(runs, true));
    out.push_str("</section>\n");
    Document { title: &text(name), up: None, body: &out }.html()
}

/// Returns the page of a run of a campaign, with a link to its index at the address `up`.
pub fn run_page(report: &RunReport, up: &str) -> String {
    let title = words::subject(report);
    let up = Some((up, "all runs"));
    Document { title: &title, up, body: &section::section(report, 1) }.html()
}
