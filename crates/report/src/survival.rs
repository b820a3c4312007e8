//! Survival curves: the share of trials without a failure over their simulations.

use crate::charts::{Chart, ChartAxis, Mark, Panel, Series};
use mishandle::evaluation::{Lifetime, SurvivalCurve, SurvivalStep};

use crate::color;
use crate::html::{figure, percent, text, visible};
use crate::space::linear;

/// Trials that are shown as one curve.
#[derive(Clone, Debug)]
pub struct SurvivalLine<'a> {
    /// Common property of the trials, such as the name of the search; may be empty if there is one
    /// curve.
    pub name: &'a str,
    /// When each trial failed or ended.
    pub lifetimes: Vec<Lifetime>,
}

/// Color and mark of each curve. Curves differ in both, for readers who see no colors.
const STYLES: [(&str, Mark, &str); 4] = [
    (color::PASS, Mark::Step, ""),
    (color::FAIL, Mark::DashedStep, "6 4"),
    (color::LIMIT, Mark::ThinStep, ""),
    (color::FOURTH, Mark::Step, ""),
];

/// Half the length of the tick of a trial that ended without a failure, as a share of the axis.
const TICK: f64 = 0.025;

/// Returns a chart of Kaplan-Meier curves, with a legend if there are several. `title` and
/// `caption` are HTML; `end` is the least end of the axis of simulations.
pub fn survival_figure(
    title: &str,
    caption: &str,
    lines: &[SurvivalLine<'_>],
    end: u32,
    size: [u32; 2],
) -> String {
    let curves: Vec<SurvivalCurve> = lines.iter().map(|line| SurvivalCurve::new(&line.lifetimes)).collect();
    let end = curves.iter().map(|curve| curve.last).fold(end, u32::max);
    let mut series = Vec::new();
    let mut texts = Vec::new();
    let mut keys = String::new();
    for (index, (line, curve)) in lines.iter().zip(&curves).enumerate() {
        let (color, mark, dashes) = match lines {
            [_] => (color::FAIL, Mark::Step, ""),
            _ => STYLES[index % STYLES.len()],
        };
        let last = curve.at(curve.last);
        let step = |step: &SurvivalStep| [f64::from(step.simulations), curve.at(step.simulations)];
        let points = std::iter::once([0.0, 1.0])
            .chain(curve.steps.iter().map(step))
            .chain([[f64::from(curve.last), last]]);
        series.push(Series::new(color, mark, points));
        let mut censored: Vec<u32> = line
            .lifetimes
            .iter()
            .filter(|lifetime| !lifetime.failed)
            .map(|lifetime| lifetime.simulations)
            .collect();
        censored.sort_unstable();
        censored.dedup();
        let ticks = censored.iter().flat_map(|number| {
            let x = f64::from(*number);
            let y = curve.at(*number);
            [[x, y - TICK], [x, y + TICK]]
        });
        let tick_color = if lines.len() == 1 { color::PASS } else { color };
        series.push(Series::new(tick_color, Mark::Segment, ticks));
        let failed = line.lifetimes.iter().filter(|lifetime| lifetime.failed).count();
        let n = line.lifetimes.len();
        let name = if line.name.is_empty() { String::new() } else { format!("{}: ", line.name) };
        texts.push(format!("{name}{} after {} simulations", percent(last), curve.last));
        let width = if mark == Mark::ThinStep { 1 } else { 2 };
        keys.push_str(&format!(
            " <span class=\"whole\"><svg class=\"chart key\" width=\"26\" height=\"8\" aria-hidden=\"true\"><path d=\"M0 4h26\" \
             stroke=\"{color}\" stroke-width=\"{width}\" stroke-dasharray=\"{dashes}\"/></svg> {}{failed} of {n} failed</span>",
            text(&name)
        ));
    }
    let label = format!("Share of trials without a failure: {}", texts.join("; "));
    let panel = Panel {
        title: String::new(),
        x: linear("simulations of the trial", [0.0, f64::from(end)]),
        y: ChartAxis::percent("trials without a failure, %"),
        areas: Vec::new(),
        series,
        marks: Vec::new(),
    };
    let heading = String::new();
    let note = String::new();
    let legend = Vec::new();
    let chart =
        Chart { title: heading, caption: note, legend, columns: 1, panel_size: size, panels: vec![panel] };
    let keys = if lines.len() > 1 { keys } else { String::new() };
    figure(&chart.figure(&visible(&label)), title, &format!("{caption}{keys}"))
}
