//! Chart of a predicate: its two sides over time, with the threshold and the violation.

use crate::charts::{Area, Chart, Mark, Panel, Series};
use mishandle::stl::{Clock, Formula};

use crate::color;
use crate::html::{figure, short, text, visible};
use crate::map::SIZE;
use crate::space::{linear, sane};

/// Largest number of points of a line, an even number.
const MAX_POINTS: usize = 400;

/// Points of a line: time and value.
pub type Curve = Vec<[f64; 2]>;

/// A predicate over time.
pub struct PredicateChart<'a> {
    /// The predicate.
    pub predicate: &'a str,
    /// Label of the horizontal axis.
    pub time: &'a str,
    /// First and last time.
    pub range: [f64; 2],
    /// Time that the formula reads.
    pub window: Option<[f64; 2]>,
    /// Times of violation.
    pub violated: Vec<[f64; 2]>,
    /// Decisive time.
    pub decisive: Option<f64>,
    /// Whether the line shows a failure.
    pub is_failure: bool,
    /// Meaning of the marks.
    pub caption: &'a str,
}

impl PredicateChart<'_> {
    /// Returns the chart as HTML. `curve` has the values of a side of the predicate, `nominal`
    /// those of another simulation beside it, `unit` its unit. `None` if a value is missing.
    pub fn figure(
        &self,
        curve: impl Fn(&Formula) -> Option<Curve>,
        nominal: impl Fn(&Formula) -> Option<Curve>,
        unit: impl Fn(&str) -> String,
    ) -> Option<String> {
        let beside = lines(self.predicate, &nominal).unwrap_or_default();
        let lines = lines(self.predicate, &curve)?;
        let [start, end] = self.range;
        let all = lines.iter().chain(&beside).flat_map(|(_, line)| line.iter().map(|point| point[1]));
        let (low, high) = all
            .filter(|value| value.is_finite())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
        let margin = 0.08 * (high - low);
        let [low, high] = sane([low - margin, high + margin]);
        let area = |x: [f64; 2], color| Area { x, y: [low, high], color };
        let areas = self.window.map(|window| area(window, color::WINDOW)).into_iter();
        let areas = areas.chain(self.violated.iter().map(|span| area(*span, color::SHADE))).collect();
        let mut series = Vec::new();
        for (side, line) in &lines {
            if let Ok(limit) = side.parse::<f64>() {
                series.push(Series::new(color::LIMIT, Mark::DashedLine, [[start, limit], [end, limit]]));
                continue;
            }
            let first = if self.is_failure { color::FAIL } else { color::PASS };
            let color = if series.is_empty() { first } else { color::LIMIT };
            series.push(Series::new(color, Mark::Line, thinned(line)));
        }
        // Below the line of the failure.
        let other = beside.iter().find(|(side, _)| side.parse::<f64>().is_err());
        series.splice(0..0, other.map(|(_, line)| Series::new(color::PASS, Mark::Line, thinned(line))));
        if let Some(at) = self.decisive {
            series.push(Series::new(color::FAIL, Mark::ThinLine, [[at, low], [at, high]]));
        }
        let label = lines.iter().map(|(side, _)| side).find(|side| side.parse::<f64>().is_err());
        let label = label.map_or(String::new(), |side| match unit(side) {
            unit if unit.is_empty() => short(side, 34),
            unit => format!("{} ({})", short(side, 34), short(&unit, 10)),
        });
        let panel = Panel {
            title: String::new(),
            x: linear(self.time, self.range),
            y: linear(&label, [low, high]),
            areas,
            series,
            marks: Vec::new(),
        };
        let title = String::new();
        let caption = String::new();
        let legend = Vec::new();
        let chart = Chart { title, caption, legend, columns: 1, panel_size: SIZE, panels: vec![panel] };
        let says = format!("{label} over time, for the predicate {}", self.predicate);
        let svg = chart.figure(&visible(&says));
        Some(figure(&svg, &format!("<code>{}</code>", text(self.predicate)), self.caption))
    }
}

/// Returns the two sides of a predicate with their values, or its margin and 0.
fn lines(predicate: &str, curve: &dyn Fn(&Formula) -> Option<Curve>) -> Option<Vec<(String, Curve)>> {
    let values = |side: &str| match side.parse::<f64>() {
        Ok(_) => Some(Vec::new()),
        Err(_) => curve(&Formula::parse(side).ok()?),
    };
    if let Some([left, right]) = sides(predicate)
        && let (Some(x), Some(y)) = (values(&left), values(&right))
    {
        return Some(vec![(left, x), (right, y)]);
    }
    let margin = curve(&Formula::parse(predicate).ok()?)?;
    Some(vec![("margin of the predicate".to_string(), margin), ("0".to_string(), Vec::new())])
}

/// Returns at most [`MAX_POINTS`] points of a line: the least and the largest value of each
/// stretch, so that no peak is lost.
fn thinned(line: &[[f64; 2]]) -> Curve {
    if line.len() <= MAX_POINTS {
        return line.to_vec();
    }
    let stretches = line.chunks(line.len().div_ceil(MAX_POINTS / 2));
    let ends = stretches.flat_map(|stretch| {
        let by_value = |a: &usize, b: &usize| stretch[*a][1].total_cmp(&stretch[*b][1]);
        let least = (0..stretch.len()).min_by(by_value);
        let largest = (0..stretch.len()).max_by(by_value);
        let mut ends: Vec<usize> = least.into_iter().chain(largest).collect();
        ends.sort_unstable();
        ends.dedup();
        ends.into_iter().map(|index| stretch[index])
    });
    ends.collect()
}

/// Returns the texts of the predicates of a formula, in its order, each once.
pub fn predicates(formula: &Formula) -> Vec<String> {
    let mut found: Vec<String> = Vec::new();
    for text in formula.subformulas() {
        if sides(&text).is_some() && !found.contains(&text) {
            found.push(text);
        }
    }
    found
}

/// Returns the texts of the sides of a predicate; `None` for another formula.
fn sides(predicate: &str) -> Option<[String; 2]> {
    let nodes = Formula::parse(predicate).ok()?.subformula_nodes(&Clock::unknown()).ok()?;
    nodes.first()?.sides.clone()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thinned_line_keeps_its_least_and_largest_value_and_the_order_of_time() {
        let mut line: Curve = (0..10_001).map(|time| [f64::from(time), 0.0]).collect();
        (line[1234][1], line[7777][1]) = (5.0, -3.0);
        let found = thinned(&line);
        assert!(found.len() <= MAX_POINTS, "{}", found.len());
        assert!(found.contains(&[1234.0, 5.0]) && found.contains(&[7777.0, -3.0]));
        assert!(found.is_sorted_by(|a, b| a[0] < b[0]));
        assert_eq!(thinned(&line[..400]), line[..400]);
    }

    #[test]
    fn a_predicate_without_two_sides_is_drawn_by_its_margin() {
        let curve = |_: &Formula| Some(vec![[0.0, 1.0]]);
        let names = |text| lines(text, &curve).unwrap().into_iter().map(|(name, _)| name).collect::<Vec<_>>();
        assert_eq!(names("gap - 2 * speed >= 5"), ["gap - 2 * speed", "5"]);
        assert_eq!(names("abs(x) < y"), ["abs(x)", "y"]);
        assert_eq!(names("always(a <= b)"), ["margin of the predicate", "0"]);
    }
}
