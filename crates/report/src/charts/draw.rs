use std::ops::Range;

use plotters::coord::Shift;
use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use crate::charts::linked_mark::escaped;
use crate::charts::{Area as Filled, Chart, ChartAxis, LinkedMark, Mark, Panel, Point, Scale, Series};

/// Opaque, so that neither a light nor a dark page shines through.
const BACKGROUND: RGBColor = RGBColor(0xfb, 0xfb, 0xfa);
const INK: RGBColor = RGBColor(0x2b, 0x2b, 0x2b);
const GRID: RGBColor = RGBColor(0xdc, 0xdc, 0xda);
const FONT: &str = "sans-serif";

/// Heights of the title, and of each line below it, pixels.
const TITLE_HEIGHT: u32 = 38;
const LINE_HEIGHT: u32 = 22;
/// Space left of the heading, pixels.
const LEFT: i32 = 20;
/// Approximate width of a letter of the legend, pixels; no font is loaded to measure it.
const LETTER: f64 = 7.0;
/// Opacity of a band.
const BAND_OPACITY: f64 = 0.2;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn<'a> = Result<(), DrawingAreaErrorKind<<SVGBackend<'a> as DrawingBackend>::ErrorType>>;

impl Chart {
    /// Returns the chart as the text of an SVG file.
    ///
    /// # Panics
    /// Never: a string takes everything that is drawn into it.
    pub fn svg(&self) -> String {
        let columns = self.columns.max(1);
        let rows = self.panels.len().div_ceil(columns).max(1);
        let lines = u32::from(!self.legend.is_empty()) + self.caption.lines().count() as u32;
        let title = if self.title.is_empty() { 0 } else { TITLE_HEIGHT };
        let heading = title + lines * LINE_HEIGHT;
        let [width, height] = self.panel_size;
        let size = (width * columns as u32, heading + height * rows as u32);
        let mut svg = String::new();
        let mut marks = String::new();
        let area = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        self.draw(&area, title, heading, (rows, columns), &mut marks)
            .expect("a string takes everything that is drawn into it");
        drop(area);
        if let Some(end) = svg.rfind("</svg>") {
            svg.insert_str(end, &marks);
        }
        svg
    }

    /// Returns the chart as an element of an HTML page, with `label` as its text for screen
    /// readers. It is of class `chart` and shrinks to the width of the page.
    ///
    /// Colors are the attributes `fill` and `stroke` with values such as `#D55E00`, in upper case,
    /// which a style sheet can match: `[fill="#D55E00"] { fill: orange }`.
    ///
    /// # Panics
    /// Never.
    pub fn figure(&self, label: &str) -> String {
        let svg = self.svg();
        let start = svg.find('>').map_or(0, |end| end + 1);
        let [width, height] = self.panel_size;
        let columns = self.columns.max(1);
        let width = width * columns as u32;
        let rows = self.panels.len().div_ceil(columns).max(1) as u32;
        let height = svg
            .get(..start)
            .and_then(|tag| tag.split_once("height=\"")?.1.split_once('"')?.0.parse().ok())
            .unwrap_or(height * rows);
        // With links inside, the element is not an image but a group of things to read.
        let role = if self.panels.iter().all(|panel| panel.marks.is_empty()) { "img" } else { "group" };
        format!(
            "<svg class=\"chart\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" role=\"{role}\" \
             aria-label=\"{}\">{}",
            escaped(label),
            &svg[start..]
        )
    }

    fn draw<'a>(
        &self,
        area: &Area<'a>,
        title: u32,
        heading: u32,
        grid: (usize, usize),
        marks: &mut String,
    ) -> Drawn<'a> {
        area.fill(&BACKGROUND)?;
        let (head, body) = area.split_vertically(heading);
        self.draw_heading(&head, title)?;
        for (panel, area) in self.panels.iter().zip(body.split_evenly(grid)) {
            panel.draw(&area, marks)?;
        }
        area.present()
    }

    fn draw_heading<'a>(&self, area: &Area<'a>, title: u32) -> Drawn<'a> {
        let write = |words: &str, x: i32, y: i32, size: f64, style: FontStyle| {
            let font = (FONT, size, style).into_font().color(&INK);
            area.draw(&Text::new(words.to_string(), (x, y), font.pos(Pos::new(HPos::Left, VPos::Center))))
        };
        if !self.title.is_empty() {
            write(&self.title, LEFT, 22, 17.0, FontStyle::Bold)?;
        }
        let mut y = (title + LINE_HEIGHT / 2) as i32;
        if !self.legend.is_empty() {
            let mut x = LEFT;
            for entry in &self.legend {
                area.draw(&Rectangle::new([(x, y - 2), (x + 20, y + 2)], color(entry.color).filled()))?;
                write(&entry.label, x + 26, y, 13.0, FontStyle::Normal)?;
                x += 46 + (LETTER * entry.label.chars().count() as f64) as i32;
            }
            y += LINE_HEIGHT as i32;
        }
        for line in self.caption.lines() {
            write(line, LEFT, y, 12.0, FontStyle::Normal)?;
            y += LINE_HEIGHT as i32;
        }
        Ok(())
    }
}

impl Panel {
    fn draw<'a>(&self, area: &Area<'a>, marks: &mut String) -> Drawn<'a> {
        let x = &self.x;
        let y = &self.y;
        let has_names = x.scale == Scale::Category;
        let label_style = || (FONT, 12.0).into_font().color(&INK);
        let mut builder = ChartBuilder::on(area);
        builder
            .margin_top(if self.title.is_empty() { 8 } else { 4 })
            .margin_right(22)
            .margin_left(6)
            .margin_bottom(4)
            .x_label_area_size(if has_names { 96 } else { 44 })
            .y_label_area_size(54);
        if !self.title.is_empty() {
            builder.caption(&self.title, (FONT, 13.0).into_font().color(&INK));
        }
        let mut chart = builder.build_cartesian_2d(Places::of(x), Places::of(y))?;
        chart
            .configure_mesh()
            .x_labels(x.ticks.len().max(1))
            .y_labels(y.ticks.len().max(1))
            .x_label_formatter(&|place| {
                if has_names { String::new() } else { x.tick_label(*place) }
            })
            .y_label_formatter(&|place| y.tick_label(*place))
            .x_label_style(label_style())
            .y_label_style(label_style())
            .axis_desc_style(label_style())
            .x_desc(x.label.as_str())
            .y_desc(y.label.as_str())
            .bold_line_style(GRID)
            .light_line_style(TRANSPARENT)
            .axis_style(INK)
            .draw()?;
        let place = |x: f64, y: f64| (self.x.place(x), self.y.place(y));
        let rectangle = |area: &Filled| {
            let corners = [place(area.x[0], area.y[0]), place(area.x[1], area.y[1])];
            Rectangle::new(corners, color(area.color).filled())
        };
        chart.draw_series(self.areas.iter().map(rectangle))?;
        for series in &self.series {
            self.draw_series(&mut chart, series)?;
        }
        let is_finite = |mark: &&LinkedMark| mark.x.is_finite() && mark.y.is_finite();
        for mark in self.marks.iter().filter(is_finite) {
            let (column, row) = chart.backend_coord(&place(mark.x, mark.y));
            mark.write(column, row, marks);
        }
        if has_names {
            // plotters centers turned tick labels on the axis, so that they would cross it.
            let style =
                label_style().transform(FontTransform::Rotate90).pos(Pos::new(HPos::Left, VPos::Center));
            let (left, top) = area.get_base_pixel();
            for (place, name) in &x.ticks {
                let (column, row) = chart.backend_coord(&(*place, y.place(y.range[0])));
                area.draw(&Text::new(name.clone(), (column - left, row - top + 8), style.clone()))?;
            }
        }
        Ok(())
    }

    fn draw_series<'a>(
        &self,
        chart: &mut ChartContext<'_, SVGBackend<'a>, Cartesian2d<Places, Places>>,
        series: &Series,
    ) -> Drawn<'a> {
        let color = color(series.color);
        let place = |x: f64, y: f64| (self.x.place(x), self.y.place(y));
        let finite = series.points.iter().filter(|point| point.x.is_finite() && point.y.is_finite());
        let points: Vec<_> = finite.collect();
        let line: Vec<_> = points.iter().map(|point| place(point.x, point.y)).collect();
        let steps = || {
            let corners = line.windows(2).flat_map(|pair| [pair[0], (pair[1].0, pair[0].1)]);
            corners.chain(line.last().copied()).collect::<Vec<_>>()
        };
        let thin = color.stroke_width(1);
        let thick = color.stroke_width(2);
        match series.mark {
            Mark::Line => {}
            Mark::ThinLine => return chart.draw_series(LineSeries::new(line, thin)).map(drop),
            Mark::DashedLine => {
                return chart.draw_series(DashedLineSeries::new(line, 6, 4, thick)).map(drop);
            }
            Mark::Step => return chart.draw_series(LineSeries::new(steps(), thick)).map(drop),
            Mark::ThinStep => return chart.draw_series(LineSeries::new(steps(), thin)).map(drop),
            Mark::DashedStep => {
                return chart.draw_series(DashedLineSeries::new(steps(), 6, 4, thick)).map(drop);
            }
            Mark::Segment => {
                let segment = |pair: &[(f64, f64)]| PathElement::new(pair.to_vec(), thick);
                return chart.draw_series(line.chunks_exact(2).map(segment)).map(drop);
            }
            Mark::Dot => {
                let dot = |place: &(f64, f64)| Circle::new(*place, 2, color.filled());
                return chart.draw_series(line.iter().map(dot)).map(drop);
            }
            Mark::Bar => {
                let bar = |point: &&Point| {
                    Rectangle::new([(point.x - 0.4, 0.0), (point.x + 0.4, point.y)], color.filled())
                };
                return chart.draw_series(points.iter().map(bar)).map(drop);
            }
        }
        let ends: Vec<(f64, [f64; 2])> =
            points.iter().filter_map(|point| Some((point.x, point.band?))).collect();
        if ends.len() > 1 {
            let lower = ends.iter().map(|(x, [low, _])| place(*x, *low));
            let upper = ends.iter().rev().map(|(x, [_, high])| place(*x, *high));
            let band = Polygon::new(lower.chain(upper).collect::<Vec<_>>(), color.mix(BAND_OPACITY));
            chart.draw_series(std::iter::once(band))?;
        }
        if let [point] = line[..] {
            chart.draw_series(std::iter::once(Circle::new(point, 3, color.filled())))?;
        }
        chart.draw_series(LineSeries::new(line, thick)).map(drop)
    }
}

/// Returns the color that `#rrggbb` names; black for anything else.
fn color(name: &str) -> RGBColor {
    let number = name.strip_prefix('#').and_then(|digits| u32::from_str_radix(digits, 16).ok()).unwrap_or(0);
    let [_, red, green, blue] = number.to_be_bytes();
    RGBColor(red, green, blue)
}

/// An axis on its linear scale, with grid lines at its ticks alone.
struct Places {
    ends: [f64; 2],
    ticks: Vec<f64>,
}

impl Places {
    fn of(axis: &ChartAxis) -> Places {
        let ends = axis.range.map(|end| axis.place(end));
        Places { ends, ticks: axis.ticks.iter().map(|(value, _)| axis.place(*value)).collect() }
    }
}

impl Ranged for Places {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, place: &f64, limit: (i32, i32)) -> i32 {
        let (first, last) = limit;
        let [low, high] = self.ends;
        // Far outside of the axis, a place has no pixel; the nearest number stands for it.
        first.saturating_add((f64::from(last - first) * (place - low) / (high - low)).round() as i32)
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if hint.weight().allow_light_points() { Vec::new() } else { self.ticks.clone() }
    }

    fn range(&self) -> Range<f64> {
        self.ends[0]..self.ends[1]
    }
}
