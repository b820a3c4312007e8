//! Charts of a failing simulation: signals over time with their thresholds and the violation.

use mishandle::inspect::{ExplainedSimulation, unit};
use mishandle::stl::{Clock, Formula, Monitor, Trace, is_satisfied};
use mishandle::store::RunHeader;
use mishandle_charts::{Area, Chart, Mark, Panel, Series};

use crate::color;
use crate::html::{figure, short, text, visible};
use crate::map::SIZE;
use crate::space::linear;

/// Largest number of points of a line.
const MAX_SAMPLES: usize = 400;

/// Largest number of charts of a simulation.
const MAX_CHARTS: usize = 4;

/// Returns charts of the decisive predicate and of the other predicates of the formula, as HTML.
pub fn figures(header: &RunHeader, explained: &ExplainedSimulation) -> Vec<String> {
    let explanation = &explained.explanation;
    let decisive = explanation.diagnosis.predicate.as_ref().map(|predicate| predicate.text.as_str());
    let others = explanation.predicates.iter().map(String::as_str);
    let mut texts: Vec<&str> = Vec::new();
    for text in decisive.into_iter().chain(others) {
        if !texts.contains(&text) {
            texts.push(text);
        }
    }
    let charts = texts.into_iter().take(MAX_CHARTS);
    charts
        .filter_map(|predicate| predicate_figure(header, explained, predicate, Some(predicate) == decisive))
        .collect()
}

fn predicate_figure(
    header: &RunHeader,
    explained: &ExplainedSimulation,
    predicate: &str,
    is_decisive: bool,
) -> Option<String> {
    let sides = sides(predicate);
    let values = |side: &String| values(side, &explained.trace, header.control_dt);
    let found = sides.as_ref().and_then(|[left, right]| Some([values(left)?, values(right)?]));
    let lines: Vec<(String, Vec<f64>)> = match (sides, found) {
        (Some([left, right]), Some([x, y])) => vec![(left, x), (right, y)],
        _ => vec![
            ("margin of the predicate".to_string(), values(&predicate.to_string())?),
            ("0".to_string(), vec![0.0]),
        ],
    };
    let time = |sample: f64| sample * header.control_dt;
    let end = time(explained.trace.len().saturating_sub(1).max(1) as f64);
    let all = lines.iter().flat_map(|(_, values)| values.iter().copied()).filter(|value| value.is_finite());
    let (low, high) =
        all.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
    let margin = 0.08 * (high - low);
    let [low, high] = crate::space::sane([low - margin, high + margin]);
    let mut areas = Vec::new();
    let mut series = Vec::new();
    let history = explained.explanation.history.as_ref().filter(|_| is_decisive);
    if let Some(history) = history {
        let (first, last) = history.window;
        areas.push(Area { x: [time(first as f64), time(last as f64)], y: [low, high], color: color::WINDOW });
        for (from, to) in spans(&history.robustness, (first, last)) {
            let x = [time(from as f64 - 0.5).max(0.0), time(to as f64 + 0.5).min(end)];
            areas.push(Area { x, y: [low, high], color: color::SHADE });
        }
    }
    for (side, values) in &lines {
        let is_limit = side.parse::<f64>().is_ok();
        if let (true, Some(limit)) = (is_limit, values.first()) {
            series.push(Series::new(color::LIMIT, Mark::DashedLine, [[0.0, *limit], [end, *limit]]));
            continue;
        }
        let every = values.len().div_ceil(MAX_SAMPLES).max(1);
        let points =
            values.iter().enumerate().step_by(every).map(|(sample, value)| [time(sample as f64), *value]);
        let (color, mark) =
            if series.is_empty() { (color::PASS, Mark::Line) } else { (color::LIMIT, Mark::Line) };
        series.push(Series::new(color, mark, points));
    }
    if let (Some(decided), true) = (&explained.explanation.diagnosis.predicate, is_decisive) {
        let at = time(decided.sample as f64);
        series.push(Series::new(color::FAIL, Mark::ThinLine, [[at, low], [at, high]]));
    }
    let label = lines.iter().map(|(side, _)| side).find(|side| side.parse::<f64>().is_err());
    let label = label.map_or(String::new(), |side| {
        let unit = unit(header, side);
        format!(
            "{}{}",
            short(side, 34),
            if unit.is_empty() { String::new() } else { format!(" ({})", short(&unit, 10)) }
        )
    });
    let panel = Panel {
        title: String::new(),
        x: linear("time (s)", [0.0, end]),
        y: linear(&label, [low, high]),
        areas,
        series,
        marks: Vec::new(),
    };
    let (title, caption, legend) = (String::new(), String::new(), Vec::new());
    let chart = Chart { title, caption, legend, columns: 1, panel_size: SIZE, panels: vec![panel] };
    let svg = chart.figure(&visible(&format!("{label} over time, for the predicate {predicate}")));
    let caption = match is_decisive {
        true => {
            "Dashed: threshold. Gray: time that the formula reads. Orange: violated there. Vertical line: decisive instant."
        }
        false => "Dashed: threshold.",
    };
    Some(figure(&svg, &format!("<code>{}</code>", text(predicate)), caption))
}

/// Returns the two sides of a comparison.
fn sides(predicate: &str) -> Option<[String; 2]> {
    let mut depth = 0_i32;
    let mut bytes = predicate.char_indices().peekable();
    while let Some((at, c)) = bytes.next() {
        match c {
            '(' | '[' => depth += 1,
            ')' | ']' => depth -= 1,
            '<' | '>' | '=' | '!' if depth == 0 => {
                let length = if bytes.peek().is_some_and(|(_, next)| *next == '=') { 2 } else { 1 };
                let sides = [&predicate[..at], &predicate[at + length..]];
                return Some(sides.map(|side| side.trim().to_string()));
            }
            _ => {}
        }
    }
    None
}

/// Returns the values of a term over the trace.
fn values(term: &str, trace: &Trace, control_dt: f64) -> Option<Vec<f64>> {
    if let Ok(number) = term.parse::<f64>() {
        return Some(vec![number]);
    }
    let formula = Formula::parse(term).ok()?;
    let mut monitor = Monitor::new(&formula, trace.names(), Clock::steps(control_dt)).ok()?;
    Some(monitor.robustness_signal(trace).ok()?.to_vec())
}

/// Returns the first and last sample of each violation within the window.
fn spans(robustness: &[f64], (first, last): (usize, usize)) -> Vec<(usize, usize)> {
    let mut spans: Vec<(usize, usize)> = Vec::new();
    for sample in first..=last {
        if robustness.get(sample).is_none_or(|rho| is_satisfied(*rho)) {
            continue;
        }
        match spans.last_mut() {
            Some((_, end)) if *end + 1 == sample => *end = sample,
            _ => spans.push((sample, sample)),
        }
    }
    spans
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_comparison_has_two_sides() {
        let split = |text: &str| sides(text).map(|[left, right]| format!("{left}|{right}"));
        assert_eq!(split("gap - 2 * speed >= 5").unwrap(), "gap - 2 * speed|5");
        assert_eq!(split("abs(x) < y").unwrap(), "abs(x)|y");
        assert_eq!(split("(a <= b)"), None);
    }

    #[test]
    fn a_violation_is_a_list_of_spans_within_the_window() {
        assert_eq!(spans(&[-1.0, -1.0, 0.0, -1.0, -1.0, -1.0], (1, 4)), [(1, 1), (3, 4)]);
    }
}
