//! The whole page.

use crate::html::{number, table, text};
use crate::load::RunReport;
use crate::{section, words};

const STYLE: &str = include_str!("page.css");

/// Returns the page about these runs: one HTML file without scripts, which loads nothing.
pub fn page(reports: &[RunReport]) -> String {
    let title = match reports {
        [report] => words::subject(report),
        reports => format!("{} runs", reports.len()),
    };
    let sections: String = (1..).zip(reports).map(|(id, report)| section::section(report, id)).collect();
    let overview = if reports.len() > 1 { overview(reports) } else { String::new() };
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; img-src data:\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n\
         <meta name=\"referrer\" content=\"no-referrer\">\n\
         <title>Mishandle report: {title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n\
         <header><h1>Mishandle report</h1><label class=\"theme\"><input type=\"checkbox\" id=\"theme\"> other \
         theme</label></header>\n<main>\n{overview}{sections}</main>\n\
         <footer><p>Written by Mishandle {}. Charts: plotters. The page runs no script and loads nothing.</p></footer>\n\
         </body>\n</html>\n",
        text(mishandle::VERSION)
    )
}

/// Returns the table of the runs.
fn overview(reports: &[RunReport]) -> String {
    let rows: Vec<Vec<String>> = (1..)
        .zip(reports)
        .map(|(id, report)| {
            let result = match report.is_evaluation() {
                true => {
                    let (failing, decided) = words::evaluated(report);
                    format!("{failing} of {decided} scenarios fail")
                }
                false => {
                    let (found, trials) = words::falsified(report);
                    format!("{found} of {trials} trials falsified")
                }
            };
            let worst =
                report.trials.iter().filter_map(|trial| trial.worst).map(|(_, rho)| rho).reduce(f64::min);
            vec![
                format!("<a href=\"#r{id}\">{}</a>", words::subject(report)),
                text(&report.header.search),
                text(&report.header.space),
                result,
                words::median(report)
                    .filter(|_| !report.is_evaluation())
                    .map_or("–".into(), |n| n.to_string()),
                report.modes.modes.len().to_string(),
                worst.map_or("–".to_string(), number),
            ]
        })
        .collect();
    let head = [
        "run",
        "search",
        "space",
        "result",
        "simulations to a failure (median)",
        "failure modes",
        "lowest robustness",
    ];
    format!("<section>\n<h2>Overview</h2>\n{}</section>\n", table("Runs", &head, &rows))
}
