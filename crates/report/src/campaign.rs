//! Pages of a campaign: one page per run, and an index that leads to them.

use mishandle::Plan;
use mishandle::results::{Answer, Estimate};
use mishandle::stl::is_violated;
use mishandle_text::{plural, probability_text};

use crate::hardening::{self, HardeningSummary};
use crate::html::{base64, number, percent, text};
use crate::load::RunReport;
use crate::page::Document;
use crate::pictures::THUMBNAIL;
use crate::{head, section, words};

/// Entry of the index for a run.
#[derive(Clone, Debug)]
pub struct RunSummary {
    name: String,
    /// Link to the page or section of the run.
    href: String,
    subject: String,
    search: String,
    space: String,
    verdict: Verdict,
    is_complete: bool,
    median: Option<u32>,
    modes: usize,
    worst: Option<f64>,
    simulations: u64,
    /// Name and value of each setting of the plan.
    settings: Vec<(&'static str, String)>,
    /// The values off nominal of the failure with which the page of the run begins, as HTML.
    cause: Option<String>,
    /// A small PNG image of it.
    thumbnail: Option<Vec<u8>>,
}

/// The verdict of a run in the index.
#[derive(Clone, Debug)]
struct Verdict {
    /// HTML after the mark of a run with or without failures.
    text: String,
    /// 95 % interval.
    interval: Option<[String; 2]>,
    /// Share of failures from 0 to 1, by which runs are sorted; `None` if the run has not started.
    share: Option<f64>,
}

impl Verdict {
    fn new(report: &RunReport) -> Verdict {
        match &report.answer {
            Some(Answer::Margin(found)) => {
                let amplitude = found.witness.as_ref().map(|witness| witness.norms.amplitude);
                Verdict {
                    text: amplitude.map_or("no violation".to_string(), |amplitude| {
                        format!("fails at amplitude {}", number(amplitude))
                    }),
                    interval: None,
                    share: Some(amplitude.map_or(0.0, |amplitude| 1.0 - 0.99 * amplitude)),
                }
            }
            Some(Answer::Metamorphic(found)) => {
                let broken = found.relations.iter().filter(|relation| relation.broken > 0).count();
                let rates = found.relations.iter().filter_map(|relation| relation.broken_rate.value);
                Verdict {
                    text: format!("{broken} of {} broken", plural(found.relations.len() as u64, "relation")),
                    interval: None,
                    share: Some(rates.fold(0.0, f64::max)),
                }
            }
            Some(Answer::Risk(found)) => {
                let value = found.without_assumption().value;
                let [low, high] = found.bounds.map(probability_text);
                let text = match value {
                    Some(value) => format!("probability {}", probability_text(value)),
                    None => format!("probability of at most {high}"),
                };
                Verdict { text, interval: Some([low, high]), share: Some(value.unwrap_or(found.bounds[0])) }
            }
            Some(Answer::Evaluation(found)) => {
                let rate = &found.metrics.violation_rate;
                let metrics = &found.metrics;
                let text = format!("{} of {} scenarios fail", metrics.violations, rate.n);
                let text = with_open(text, metrics.requirement_undecided);
                Verdict::of_rate(text, rate, found.metrics.simulations)
            }
            Some(Answer::Falsification(found)) => {
                let text = format!("{} of {} trials falsified", words::falsified(found), found.trials.len());
                let text = with_open(text, found.simulations_without_verdict());
                Verdict::of_rate(text, &found.falsification_rate, found.simulations)
            }
            Some(Answer::Hardening(_)) | None => {
                Verdict { text: "no answer".to_string(), interval: None, share: Some(0.0) }
            }
        }
    }

    /// Returns the verdict of an evaluation or falsification with this rate of failures.
    fn of_rate(text: String, rate: &Estimate, simulations: u64) -> Verdict {
        let interval = rate.low.zip(rate.high).map(|(low, high)| [low, high].map(percent));
        Verdict { text, interval, share: rate.value.or((simulations > 0).then_some(0.0)) }
    }
}

/// Adds the number of simulations without a verdict, which are neither failures nor successes.
fn with_open(text: String, open: u64) -> String {
    if open == 0 { text } else { format!("{text}, {} without a verdict", plural(open, "simulation")) }
}

impl RunSummary {
    /// Summarizes a run whose page or section is at `href`. `name` is its name in the campaign.
    pub fn new(report: &RunReport, name: &str, href: &str) -> RunSummary {
        let median = match &report.answer {
            Some(Answer::Falsification(found)) => found.median_simulations,
            _ => None,
        };
        RunSummary {
            name: name.to_string(),
            href: href.to_string(),
            subject: words::subject(report),
            search: report.header.search.clone(),
            space: report.header.space.clone(),
            verdict: Verdict::new(report),
            is_complete: report.answer.as_ref().is_some_and(Answer::is_complete),
            median,
            modes: report.modes.modes.len(),
            worst: words::worst(report),
            simulations: report.counts.simulations,
            settings: report.plan.as_ref().map_or(Vec::new(), settings),
            cause: report
                .lead()
                .filter(|lead| lead.explained.recorded.robustness.is_some_and(is_violated))
                .map(|lead| head::cause(report, lead.explained)),
            thumbnail: report.measured.as_ref().and_then(|measured| measured.lead.thumbnail.clone()),
        }
    }

    fn share(&self) -> f64 {
        self.verdict.share.unwrap_or(0.0)
    }

    /// Returns the run as a part of a cell of the matrix. `what` distinguishes it from others of
    /// its cell.
    fn thumbnail_cell(&self, what: &str) -> String {
        let image = self.thumbnail.as_ref().map(|png| {
            format!(
                "<img src=\"data:image/png;base64,{}\" width=\"{}\" height=\"{}\" alt=\"{}\">",
                base64(png),
                THUMBNAIL.0,
                THUMBNAIL.1,
                if self.cause.is_some() { "the failure" } else { "the simulation closest to a failure" }
            )
        });
        let mark = match (self.verdict.share, &self.cause) {
            (None, _) => "not started".to_string(),
            (_, Some(cause)) => format!("<b class=\"fail\">✕</b> {cause}"),
            (Some(share), None) if share > 0.0 => format!("<b class=\"fail\">✕</b> {}", self.verdict.text),
            _ => format!("<b class=\"pass\">•</b> {}", self.verdict.text),
        };
        let what = if what.is_empty() { String::new() } else { format!("{}: ", text(what)) };
        format!(
            "<a class=\"thumbnail\" href=\"{}\">{}<span>{what}{mark}</span></a>",
            text(&self.href),
            image.unwrap_or_default()
        )
    }

    fn cells(&self) -> Vec<String> {
        let Verdict { text: found, interval, share } = &self.verdict;
        let interval = interval
            .as_ref()
            .map_or("–".to_string(), |[low, high]| format!("<span class=\"whole\">{low} to {high}</span>"));
        let mark = match share {
            None => "not started".to_string(),
            Some(0.0) => format!("<b class=\"pass\">•</b> {found}"),
            Some(_) => format!("<b class=\"fail\">✕</b> {found}"),
        };
        let unfinished = if self.is_complete || share.is_none() { "" } else { ", not finished" };
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
            if self.search.is_empty() { "–".to_string() } else { text(&self.search) },
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

/// Returns the table of runs: the highest share of failures first. What was tested has no column if
/// all runs share it, or if `names_say_it`; a sentence above the table says what they share.
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
    let facts =
        if facts.is_empty() { String::new() } else { format!("<p>All runs: {}.</p>\n", facts.join(", ")) };
    let head: Vec<&str> = shown.iter().map(|column| COLUMNS[*column]).collect();
    let rows: Vec<Vec<String>> =
        rows.iter().map(|row| shown.iter().map(|column| row[*column].clone()).collect()).collect();
    facts + &crate::html::table("Runs, the most failures first", &head, &rows)
}

/// Returns the index of a campaign. `statistics` is the address of the page that compares its runs.
pub fn campaign_page(
    name: &str,
    runs: &[RunSummary],
    hardenings: &[HardeningSummary],
    statistics: Option<&str>,
) -> String {
    let mut out = format!("<section>\n<h2>{}: {}</h2>\n", text(name), headline(runs, hardenings));
    let open = runs.iter().filter(|run| !run.is_complete).count()
        + hardenings.iter().filter(|hardening| hardening.found.is_none()).count();
    if open > 0 {
        out.push_str(&format!(
            "<p>Not finished: {open} of {}.</p>\n",
            plural((runs.len() + hardenings.len()) as u64, "run")
        ));
    }
    if let Some(href) = statistics {
        out.push_str(&format!(
            "<p><a href=\"{}\">Statistics</a> of the runs side by side.</p>\n",
            text(href)
        ));
    }
    if !runs.is_empty() {
        out.push_str(NOTE);
        out.push_str(&matrix(runs));
        // The name of a run has the values that differ between the runs.
        out.push_str(&table(runs, true));
    }
    out.push_str(&hardening::hardenings(hardenings));
    out.push_str("</section>\n");
    Document { title: &text(name), up: None, body: &out }.html()
}

/// Returns what distinguishes the runs of a grid, the most important first.
fn settings(plan: &Plan) -> Vec<(&'static str, String)> {
    let search = plan.falsify.as_ref().map_or(String::new(), |falsify| falsify.search.clone());
    vec![
        ("target", plan.target.clone()),
        ("controller", words::file_name(&plan.controller).to_string()),
        ("space", plan.space.clone()),
        ("question", plan.kind().name().to_string()),
        ("search", search),
        ("preset", plan.preset.clone()),
        ("seed", plan.seed.to_string()),
    ]
}

/// Returns the runs as a matrix of the two first settings that vary, each with a picture of its
/// failure; empty if less than two vary.
fn matrix(runs: &[RunSummary]) -> String {
    let value = |run: &RunSummary, setting: usize| {
        run.settings.get(setting).map_or(String::new(), |(_, value)| value.clone())
    };
    let Some(first) = runs.first() else { return String::new() };
    let differs = |setting: &usize| runs.iter().any(|run| value(run, *setting) != value(first, *setting));
    let varied: Vec<usize> = (0..first.settings.len()).filter(differs).collect();
    let [rows, columns, others @ ..] = varied.as_slice() else { return String::new() };
    let values = |setting: usize| {
        let mut found: Vec<String> = Vec::new();
        for run in runs {
            let value = value(run, setting);
            if !found.contains(&value) {
                found.push(value);
            }
        }
        found
    };
    let heads = values(*columns);
    let head: String = heads.iter().map(|name| format!("<th scope=\"col\">{}</th>", text(name))).collect();
    let mut body = String::new();
    for row in values(*rows) {
        body.push_str(&format!("<tr><th scope=\"row\">{}</th>", text(&row)));
        for column in &heads {
            let is_here = |run: &&RunSummary| value(run, *rows) == row && value(run, *columns) == *column;
            let cells = runs.iter().filter(is_here).map(|run| {
                let others: Vec<String> = others.iter().map(|setting| value(run, *setting)).collect();
                run.thumbnail_cell(&others.join(", "))
            });
            body.push_str(&format!("<td>{}</td>", cells.collect::<String>()));
        }
        body.push_str("</tr>\n");
    }
    format!(
        "<div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"Runs as a matrix\"><table class=\"matrix\">\
         <caption>{} (rows) and {} (columns): what fails first</caption><thead><tr><td></td>{head}</tr></thead>\n\
         <tbody>{body}</tbody></table></div>\n",
        first.settings[*rows].0, first.settings[*columns].0,
    )
}

/// Explains the pages and numbers of runs.
const NOTE: &str = "<p>Each run has its page, with failure modes, robustness maps and the commands that run each failure again. An interval \
     is that of the share of falsified trials or failing scenarios, or of the failure probability.</p>\n";

/// Returns how many runs have failures, and how many hardenings accepted a controller.
fn headline(runs: &[RunSummary], hardenings: &[HardeningSummary]) -> String {
    let failing = runs.iter().filter(|run| run.share() > 0.0).count();
    let all = plural(runs.len() as u64, "run");
    let of_runs = match failing {
        _ if runs.is_empty() => None,
        0 => Some(format!("None of {all} has a failure.")),
        1 => Some(format!("1 of {all} has failures.")),
        _ => Some(format!("{failing} of {all} have failures.")),
    };
    let open = runs.iter().filter(|run| run.simulations > 0 && run.worst.is_none()).count();
    let of_runs = of_runs.map(|text| match open {
        0 => text,
        1 => format!("{text} 1 has no verdict."),
        _ => format!("{text} {open} have no verdict."),
    });
    let is_accepted =
        |summary: &&HardeningSummary| summary.found.as_ref().is_some_and(|found| found.after.is_some());
    let accepted = hardenings.iter().filter(is_accepted).count();
    let of_hardenings = (!hardenings.is_empty()).then(|| {
        let all = plural(hardenings.len() as u64, "hardening");
        format!("{accepted} of {all} accepted a controller.")
    });
    of_runs.into_iter().chain(of_hardenings).collect::<Vec<_>>().join(" ")
}

/// Returns the page of a run of a campaign, with a link to its index at the address `up`.
pub fn run_page(report: &RunReport, up: &str) -> String {
    let title = words::subject(report);
    let up = Some((up, "all runs"));
    Document { title: &title, up, body: &section::section(report, 1) }.html()
}
