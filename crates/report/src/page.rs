//! The whole page.

use crate::campaign::{self, RunSummary};
use crate::html::text;
use crate::load::RunReport;
use crate::{replay, section, words};

const STYLE: &str = include_str!("page.css");

/// Returns the page about these runs: one HTML file which loads nothing. It has a script if one of
/// them has a replay.
pub fn page(reports: &[RunReport]) -> String {
    let title = match reports {
        [report] => words::subject(report),
        reports => format!("{} runs", reports.len()),
    };
    let sections: String = (1..).zip(reports).map(|(id, report)| section::section(report, id)).collect();
    let overview = if reports.len() > 1 { overview(reports) } else { String::new() };
    let body = format!("{overview}{sections}");
    Document { title: &title, up: None, body: &body }.html()
}

/// Returns the page of the replay of one simulation: one HTML file with a script, which loads
/// nothing.
pub fn replay_page(report: &RunReport) -> String {
    let replay = report.replay.as_ref().map_or(String::new(), |replay| replay.html("r1", ""));
    let requirement = section::requirement(&report.header);
    let title = words::subject(report);
    let body = format!(
        "<section class=\"run\" id=\"r1\">\n<h2>{title}</h2>\n<p class=\"requirement\">{requirement}</p>\n{replay}</section>\n"
    );
    Document { title: &title, up: None, body: &body }.html()
}

/// A page in the style of all pages, with both themes. Its texts are HTML.
#[derive(Clone, Copy, Debug)]
pub struct Document<'a> {
    /// Title of the window.
    pub title: &'a str,
    /// Address and text of a link at the top to the page above.
    pub up: Option<(&'a str, &'a str)>,
    /// Content: sections whose headings start at the second level.
    pub body: &'a str,
}

impl Document<'_> {
    /// Returns the page: one HTML file that loads nothing. It has a script only if its content has
    /// a replay: the script of replays, whose hash is its only source of scripts.
    pub fn html(&self) -> String {
        if !self.body.contains(replay::START) {
            return self.with("", "", "The page runs no script and loads nothing.");
        }
        let policy = format!("; script-src {}", replay::script_source());
        let script = format!("<script>{}</script>\n", replay::SCRIPT);
        self.with(&policy, &script, "The page runs one script, which is in it, and loads nothing.")
    }

    fn with(&self, policy: &str, script: &str, note: &str) -> String {
        let Document { title, up, body } = self;
        let up = up
            .map_or(String::new(), |(href, name)| format!(" <a href=\"{}\">{}</a>", text(href), text(name)));
        let replay_style = if script.is_empty() { "" } else { replay::STYLE };
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; img-src \
             data:{policy}\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <meta name=\"color-scheme\" content=\"light dark\">\n\
             <meta name=\"referrer\" content=\"no-referrer\">\n\
             <title>Mishandle: {title}</title>\n<style>\n{STYLE}{replay_style}</style>\n</head>\n<body>\n\
             <header><h1>Mishandle{up}</h1><label class=\"theme\"><input type=\"checkbox\" id=\"theme\"> other \
             theme</label></header>\n<main>\n{body}</main>\n\
             <footer><p>Written by Mishandle {}. Charts: plotters. {note}</p></footer>\n\
             {script}</body>\n</html>\n",
            text(mishandle::build::VERSION)
        )
    }
}

/// Returns the table of the runs.
fn overview(reports: &[RunReport]) -> String {
    let summary = |(id, report): (usize, &RunReport)| {
        let name = words::file_name(&report.path);
        RunSummary::new(report, name.strip_suffix(".sqlite").unwrap_or(name), &format!("#r{id}"))
    };
    let runs: Vec<RunSummary> = (1..).zip(reports).map(summary).collect();
    format!("<section>\n<h2>Overview</h2>\n{}</section>\n", campaign::table(&runs, false))
}
