//! Robustness maps: where in the space simulations fail.

use crate::charts::{Area, Chart, LinkedMark, Mark, Panel, Series, Shape};
use mishandle::inspect::ExplainedSimulation;
use mishandle::rollout::Axis;
use mishandle::run::has_random_rows;
use mishandle::stl::is_violated;
use mishandle::store::MAX_TRIALS;

use crate::html::{figure, number, percent, short};
use crate::load::{Point, RunReport};
use crate::ranking::Ranking;
use crate::space::{around, cells, chart_axis, edges, label, linear, value_text};
use crate::{color, tables};

/// Size of a chart, pixels. Small, so that the text stays readable on a phone.
pub const SIZE: [u32; 2] = [440, 330];

/// Cells per axis of a map of two axes, and of a projection of more.
const CELLS: usize = 36;
const PROJECTED_CELLS: usize = 14;

/// Largest distance from a simulation at which a map of two axes is painted, as a fraction of the
/// axes.
const REACH: f64 = 0.12;

/// Largest number of axes whose pairs are shown.
const PAIR_AXES: usize = 4;

/// Largest number of dots in a chart.
const MAX_DOTS: usize = 1200;

/// Fewest simulations of a map.
const FEWEST: usize = 10;

/// Largest number of failing simulations without a row in the table that have a mark.
const MAX_OTHERS: usize = 300;

/// Largest number of axis values in the text of a mark.
const TITLE_VALUES: usize = 6;

/// Values at which the colors are strongest: the worst violation, and a large margin.
struct ColorScale {
    /// `None` if nothing fails.
    violation: Option<f64>,
    margin: f64,
}

impl ColorScale {
    fn new(points: &[&Point]) -> ColorScale {
        let finite = points.iter().filter_map(|point| point.robustness).filter(|rho| rho.is_finite());
        let (mut negative, mut positive): (Vec<f64>, Vec<f64>) = finite.partition(|rho| is_violated(*rho));
        negative.sort_by(f64::total_cmp);
        positive.sort_by(f64::total_cmp);
        let margin = positive.get(positive.len().saturating_sub(1) * 19 / 20).copied().unwrap_or(1.0);
        ColorScale { violation: negative.first().map(|rho| -rho), margin: margin.max(f64::MIN_POSITIVE) }
    }

    fn color(&self, rho: f64) -> &'static str {
        let bin = |share: f64| ((4.0 * share) as usize).min(3);
        if is_violated(rho) {
            color::NEGATIVE[bin(-rho / self.violation.unwrap_or(1.0))]
        } else {
            color::POSITIVE[bin(rho / self.margin)]
        }
    }

    /// Returns the legend of the colors and marks.
    fn legend(&self) -> String {
        let cells = |names: &mut dyn Iterator<Item = &&str>| -> String {
            names.map(|name| format!("<i style=\"background:var({})\"></i>", variable(name))).collect()
        };
        let negative = cells(&mut color::NEGATIVE.iter().rev());
        let positive = cells(&mut color::POSITIVE.iter());
        let margin = number(self.margin);
        let Some(violation) = self.violation else {
            return format!(
                "<p class=\"legend\"><span>robustness 0 {positive} {margin} and more</span> <span><b class=\"pass\">•</b> \
                 passes</span></p>\n"
            );
        };
        format!(
            "<p class=\"legend\"><span>robustness {} {negative} 0 {positive} {margin} and more</span> <span><b \
             class=\"fail\">✕</b> fails</span> <span><b class=\"fail\">◆</b> described failure of a mode</span> <span><b \
             class=\"pass\">•</b> passes</span> <span><b class=\"fail\">━</b> border of the failing cells</span></p>\n",
            number(-violation)
        )
    }
}

/// Returns the variable of the style sheet for a color.
fn variable(name: &str) -> String {
    format!("--c{}", name.trim_start_matches('#').to_lowercase())
}

/// Returns the robustness maps of a run: HTML. `id` is the number of the run on the page.
pub fn figures(report: &RunReport, id: usize) -> String {
    let random = report.measured.as_ref().map_or(&[][..], |measured| &measured.scenarios);
    let recorded = report.points.iter().filter(|point| point.robustness.is_some()).count();
    let all = report.points.iter().chain(random);
    let decided: Vec<&Point> = all.filter(|point| point.robustness.is_some()).collect();
    let has_values = |index: &usize| {
        !report.axes[*index].is_fixed() && decided.iter().any(|point| value(point, *index).is_some())
    };
    let axes: Vec<usize> = (0..report.axes.len()).filter(has_values).collect();
    if decided.is_empty() || axes.is_empty() {
        return "<p>No simulation has a verdict, so there is nothing to show.</p>\n".to_string();
    }
    let scale = ColorScale::new(&decided);
    let count = report.counts.simulations;
    let shown = match recorded as u64 {
        shown if shown < count => {
            format!(" {shown} of {count} simulations of the run are shown, failures first.")
        }
        _ => String::new(),
    };
    let shown = shown + &random_text(report, random);
    if axes.len() > 1 && decided.len() < FEWEST && !report.has_all_points() {
        return format!(
            "<p>The page has {} with a verdict, too few for a map.</p>\n",
            mishandle_text::plural(decided.len() as u64, "simulation")
        );
    }
    match axes[..] {
        [axis] => {
            let svg = Drawing { report, id, points: &decided }.line(axis);
            let caption = format!("Each mark is a simulation. The shaded half is violated.{shown}");
            format!("<div class=\"grid\">{}</div>\n", figure(&svg, "Robustness over the space.", &caption))
        }
        [x, y] => {
            let svg = Drawing { report, id, points: &decided }.plane(x, y, &scale);
            let caption = format!(
                "Each mark is a simulation. The color between marks is an interpolation (inverse distance), painted only near \
                 simulations; unpainted parts were not tested.{shown} {HINT}"
            );
            let figure = figure(&svg, "Robustness over the space.", &caption);
            format!("{}<div class=\"grid\">{figure}</div>\n", scale.legend())
        }
        _ => {
            let ranked: Vec<&Point> = if random.is_empty() {
                decided.clone()
            } else {
                random.iter().filter(|point| point.robustness.is_some()).collect()
            };
            let ranking = Ranking::new(
                &report.axes,
                &axes,
                &ranked,
                has_random_rows(&report.header) || !random.is_empty(),
                |point, axis| value(point, axis),
                |point| point.robustness,
            );
            let chosen = ranking.shown(PAIR_AXES);
            let failing = match report.counts.falsified {
                0 => "",
                _ => " an outlined cell contains a failure;",
            };
            let mut out = format!(
                "<p>{} A cell has the color of the lowest robustness of the simulations in it, whatever the values of the other \
                 axes;{failing} an unpainted cell contains no simulation.{shown} {HINT}</p>\n",
                ranking.sentence(&report.axes, chosen.len(), "robustness"),
            );
            out.push_str(&scale.legend());
            out.push_str("<div class=\"grid\">");
            for (first, x) in chosen.iter().enumerate() {
                for y in &chosen[first + 1..] {
                    let svg = Drawing { report, id, points: &decided }.projection(*x, *y, &scale);
                    let title = format!("{} and {}.", name(report, *x), name(report, *y));
                    out.push_str(&figure(&svg, &title, ""));
                }
            }
            out + "</div>\n"
        }
    }
}

/// Says what the random scenarios are that the page simulated, and how many of them fail.
fn random_text(report: &RunReport, random: &[Point]) -> String {
    let decided = random.iter().filter(|point| point.robustness.is_some()).count() as u64;
    if decided == 0 {
        return String::new();
    }
    let failing = random.iter().filter(|point| point.fails()).count() as u64;
    let without = random.len() as u64 - decided;
    let fail = if failing == 1 { "fails" } else { "fail" };
    if report.has_all_points() {
        return format!(
            " The page simulated each of the {} of the space: {failing} {fail}.",
            mishandle_text::plural(random.len() as u64, "point")
        );
    }
    // Repeats of a scenario with other seeds are not independent scenarios.
    let is_repeated = report.measured.as_ref().is_some_and(|measured| measured.noise.is_some());
    let rate = mishandle::evaluation::failure_rate(failing, without, random.len() as u64);
    let interval = match (rate.low, rate.high, is_repeated) {
        (Some(low), Some(high), false) => {
            format!(" (95 % interval {} to {})", percent(low), percent(high))
        }
        _ => String::new(),
    };
    format!(
        " The page simulated {} of the whole space: {failing} {fail}{interval}.",
        mishandle_text::plural(random.len() as u64, "random scenario")
    )
}

const HINT: &str = "Point at a mark to see the simulation, select it to go to its row.";

fn name(report: &RunReport, axis: usize) -> String {
    crate::html::text(&short(&report.axes[axis].name, 40))
}

fn value(point: &Point, axis: usize) -> Option<f64> {
    point.scenario.get(axis).copied().flatten().filter(|value| value.is_finite())
}

/// State that the maps of a run share.
struct Drawing<'a> {
    report: &'a RunReport,
    id: usize,
    points: &'a [&'a Point],
}

impl Drawing<'_> {
    /// Draws robustness over one axis.
    fn line(&self, axis: usize) -> String {
        let range = around(self.points.iter().filter_map(|point| point.robustness));
        let x = chart_axis(&self.report.axes[axis]);
        let areas = vec![Area { x: x.range, y: [range[0], 0.0], color: color::SHADE }];
        let limit = Series::new(color::LIMIT, Mark::DashedLine, x.range.map(|end| [end, 0.0]));
        let at = |point: &Point| Some([value(point, axis)?, point.robustness?]);
        let panel = Panel {
            title: String::new(),
            areas: if range[0] < 0.0 { areas } else { Vec::new() },
            series: vec![limit, self.dots(at)],
            marks: self.marks(at),
            x,
            y: linear("robustness", range),
        };
        self.chart(panel, &format!("Robustness over {}", label(&self.report.axes[axis])))
    }

    /// Draws a map of two axes, interpolated between the simulations.
    fn plane(&self, x: usize, y: usize, scale: &ColorScale) -> String {
        let axes = &self.report.axes;
        let places: Vec<([f64; 2], f64)> = self
            .points
            .iter()
            .filter_map(|point| {
                let at =
                    [axes[x].unit_coordinate(value(point, x)?), axes[y].unit_coordinate(value(point, y)?)];
                let rho = point.robustness?.clamp(-scale.violation.unwrap_or(0.0), scale.margin);
                (at[0].is_finite() && at[1].is_finite()).then_some((at, rho))
            })
            .collect();
        let columns = cells(&axes[x], CELLS);
        let rows = cells(&axes[y], CELLS);
        let field = |column: usize, row: usize| {
            let center = [(column as f64 + 0.5) / columns as f64, (row as f64 + 0.5) / rows as f64];
            interpolated(&places, center)
        };
        self.cells_chart(x, y, columns, rows, scale, &field)
    }

    /// Draws a map of two of the axes: the lowest robustness in each cell.
    fn projection(&self, x: usize, y: usize, scale: &ColorScale) -> String {
        let axes = &self.report.axes;
        // About two simulations in each cell.
        let most = ((0.5 * self.points.len() as f64).sqrt() as usize).clamp(4, PROJECTED_CELLS);
        let columns = cells(&axes[x], most);
        let rows = cells(&axes[y], most);
        let mut least: Vec<Option<f64>> = vec![None; columns * rows];
        for point in self.points {
            let cell = |axis: usize, cells: usize| {
                let u = axes[axis].unit_coordinate(value(point, axis)?);
                (0.0..=1.0).contains(&u).then_some(((u * cells as f64) as usize).min(cells - 1))
            };
            if let (Some(column), Some(row), Some(rho)) = (cell(x, columns), cell(y, rows), point.robustness)
            {
                let known = &mut least[row * columns + column];
                *known = Some(known.map_or(rho, |known| known.min(rho)));
            }
        }
        self.cells_chart(x, y, columns, rows, scale, &|column, row| least[row * columns + column])
    }

    fn cells_chart(
        &self,
        x: usize,
        y: usize,
        columns: usize,
        rows: usize,
        scale: &ColorScale,
        field: &dyn Fn(usize, usize) -> Option<f64>,
    ) -> String {
        let axes = &self.report.axes;
        let x_edges = edges(&axes[x], columns);
        let y_edges = edges(&axes[y], rows);
        let values: Vec<Option<f64>> =
            (0..rows).flat_map(|row| (0..columns).map(move |column| field(column, row))).collect();
        let mut areas = Vec::new();
        for row in 0..rows {
            let mut column = 0;
            // Neighbors of one color are one area.
            while column < columns {
                let color_at = |column: usize| values[row * columns + column].map(|rho| scale.color(rho));
                let end =
                    (column..columns).find(|other| color_at(*other) != color_at(column)).unwrap_or(columns);
                areas.extend(color_at(column).map(|color| Area {
                    x: [x_edges[column], x_edges[end]],
                    y: [y_edges[row], y_edges[row + 1]],
                    color,
                }));
                column = end;
            }
        }
        let fails = |column: Option<usize>, row: Option<usize>| match (column, row) {
            (Some(column), Some(row)) if column < columns && row < rows => {
                values[row * columns + column].is_some_and(is_violated)
            }
            _ => false,
        };
        let mut border = Vec::new();
        for row in 0..=rows {
            for column in 0..=columns {
                let left = column.checked_sub(1);
                let below = row.checked_sub(1);
                if row < rows && fails(Some(column), Some(row)) != fails(left, Some(row)) {
                    border.extend([[x_edges[column], y_edges[row]], [x_edges[column], y_edges[row + 1]]]);
                }
                if column < columns && fails(Some(column), Some(row)) != fails(Some(column), below) {
                    border.extend([[x_edges[column], y_edges[row]], [x_edges[column + 1], y_edges[row]]]);
                }
            }
        }
        let at = |point: &Point| Some([value(point, x)?, value(point, y)?]);
        let panel = Panel {
            title: String::new(),
            x: chart_axis(&axes[x]),
            y: chart_axis(&axes[y]),
            areas,
            series: vec![self.dots(at), Series::new(color::FAIL, Mark::Segment, border)],
            marks: self.marks(at),
        };
        self.chart(panel, &format!("Robustness over {} and {}", label(&axes[x]), label(&axes[y])))
    }

    fn chart(&self, panel: Panel, what: &str) -> String {
        let failing = self.points.iter().filter(|point| point.fails()).count();
        let text = format!("{what}: {failing} of {} shown simulations fail", self.points.len());
        let panels = vec![panel];
        let title = String::new();
        let caption = String::new();
        let legend = Vec::new();
        let chart = Chart { title, caption, legend, columns: 1, panel_size: SIZE, panels };
        chart.figure(&crate::html::visible(&text))
    }

    /// Returns the passing simulations.
    fn dots(&self, at: impl Fn(&Point) -> Option<[f64; 2]>) -> Series {
        let passing: Vec<[f64; 2]> =
            self.points.iter().filter(|point| !point.fails()).filter_map(|point| at(point)).collect();
        let every = passing.len().div_ceil(MAX_DOTS).max(1);
        Series::new(color::PASS, Mark::Dot, passing.into_iter().step_by(every))
    }

    /// Returns the simulations that have a row in the table, other failures, and the described
    /// failures.
    fn marks(&self, at: impl Fn(&Point) -> Option<[f64; 2]>) -> Vec<LinkedMark> {
        let mark = |point: &Point| {
            let [x, y] = at(point)?;
            let (shape, color) =
                if point.fails() { (Shape::Cross, color::FAIL) } else { (Shape::Ring, color::PASS) };
            let row = || format!("#{}", tables::row_id(self.id, point.trial, point.number));
            let href = if point.is_linked { row() } else { String::new() };
            Some(LinkedMark { x, y, shape, color, href, label: self.title(point), is_tab_stop: false })
        };
        let described = |(index, explained): (usize, &ExplainedSimulation)| {
            let point = Point::from(explained.recorded.clone());
            let [x, y] = at(&point)?;
            Some(LinkedMark {
                x,
                y,
                shape: Shape::Diamond,
                color: color::FAIL,
                href: format!("#{}", tables::mode_id(self.id, index)),
                label: format!("mode {}: {}", index + 1, self.title(&point)),
                is_tab_stop: true,
            })
        };
        let (linked, others): (Vec<&Point>, Vec<&Point>) =
            self.points.iter().copied().partition(|point| point.is_linked);
        let others = others.into_iter().filter(|point| point.fails()).take(MAX_OTHERS);
        let mut marks: Vec<LinkedMark> = linked.into_iter().chain(others).filter_map(mark).collect();
        // Failures on top.
        marks.sort_by_key(|mark| mark.shape as u8);
        marks.extend(self.report.representatives.iter().enumerate().filter_map(described));
        marks
    }

    fn title(&self, point: &Point) -> String {
        let rho =
            point.robustness.map_or("no verdict".to_string(), |rho| format!("robustness {}", number(rho)));
        let named = self.report.axes.iter().zip(&point.scenario).take(TITLE_VALUES);
        let value = |(axis, value): (&Axis, &Option<f64>)| {
            format!("{} = {}", short(&axis.name, 40), value_text(axis, *value))
        };
        let values: Vec<String> = named.map(value).collect();
        let more = if self.report.axes.len() > TITLE_VALUES { ", …" } else { "" };
        let place = match point.trial {
            0 if self.report.has_all_points() => "simulated for this page".to_string(),
            0 => "random scenario of this page".to_string(),
            trial if trial > MAX_TRIALS => format!("trial {}, moved toward nominal", trial - MAX_TRIALS),
            trial => format!("trial {trial}, simulation {}", point.number),
        };
        format!("{place}: {rho}; {}{more}", values.join(", "))
    }
}

/// Returns the mean of the values at `places`, weighted by the inverse fourth power of the distance
/// from `center`; `None` if none of them is near.
///
/// # Reference
/// Shepard, "A two-dimensional interpolation function for irregularly-spaced data", ACM National
/// Conference 1968.
fn interpolated(places: &[([f64; 2], f64)], center: [f64; 2]) -> Option<f64> {
    let mut sum = 0.0;
    let mut weights = 0.0;
    let mut nearest = f64::INFINITY;
    for ([x, y], rho) in places {
        let square = (x - center[0]).powi(2) + (y - center[1]).powi(2);
        let weight = 1.0 / (square * square + 1e-12);
        sum += weight * rho;
        weights += weight;
        nearest = nearest.min(square);
    }
    (nearest <= REACH * REACH && weights > 0.0).then(|| sum / weights)
}

/// Returns the name of an axis with its unit, as HTML.
pub fn axis_label(axis: &Axis) -> String {
    crate::html::text(&label(axis))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_interpolation_meets_the_simulations_and_leaves_the_rest_blank() {
        let places = [([0.1, 0.1], -1.0), ([0.2, 0.1], 3.0)];
        assert!((interpolated(&places, [0.1, 0.1]).unwrap() + 1.0).abs() < 1e-6);
        assert!((interpolated(&places, [0.15, 0.1]).unwrap() - 1.0).abs() < 1e-9);
        assert_eq!(interpolated(&places, [0.6, 0.6]), None);
    }
}
