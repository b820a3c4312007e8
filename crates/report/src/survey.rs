//! Findings of trials that keep going: modes against simulations, estimates of unseen modes,
//! coverage of the space.

use crate::charts::{Chart, Mark, Panel, Series};
use mishandle::inspect::ModeSurvey;
use mishandle::results::{Coverage, UnseenModes};

use crate::color;
use crate::html::{figure, number, percent, table, visible};
use crate::load::RunReport;
use crate::map::SIZE;
use crate::space::linear;

/// Largest number of trials with a line of their own.
const MAX_LINES: usize = 100;

/// Largest number of modes in the table.
const MAX_MODES: usize = 20;

/// Returns the survey as HTML; empty for a run whose trials end at their first violation.
pub fn section(report: &RunReport) -> String {
    let Some(survey) = &report.survey else { return String::new() };
    let unseen = survey.unseen.as_ref().map(unseen_text);
    let sentences: Vec<String> = unseen.into_iter().chain(coverage_text(&survey.coverage)).collect();
    format!(
        "<div class=\"grid\">{}</div>\n<p>{}</p>\n{}",
        curve(report, survey),
        sentences.join(" "),
        modes(survey)
    )
}

/// Draws the number of modes of each trial against its simulations.
fn curve(report: &RunReport, survey: &ModeSurvey) -> String {
    let trials: Vec<_> = report.searches().take(MAX_LINES).collect();
    let longest =
        trials.iter().map(|trial| trial.summary.counts.simulations).max().unwrap_or(1).max(2) as f64;
    let lines = trials.iter().map(|trial| {
        let found = survey.curve(trial.summary.trial.number);
        let steps = found.iter().zip(1..).map(|(number, modes)| [f64::from(*number), f64::from(modes)]);
        let end = [trial.summary.counts.simulations as f64, found.len() as f64];
        Series::new(color::FAIL, Mark::Step, std::iter::once([0.0, 0.0]).chain(steps).chain([end]))
    });
    let most = survey.modes.modes.len().max(1) as f64;
    let panel = Panel {
        title: String::new(),
        x: linear("simulations of the trial", [0.0, longest]),
        y: linear("failure modes", [0.0, 1.06 * most]),
        areas: Vec::new(),
        series: lines.collect(),
        marks: Vec::new(),
    };
    let title = String::new();
    let caption = String::new();
    let legend = Vec::new();
    let chart = Chart { title, caption, legend, columns: 1, panel_size: SIZE, panels: vec![panel] };
    let text = format!("Failure modes against simulations of {} trials", trials.len());
    let caption = "One line for each trial: the failure modes that it has found so far.";
    figure(&chart.figure(&visible(&text)), "Failure modes.", caption)
}

fn unseen_text(unseen: &UnseenModes) -> String {
    format!(
        "Of {}, {} found by one trial only. So another trial would find about <b>{} new</b> on average, and such trials can find at \
         least about {} in all (Chao2 estimate).",
        mishandle_text::plural(unseen.trials, "trial"),
        match unseen.found_once {
            1 => "1 mode was".to_string(),
            n => format!("{n} modes were"),
        },
        number(unseen.expected_new),
        number(unseen.total)
    )
}

fn coverage_text(coverage: &Coverage) -> Option<String> {
    let visited = coverage.visited_fraction()?;
    let failing = coverage.failing_fraction()?;
    Some(format!(
        "Pairwise coverage: the simulations visited {} of the {} cells of {} with 10 bins for each axis, and failed in {} of the \
         visited ones. This says nothing about the rest of a cell, or about three axes together.",
        percent(visited),
        coverage.cells,
        if coverage.pairs == 1 {
            "the pair of axes".to_string()
        } else {
            format!("{} pairs of axes", coverage.pairs)
        },
        percent(failing)
    ))
}

/// Returns the table of the modes and the trials that found them.
fn modes(survey: &ModeSurvey) -> String {
    let rows = survey.modes.modes.iter().zip(&survey.first).zip(1..).take(MAX_MODES);
    let rows: Vec<Vec<String>> = rows
        .map(|((mode, first), index)| {
            let earliest = first.values().min().map_or("–".to_string(), u32::to_string);
            vec![index.to_string(), mode.failures.len().to_string(), first.len().to_string(), earliest]
        })
        .collect();
    table(
        "Failure modes",
        &["mode", "failures", "trials that found it", "earliest simulation of a trial"],
        &rows,
    )
}
