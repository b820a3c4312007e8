//! Charts as SVG text: lines with bands, steps, bars, dots and filled areas, in panels that share a
//! title and a legend.
//!
//! `plotters` draws them with its SVG backend alone, which loads no fonts, so the same chart gives
//! the same bytes on every machine. The background is opaque: a chart looks the same on a light and
//! on a dark page. [`Chart::figure`] returns the same drawing as an element of an HTML page, whose
//! style sheet can replace each color.
//!
//! # Example
//! ```
//! use mishandle_report::charts::{ChartAxis, Chart, LegendEntry, Panel, Point, Series};
//! let point = |x, y| Point { x, y, band: Some([y - 0.1, y + 0.1]) };
//! let panel = Panel {
//!     title: String::new(),
//!     x: ChartAxis::logarithmic("environment steps", [1e3, 1e5], vec![(1e3, "1 k".into()), (1e5, "100 k".into())]),
//!     y: ChartAxis::percent("success rate, %"),
//!     areas: vec![],
//!     series: vec![Series::line("#0072b2", vec![point(1e3, 0.2), point(1e5, 0.9)])],
//!     marks: vec![],
//! };
//! let legend = vec![LegendEntry { label: "PPO".into(), color: "#0072b2" }];
//! let chart = Chart {
//!     title: "point-reaching".into(),
//!     caption: "band: 95 % interval".into(),
//!     legend,
//!     columns: 1,
//!     panel_size: [480, 270],
//!     panels: vec![panel],
//! };
//! assert!(chart.svg().contains("success rate, %"));
//! assert_eq!(chart.svg(), chart.svg());
//! ```

mod axis;
mod draw;
mod linked_mark;

pub use axis::{ChartAxis, Scale};
pub use linked_mark::{LinkedMark, Shape};

/// Panels in rows, below a title, a legend and a caption.
#[derive(Clone, Debug, PartialEq)]
pub struct Chart {
    /// Heading; empty for none.
    pub title: String,
    /// Says what a line and its band are, in one or more lines; empty for none.
    pub caption: String,
    /// Meaning of the colors.
    pub legend: Vec<LegendEntry>,
    /// Panels in a row, at least 1.
    pub columns: usize,
    /// Width and height of a panel with its labels, pixels.
    pub panel_size: [u32; 2],
    /// The panels, row by row.
    pub panels: Vec<Panel>,
}

/// A color and its meaning.
#[derive(Clone, Debug, PartialEq)]
pub struct LegendEntry {
    /// The meaning.
    pub label: String,
    /// The color, as `#rrggbb`.
    pub color: &'static str,
}

/// Axes and what is drawn between them.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    /// Heading; empty for none.
    pub title: String,
    /// The horizontal axis.
    pub x: ChartAxis,
    /// The vertical axis.
    pub y: ChartAxis,
    /// Drawn first, below the series.
    pub areas: Vec<Area>,
    /// Drawn in this order, later ones on top.
    pub series: Vec<Series>,
    /// Drawn last, on top.
    pub marks: Vec<LinkedMark>,
}

/// A filled rectangle, such as a cell of a heat map or a shaded span, in the units of the axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Area {
    /// Left and right end.
    pub x: [f64; 2],
    /// Lower and upper end.
    pub y: [f64; 2],
    /// The color, as `#rrggbb`.
    pub color: &'static str,
}

/// Points of one color.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// The color, as `#rrggbb`.
    pub color: &'static str,
    /// How the points are drawn.
    pub mark: Mark,
    /// The points, in ascending order of x.
    pub points: Vec<Point>,
}

impl Series {
    /// Returns a line through `points`, with a band where points have one.
    pub fn line(color: &'static str, points: Vec<Point>) -> Series {
        Series { color, mark: Mark::Line, points }
    }

    /// Returns points that are drawn with `mark`.
    pub fn new(color: &'static str, mark: Mark, points: impl IntoIterator<Item = [f64; 2]>) -> Series {
        Series { color, mark, points: points.into_iter().map(|[x, y]| Point { x, y, band: None }).collect() }
    }

    /// Returns a bar from 0 to each point.
    pub fn bars(color: &'static str, points: Vec<Point>) -> Series {
        Series { color, mark: Mark::Bar, points }
    }
}

/// How the points of a series are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// A line, with a band where points have one; a single point is a dot.
    Line,
    /// A thin line.
    ThinLine,
    /// A dashed line.
    DashedLine,
    /// Each value holds until the next point.
    Step,
    /// A thin line through steps.
    ThinStep,
    /// A dashed line through steps.
    DashedStep,
    /// A line from each even point to the next one.
    Segment,
    /// A dot at each point.
    Dot,
    /// Bars, 0.8 wide in units of x.
    Bar,
}

/// A point, in the units of the axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Horizontal position.
    pub x: f64,
    /// Vertical position.
    pub y: f64,
    /// Lower and upper end of the band.
    pub band: Option<[f64; 2]>,
}
