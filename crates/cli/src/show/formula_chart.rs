//! A formula over traces, as a chart.

use mishandle::results::{FormulaDescription, FormulaExample, FormulaLane, LaneState};
use mishandle_report::charts::{Area, Chart, ChartAxis, LegendEntry, Panel, Point, Scale, Series};
use mishandle_text::short_number;

const HOLDS: &str = "#009e73";
const VIOLATED: &str = "#d55e00";
const UNDECIDED: &str = "#bbbbbb";
const SIGNAL: &str = "#0072b2";

/// Largest number of traces, of signals of each, and of sub-formulas.
const MAX_TRACES: usize = 4;
const MAX_SIGNALS: usize = 6;
const MAX_LANES: usize = 12;

/// Largest number of points of a signal.
const MAX_POINTS: usize = 2000;

/// Size of a panel, pixels.
const PANEL: [u32; 2] = [900, 190];

/// Returns the drawing of the examples. The sub-formulas are rows, with their numbers in the
/// caption.
pub fn svg(found: &FormulaDescription) -> String {
    let panels = found.examples.iter().take(MAX_TRACES).flat_map(panels).collect();
    let states = [("holds", HOLDS), ("violated", VIOLATED), ("window beyond the end", UNDECIDED)];
    let legend = states.map(|(label, color)| LegendEntry { label: label.to_string(), color }).to_vec();
    let lanes = found.examples.first().map_or(&[][..], |example| &example.lanes);
    let named = lanes.iter().take(MAX_LANES).zip(1..).map(|(lane, number)| {
        let text: String = lane.formula.chars().take(130).collect();
        format!("{number}: {text}")
    });
    let caption = named.collect::<Vec<_>>().join("\n");
    Chart {
        title: found.formula.chars().take(110).collect(),
        caption,
        legend,
        columns: 1,
        panel_size: PANEL,
        panels,
    }
    .svg()
}

/// Returns the panels of a trace: its signals, then its sub-formulas.
fn panels(example: &FormulaExample) -> Vec<Panel> {
    let period = example.period.map_or(1.0, |period| period.0);
    let label = if example.period.is_some() { "time, s" } else { "sample" };
    let end = (example.samples.max(2) - 1) as f64 * period;
    let x = |label: &str| ChartAxis::linear(label, [0.0, end]);
    let mut panels = Vec::new();
    for values in example.values.iter().flatten().take(MAX_SIGNALS) {
        let step = values.values.len().div_ceil(MAX_POINTS).max(1);
        let points = values.values.iter().enumerate().step_by(step);
        let points: Vec<Point> =
            points.map(|(sample, y)| Point { x: sample as f64 * period, y: *y, band: None }).collect();
        let (low, high) = points.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), point| {
            (low.min(point.y), high.max(point.y))
        });
        let margin = if high > low { 0.1 * (high - low) } else { 1.0 };
        panels.push(Panel {
            title: values.signal.clone(),
            x: x(""),
            y: ChartAxis::linear("", [low - margin, high + margin]),
            areas: Vec::new(),
            series: vec![Series { color: SIGNAL, mark: mishandle_report::charts::Mark::Step, points }],
            marks: Vec::new(),
        });
    }
    let verdict = if example.violated { "violated" } else { "satisfied" };
    let head = format!("{} ({verdict}, robustness {})", example.name, short_number(example.robustness.0));
    let lanes: Vec<&FormulaLane> = example.lanes.iter().take(MAX_LANES).collect();
    let color = |state: LaneState| match state {
        LaneState::Holds => HOLDS,
        LaneState::Violated => VIOLATED,
        LaneState::Undecided => UNDECIDED,
    };
    let count = lanes.len() as f64;
    let areas = lanes.iter().enumerate().flat_map(|(row, lane)| {
        let top = count - row as f64;
        // Each sample is drawn up to the next one.
        lane.spans.iter().map(move |span| Area {
            x: [span.first as f64 * period, ((span.last + 1) as f64 * period).min(end)],
            y: [top - 0.9, top - 0.1],
            color: color(span.state),
        })
    });
    let ticks = (0..lanes.len()).map(|row| (count - row as f64 - 0.5, (row + 1).to_string())).collect();
    panels.push(Panel {
        title: head,
        x: x(label),
        y: ChartAxis { label: String::new(), range: [0.0, count.max(1.0)], scale: Scale::Linear, ticks },
        areas: areas.collect(),
        series: Vec::new(),
        marks: Vec::new(),
    });
    panels
}
