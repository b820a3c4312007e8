//! Lines and bands on axes, as an SVG text.

use std::fmt::Write;

/// A picture of panels, two in a row, under a heading.
pub struct Chart {
    pub title: String,
    /// What the colors mean.
    pub legend: Vec<Entry>,
    pub panels: Vec<Panel>,
}

/// A color and its meaning.
pub struct Entry {
    pub label: String,
    pub color: &'static str,
}

/// Lines over a logarithmic axis; upward from 0 to 100 %.
pub struct Panel {
    /// Quantity and unit.
    pub x_label: String,
    pub y_label: String,
    /// From where to where, both above 0.
    pub range: [f64; 2],
    /// Marks on the axis, and what is written there.
    pub ticks: Vec<(f64, String)>,
    pub lines: Vec<Line>,
}

/// A line, and the band around it where there is one.
pub struct Line {
    pub color: &'static str,
    pub points: Vec<Point>,
}

/// A point of a line, its heights from 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    pub x: f64,
    pub y: f64,
    pub band: Option<[f64; 2]>,
}

const WIDTH: f64 = 960.0;
/// Room of the heading, and around the axes of a panel.
const HEADING: f64 = 64.0;
const PANEL: [f64; 2] = [WIDTH / 2.0, 270.0];
const LEFT: f64 = 62.0;
const RIGHT: f64 = 24.0;
const TOP: f64 = 14.0;
const BOTTOM: f64 = 52.0;

/// Shares of the height that are marked.
const HEIGHTS: [f64; 5] = [0.0, 0.25, 0.5, 0.75, 1.0];

/// Neither page, light or dark, shines through.
const BACKGROUND: &str = "#fbfbfa";
const INK: &str = "#2b2b2b";
const GRID: &str = "#dcdcda";

impl Chart {
    /// The picture.
    pub fn svg(&self) -> String {
        let rows = self.panels.len().div_ceil(2) as f64;
        let height = HEADING + rows * PANEL[1];
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" width=\"{WIDTH}\" \
             height=\"{height}\" font-family=\"sans-serif\" font-size=\"13\" fill=\"{INK}\">\n\
             <rect width=\"{WIDTH}\" height=\"{height}\" rx=\"6\" fill=\"{BACKGROUND}\"/>\n"
        );
        text(&mut svg, [LEFT, 26.0], "font-size=\"17\" font-weight=\"600\"", &self.title);
        let mut x = LEFT;
        for Entry { label, color } in &self.legend {
            let end = x + 22.0;
            let _ = writeln!(
                svg,
                "<line x1=\"{x}\" y1=\"46\" x2=\"{end}\" y2=\"46\" stroke=\"{color}\" stroke-width=\"3\"/>"
            );
            text(&mut svg, [end + 6.0, 50.5], "", label);
            // A letter is about 7.2 wide.
            x = end + 26.0 + 7.2 * label.chars().count() as f64;
        }
        for (i, panel) in self.panels.iter().enumerate() {
            let corner = [(i % 2) as f64 * PANEL[0], HEADING + (i / 2) as f64 * PANEL[1]];
            panel.draw(corner, &mut svg);
        }
        svg + "</svg>\n"
    }
}

impl Panel {
    fn draw(&self, corner: [f64; 2], svg: &mut String) {
        let (left, right) = (corner[0] + LEFT, corner[0] + PANEL[0] - RIGHT);
        let (top, bottom) = (corner[1] + TOP, corner[1] + PANEL[1] - BOTTOM);
        let [low, high] = self.range.map(f64::ln);
        let place_x = |x: f64| left + (right - left) * (x.ln() - low) / (high - low);
        let place_y = |y: f64| bottom + (top - bottom) * y;
        for height in HEIGHTS {
            let y = place_y(height);
            rule(svg, [left, y], [right, y]);
            let label = format!("{:.0}", 100.0 * height);
            text(svg, [left - 8.0, y + 4.5], "text-anchor=\"end\"", &label);
        }
        for (x, label) in &self.ticks {
            let x = place_x(*x);
            rule(svg, [x, top], [x, bottom]);
            text(svg, [x, bottom + 18.0], "text-anchor=\"middle\"", label);
        }
        let middle = [0.5 * (left + right), 0.5 * (top + bottom)];
        text(svg, [middle[0], bottom + 38.0], "text-anchor=\"middle\"", &self.x_label);
        let x = corner[0] + 16.0;
        let turned = format!("text-anchor=\"middle\" transform=\"rotate(-90 {x} {})\"", middle[1]);
        text(svg, [x, middle[1]], &turned, &self.y_label);
        for line in &self.lines {
            line.draw(&place_x, &place_y, svg);
        }
    }
}

impl Line {
    fn draw(&self, place_x: &dyn Fn(f64) -> f64, place_y: &dyn Fn(f64) -> f64, svg: &mut String) {
        let place = |(x, y): (f64, f64)| format!("{:.1},{:.1}", place_x(x), place_y(y));
        let banded: Vec<(f64, [f64; 2])> =
            self.points.iter().filter_map(|point| Some((point.x, point.band?))).collect();
        let around: Vec<String> = (banded.iter().map(|(x, [low, _])| (*x, *low)))
            .chain(banded.iter().rev().map(|(x, [_, high])| (*x, *high)))
            .map(place)
            .collect();
        let color = self.color;
        if !around.is_empty() {
            let points = around.join(" ");
            let _ = writeln!(svg, "<polygon points=\"{points}\" fill=\"{color}\" fill-opacity=\"0.2\"/>");
        }
        if let [point] = self.points.as_slice() {
            let (x, y) = (place_x(point.x), place_y(point.y));
            let _ = writeln!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3\" fill=\"{color}\"/>");
        }
        let along: Vec<String> = self.points.iter().map(|point| place((point.x, point.y))).collect();
        let _ = writeln!(
            svg,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"2\" stroke-linejoin=\"round\"/>",
            along.join(" ")
        );
    }
}

fn rule(svg: &mut String, [x1, y1]: [f64; 2], [x2, y2]: [f64; 2]) {
    let ends = format!("x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\"");
    let _ = writeln!(svg, "<line {ends} stroke=\"{GRID}\"/>");
}

fn text(svg: &mut String, [x, y]: [f64; 2], attributes: &str, words: &str) {
    let words = words.replace('&', "&amp;").replace('<', "&lt;");
    let _ = writeln!(svg, "<text x=\"{x:.1}\" y=\"{y:.1}\" {attributes}>{words}</text>");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_lie_where_the_axes_say() {
        let point = |x, y, band| Point { x, y, band };
        let panel = Panel {
            x_label: "steps".to_string(),
            y_label: "success & more, %".to_string(),
            range: [1.0, 100.0],
            ticks: vec![(10.0, "10".to_string())],
            lines: vec![Line {
                color: "#000",
                points: vec![
                    point(1.0, 0.0, None),
                    point(10.0, 0.5, Some([0.25, 1.0])),
                    point(100.0, 1.0, None),
                ],
            }],
        };
        let chart = Chart { title: "a < b".to_string(), legend: vec![], panels: vec![panel] };
        let svg = chart.svg();
        // The panel's axes go from 62 to 456 and from 64 + 14 = 78 down to 64 + 270 - 52 = 282. On a logarithmic axis 10
        // is halfway from 1 to 100.
        assert!(svg.contains("<polyline points=\"62.0,282.0 259.0,180.0 456.0,78.0\""), "{svg}");
        assert!(svg.contains("<polygon points=\"259.0,231.0 259.0,78.0\""), "{svg}");
        assert!(svg.contains("x1=\"259.0\" y1=\"78.0\" x2=\"259.0\" y2=\"282.0\""), "{svg}");
        assert!(svg.contains(">a &lt; b</text>") && svg.contains(">success &amp; more, %</text>"), "{svg}");
    }
}
