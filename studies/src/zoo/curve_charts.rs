//! Charts of the kept learning curves, one for each task.

use mishandle_report::charts::{Chart, ChartAxis, LegendEntry, Panel, Point, Series};

use crate::zoo::folder::{ZooFolder, remove, write as write_bytes};
use crate::zoo::{BenchmarkTask, StoredCurve, StoredCurveRow, Training, ZooError, algorithms};

/// Colors that people with color vision deficiencies can tell apart.
///
/// Okabe and Ito, "Color universal design", 2008.
const COLORS: [&str; 5] = ["#0072b2", "#d55e00", "#009e73", "#e69f00", "#cc79a7"];

/// Most points of a line.
const MOST_POINTS: usize = 200;

/// Most ticks of an axis.
const MOST_TICKS: usize = 6;

/// Width and height of a panel, pixels.
const PANEL_SIZE: [u32; 2] = [480, 280];

/// A quantity of a row, if the row has it.
type Quantity = fn(&StoredCurveRow) -> Option<f64>;

const HEIGHTS: [(&str, Quantity); 2] =
    [("success rate, %", |row| row.success_rate), ("strict success rate, %", |row| row.strict_success_rate)];

/// The curve of an algorithm.
struct Line {
    algorithm: &'static str,
    color: &'static str,
    curve: StoredCurve,
}

/// Draws every task that has a curve into `controllers/curves/TASK.svg`, and returns the names of
/// these tasks.
///
/// # Errors
/// If a curve cannot be read, or a chart cannot be written.
pub(crate) fn write(folder: &ZooFolder, tasks: &[BenchmarkTask]) -> Result<Vec<String>, ZooError> {
    let mut drawn = Vec::new();
    for BenchmarkTask { name: task, .. } in tasks {
        let found = kept(folder, task)?;
        let path = folder.chart(task);
        if found.is_empty() {
            remove(&path)?;
            continue;
        }
        write_bytes(&path, chart(task, &found).svg().as_bytes())?;
        drawn.push(task.clone());
    }
    Ok(drawn)
}

/// Reads the curves of a task.
fn kept(folder: &ZooFolder, task: &str) -> Result<Vec<Line>, ZooError> {
    let mut found = Vec::new();
    for (algorithm, color) in algorithms().zip(COLORS) {
        let path = folder.curve(&Training { task: task.to_string(), algorithm: algorithm.to_string() });
        if path.is_file() {
            found.push(Line { algorithm, color, curve: StoredCurve::load(&path)? });
        }
    }
    Ok(found)
}

fn chart(task: &str, found: &[Line]) -> Chart {
    let entry = |line: &Line| LegendEntry { label: line.algorithm.to_uppercase(), color: line.color };
    let mut panels = Vec::new();
    for (y_label, height) in HEIGHTS {
        let steps: Quantity = |row| Some(row.environment_steps as f64);
        let secs: Quantity = |row| Some(row.wall_clock_secs);
        panels.push(panel("environment steps", y_label, found, steps, height, step_ticks()));
        panels.push(panel("wall-clock time", y_label, found, secs, height, time_ticks()));
    }
    Chart {
        title: format!("{task}: validation during training"),
        caption: String::new(),
        legend: found.iter().map(entry).collect(),
        columns: 2,
        panel_size: PANEL_SIZE,
        panels,
    }
}

fn panel(
    x_label: &str,
    y_label: &str,
    found: &[Line],
    x: Quantity,
    y: Quantity,
    ticks: Vec<(f64, String)>,
) -> Panel {
    let series: Vec<Series> = found
        .iter()
        .map(|line| {
            let points: Vec<Point> = (line.curve.rows.iter())
                .filter_map(|row| Some(Point { x: x(row)?, y: y(row)?, band: None }))
                .collect();
            Series::line(line.color, thinned(points))
        })
        .collect();
    let all = series.iter().flat_map(|line| &line.points).map(|point| point.x);
    let (low, high) = all.fold((f64::INFINITY, 0.0_f64), |(low, high), x| (low.min(x), high.max(x)));
    // A single point needs space on both sides; no point at all needs some axis.
    let range = match (low < high, high > 0.0) {
        (true, _) => [low, high],
        (false, true) => [0.5 * high, 2.0 * high],
        (false, false) => [1.0, 10.0],
    };
    Panel {
        title: String::new(),
        x: ChartAxis::logarithmic(x_label, range, few_ticks(ticks, range)),
        y: ChartAxis::percent(y_label),
        areas: Vec::new(),
        series,
        marks: Vec::new(),
    }
}

/// Returns every n-th point and the last one, at most about [`MOST_POINTS`].
fn thinned(points: Vec<Point>) -> Vec<Point> {
    let every = points.len().div_ceil(MOST_POINTS).max(1);
    let last = points.len().saturating_sub(1);
    points
        .into_iter()
        .enumerate()
        .filter(|(i, _)| i % every == 0 || *i == last)
        .map(|(_, point)| point)
        .collect()
}

/// Returns at most [`MOST_TICKS`] of the ticks inside a range, at even distances.
fn few_ticks(mut ticks: Vec<(f64, String)>, [low, high]: [f64; 2]) -> Vec<(f64, String)> {
    ticks.retain(|(x, _)| (low..=high).contains(x));
    let every = ticks.len().div_ceil(MOST_TICKS).max(1);
    ticks.into_iter().step_by(every).collect()
}

/// Returns 1, 2 and 5 times the powers of ten.
fn step_ticks() -> Vec<(f64, String)> {
    let label = |steps: f64| match steps {
        steps if steps >= 1e6 => format!("{} M", steps / 1e6),
        steps if steps >= 1e3 => format!("{} k", steps / 1e3),
        steps => steps.to_string(),
    };
    let all = (2..9).flat_map(|power| [1.0, 2.0, 5.0].map(|first| first * 10.0_f64.powi(power)));
    all.map(|steps| (steps, label(steps))).collect()
}

/// Returns round durations, in seconds.
fn time_ticks() -> Vec<(f64, String)> {
    let counted = |secs: f64, unit: &str, counts: &[u32]| -> Vec<(f64, String)> {
        counts.iter().map(|count| (secs * f64::from(*count), format!("{count} {unit}"))).collect()
    };
    let secs = counted(1.0, "s", &[1, 3, 10, 30]);
    let minutes = counted(60.0, "min", &[1, 3, 10, 30]);
    [secs, minutes, counted(3600.0, "h", &[1, 3, 10, 30])].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_curve_keeps_few_points_and_its_last_one() {
        let points =
            |n: u32| (0..n).map(|i| Point { x: f64::from(i), y: 0.5, band: None }).collect::<Vec<_>>();
        assert_eq!(thinned(points(3)).len(), 3);
        let found = thinned(points(1002));
        assert!(found.len() <= MOST_POINTS + 1 && found.last().unwrap().x == 1001.0, "{}", found.len());
    }

    #[test]
    fn ticks_are_few_and_inside_the_axis() {
        for range in [[1e3, 2e3], [5e4, 1.6e7], [1e2, 9e8]] {
            let ticks = few_ticks(step_ticks(), range);
            assert!((1..=MOST_TICKS).contains(&ticks.len()), "{range:?}: {ticks:?}");
        }
        let labels: Vec<String> =
            few_ticks(time_ticks(), [20.0, 4000.0]).into_iter().map(|(_, label)| label).collect();
        assert_eq!(labels, ["30 s", "1 min", "3 min", "10 min", "30 min", "1 h"]);
    }

    #[test]
    fn a_chart_has_units_and_a_legend() {
        let row = |environment_steps, rate| StoredCurveRow {
            environment_steps,
            wall_clock_secs: environment_steps as f64 / 1e3,
            mean_return: None,
            success_rate: Some(rate),
            strict_success_rate: Some(rate),
            validation_return: None,
        };
        let curve = StoredCurve { rows: vec![row(1_000, 0.1), row(100_000, 0.9)] };
        let found = Line { algorithm: "ppo", color: COLORS[0], curve };
        let svg = chart("a-task", &[found]).svg();
        for words in ["a-task: validation during training", "PPO", "success rate, %", "wall-clock time"] {
            assert!(svg.contains(words), "{words}");
        }
    }

    #[test]
    fn the_shipped_charts_are_drawn_from_the_shipped_curves() {
        let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let folder = ZooFolder::new(&root);
        let mut charts = 0;
        for entry in std::fs::read_dir(root.join("controllers/curves")).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                let task = path.file_name().unwrap().to_str().unwrap();
                let shipped = std::fs::read_to_string(folder.chart(task)).unwrap();
                let drawn = chart(task, &kept(&folder, task).unwrap()).svg();
                assert!(
                    shipped == drawn,
                    "{task}: run `cargo run --release -p mishandle-studies -- zoo tables`"
                );
                charts += 1;
            }
        }
        assert_eq!(charts, 8);
    }
}
