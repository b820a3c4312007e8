//! The page about the learning curve of a training run.

use crate::charts::{Chart, ChartAxis, LegendEntry, Mark, Panel, Series};
use mishandle::train::{Curve, CurveRow};
use mishandle_text::plural;

use crate::html::{figure, text, visible};
use crate::map::SIZE;
use crate::page::Document;
use crate::space::{around, linear};
use crate::{color, words};

/// Returns the page about a curve that `mishandle train --csv` wrote: one HTML file without
/// scripts, which loads nothing. `path` names the curve.
pub fn learning_curve_page(curve: &Curve, path: &str) -> String {
    let name = text(words::file_name(path));
    let sentences: String =
        sentences(curve).iter().map(|sentence| format!("<p>{}</p>\n", text(sentence))).collect();
    let body = format!(
        "<section>\n<h2>Learning curve {name}</h2>\n{sentences}<div class=\"grid\">{}{}</div>\n</section>\n",
        returns(curve),
        validations(curve)
    );
    Document { title: &format!("learning curve {name}"), up: None, body: &body }.html()
}

/// Returns the length of the training run, and its training time or why it has none.
fn sentences(curve: &Curve) -> Vec<String> {
    let length = curve.rows.last().map(|last| {
        format!(
            "{}, {} in {:.0} s",
            plural(curve.rows.len(), "iteration"),
            plural(last.environment_steps, "environment step"),
            last.wall_clock_secs
        )
    });
    let time = match curve.training_time() {
        Ok(row) => format!(
            "training time until the return converged: {}, {:.0} s",
            plural(row.environment_steps, "environment step"),
            row.wall_clock_secs
        ),
        Err(reason) => format!("no training time: {reason}"),
    };
    length.into_iter().chain([time]).collect()
}

/// Draws the mean return, with a dashed line at the training time.
fn returns(curve: &Curve) -> String {
    let points = points(curve, |row| row.mean_return);
    if points.is_empty() {
        return String::new();
    }
    let range = around(points.iter().map(|[_, value]| *value));
    let time = curve.training_time().ok().map(|row| row.environment_steps as f64);
    let line = time.map(|x| Series::new(color::LIMIT, Mark::DashedLine, range.map(|y| [x, y])));
    let series = line.into_iter().chain([Series::new(color::PASS, Mark::Line, points)]).collect();
    let chart = chart(
        curve,
        linear("mean return", range),
        series,
        Vec::new(),
        "Mean return of the training episodes",
    );
    let at = if time.is_some() { " The dashed line is at the training time." } else { "" };
    figure(
        &chart,
        "Return.",
        &format!("Mean return of the training episodes that ended in an iteration.{at}"),
    )
}

/// Draws the success rates of the validations.
fn validations(curve: &Curve) -> String {
    let success = points(curve, |row| row.validation.map(|found| found.success_rate));
    if success.is_empty() {
        return String::new();
    }
    let strict = points(curve, |row| row.validation.map(|found| found.strict_success_rate));
    let legend = [("success", color::PASS), ("strict success", color::FAIL)];
    let legend = legend.map(|(label, color)| LegendEntry { label: label.to_string(), color }).to_vec();
    let series =
        vec![Series::new(color::FAIL, Mark::Line, strict), Series::new(color::PASS, Mark::Line, success)];
    let chart = chart(
        curve,
        ChartAxis::percent("success rate, %"),
        series,
        legend,
        "Success rates of the validations",
    );
    figure(
        &chart,
        "Validation.",
        "Success rates on the episodes of the validations, without exploration noise.",
    )
}

/// Returns a quantity of the rows that have a finite value, against environment steps.
fn points(curve: &Curve, value: impl Fn(&CurveRow) -> Option<f64>) -> Vec<[f64; 2]> {
    let point =
        |row: &CurveRow| Some([row.environment_steps as f64, value(row).filter(|value| value.is_finite())?]);
    curve.rows.iter().filter_map(point).collect()
}

fn chart(curve: &Curve, y: ChartAxis, series: Vec<Series>, legend: Vec<LegendEntry>, says: &str) -> String {
    let steps = curve.rows.last().map_or(1.0, |row| row.environment_steps as f64);
    let x = linear("environment steps", [0.0, steps]);
    let panel = Panel { title: String::new(), x, y, areas: Vec::new(), series, marks: Vec::new() };
    let title = String::new();
    let caption = String::new();
    let chart = Chart { title, caption, legend, columns: 1, panel_size: SIZE, panels: vec![panel] };
    chart.figure(&visible(says))
}
