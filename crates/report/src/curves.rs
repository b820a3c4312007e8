//! Charts over the simulations of the trials: progress of the search, distribution of the
//! robustness.

use crate::charts::{Area, Chart, ChartAxis, Mark, Panel, Series};

use crate::color;
use crate::html::{figure, visible};
use crate::load::RunReport;
use crate::map::SIZE;
use crate::space::{around, linear};
use crate::survival::{SurvivalLine, survival_figure};

/// Largest number of trials with a line of their own.
const MAX_LINES: usize = 100;

const SURVIVAL: &str = "The share of trials that have not failed yet (Kaplan-Meier). A tick is a trial that ended without a failure.";

/// Number of bars of the distribution.
const BARS: f64 = 30.0;

/// Returns the charts of a run as HTML.
pub fn figures(report: &RunReport) -> String {
    let charts = if report.is_evaluation() {
        distribution(report)
    } else {
        let line = SurvivalLine { name: "", lifetimes: report.lifetimes() };
        let survival = survival_figure("Survival.", SURVIVAL, &[line], longest(report) as u32, SIZE);
        format!("{}{survival}", progress(report))
    };
    format!("<div class=\"grid\">{charts}</div>\n")
}

fn chart(x: ChartAxis, y: ChartAxis, areas: Vec<Area>, series: Vec<Series>, text: &str) -> String {
    let panel = Panel { title: String::new(), x, y, areas, series, marks: Vec::new() };
    let title = String::new();
    let caption = String::new();
    let legend = Vec::new();
    let chart = Chart { title, caption, legend, columns: 1, panel_size: SIZE, panels: vec![panel] };
    chart.figure(&visible(text))
}

/// Returns the largest number of simulations of a trial.
fn longest(report: &RunReport) -> f64 {
    report.searches().map(|trial| trial.summary.counts.simulations).max().unwrap_or(1).max(2) as f64
}

fn simulations_axis(report: &RunReport) -> ChartAxis {
    linear("simulations of the trial", [0.0, longest(report)])
}

/// Draws the lowest robustness so far of each trial.
fn progress(report: &RunReport) -> String {
    let trials: Vec<_> = report.searches().take(MAX_LINES).collect();
    let values = trials.iter().flat_map(|trial| trial.improvements.iter().map(|(_, rho)| *rho));
    let range = around(values);
    let x = simulations_axis(report);
    let lines = trials.iter().map(|trial| {
        let end = match trial.first_failure {
            Some(first) if report.survey.is_none() => f64::from(first),
            _ => trial.summary.counts.simulations as f64,
        };
        let last = trial.improvements.last().map(|(_, rho)| [end, *rho]);
        let points = trial.improvements.iter().map(|(number, rho)| [f64::from(*number), *rho]).chain(last);
        let (color, mark) = match trial.first_failure {
            Some(_) => (color::FAIL, Mark::Step),
            None => (color::PASS, Mark::ThinStep),
        };
        Series::new(color, mark, points)
    });
    let limit = Series::new(color::LIMIT, Mark::DashedLine, x.range.map(|end| [end, 0.0]));
    let series: Vec<Series> = std::iter::once(limit).chain(lines).collect();
    let falsified = trials.iter().filter(|trial| trial.first_failure.is_some()).count();
    let text = format!("Lowest robustness so far of {} trials; {falsified} of them go below 0", trials.len());
    let areas = if range[0] < 0.0 {
        vec![Area { x: x.range, y: [range[0], 0.0], color: color::SHADE }]
    } else {
        Vec::new()
    };
    let svg = chart(x, linear("lowest robustness so far", range), areas, series, &text);
    let caption = "One line for each trial: the lowest robustness it has found so far. A thick line goes to a failure, in the \
                   shaded half.";
    figure(&svg, "Progress of the search.", caption)
}

/// Draws how often each robustness occurs.
fn distribution(report: &RunReport) -> String {
    let values: Vec<f64> = report.robustness.iter().copied().filter(|rho| rho.is_finite()).collect();
    let [low, high] = crate::space::sane(around(values.iter().copied()));
    let width = (high - low) / BARS;
    let bars = bars(&values, width);
    let most = bars.iter().map(|(_, count)| *count).max().unwrap_or(1) as f64;
    let areas = bars.iter().map(|(index, count)| {
        let left = *index as f64 * width;
        let color = if *index < 0 { color::FAIL } else { color::PASS };
        Area { x: [left, left + width], y: [0.0, *count as f64], color }
    });
    let limit = Series::new(color::LIMIT, Mark::DashedLine, [[0.0, 0.0], [0.0, 1.06 * most]]);
    let text = format!("Distribution of the robustness of {} simulations", values.len());
    let svg = chart(
        linear("robustness", [low - width, high + width]),
        linear("simulations", [0.0, 1.06 * most]),
        areas.collect(),
        vec![limit],
        &text,
    );
    figure(
        &svg,
        "Robustness of the random simulations.",
        "Left of the dashed line the requirement is violated.",
    )
}

/// Counts the values in bars of this width, by the number of the bar. Bar 0 starts at 0, so that no
/// bar mixes violated and satisfied.
fn bars(values: &[f64], width: f64) -> Vec<(i64, usize)> {
    let mut bars: Vec<(i64, usize)> = Vec::new();
    for value in values {
        let index = (value / width).floor() as i64;
        match bars.iter_mut().find(|(known, _)| *known == index) {
            Some((_, count)) => *count += 1,
            None => bars.push((index, 1)),
        }
    }
    bars.sort_unstable();
    bars
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_bar_mixes_violated_and_satisfied() {
        assert_eq!(bars(&[0.1, -0.1, 0.0, 1.2, 0.9, -2.0], 1.0), [(-2, 1), (-1, 1), (0, 3), (1, 1)]);
    }
}
