//! Charts of the kept learning curves, one for each task.

use mishandle_charts::{Chart, ChartAxis, LegendEntry, Panel, Point, Series};

use crate::folder::{ZooFolder, remove, write as write_bytes};
use crate::{
    BenchmarkTask, StoredCurve, StoredCurveRow, Training, ZooError, algorithms, interquartile_mean,
    interquartile_mean_interval, seeds,
};

/// Colors that people with color vision deficiencies can tell apart.
///
/// Okabe and Ito, "Color universal design", 2008.
const COLORS: [&str; 5] = ["#0072b2", "#d55e00", "#009e73", "#e69f00", "#cc79a7"];

/// Least number of seeds with a band.
const BAND_SEEDS: usize = 3;

/// Most points of a line.
const MOST_POINTS: usize = 200;

/// Most ticks of an axis.
const MOST_TICKS: usize = 6;

/// Width and height of a panel, pixels.
const PANEL_SIZE: [u32; 2] = [480, 280];

const CAPTION: &str =
    "Line: interquartile mean over the seeds. Band: its 95 % bootstrap interval, for 3 seeds or more.";

/// A quantity of a row, if the row has it.
type Quantity = fn(&StoredCurveRow) -> Option<f64>;

const HEIGHTS: [(&str, Quantity); 2] =
    [("success rate, %", |row| row.success_rate), ("strict success rate, %", |row| row.strict_success_rate)];

/// The curves of an algorithm, one per seed.
struct Seeds {
    algorithm: &'static str,
    color: &'static str,
    curves: Vec<StoredCurve>,
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
fn kept(folder: &ZooFolder, task: &str) -> Result<Vec<Seeds>, ZooError> {
    let found: Vec<Seeds> = (algorithms().zip(COLORS))
        .map(|(algorithm, color)| load(folder, task, algorithm, color))
        .collect::<Result<_, _>>()?;
    Ok(found.into_iter().filter(|seeds| !seeds.curves.is_empty()).collect())
}

fn load(
    folder: &ZooFolder,
    task: &str,
    algorithm: &'static str,
    color: &'static str,
) -> Result<Seeds, ZooError> {
    let path =
        |seed| folder.curve(&Training { task: task.to_string(), algorithm: algorithm.to_string(), seed });
    let paths = seeds(algorithm).into_iter().map(path).filter(|path| path.is_file());
    let curves = paths.map(|path| StoredCurve::load(&path)).collect::<Result<_, _>>()?;
    Ok(Seeds { algorithm, color, curves })
}

fn chart(task: &str, found: &[Seeds]) -> Chart {
    let entry = |seeds: &Seeds| LegendEntry {
        label: match seeds.curves.len() {
            1 => seeds.algorithm.to_uppercase(),
            count => format!("{}, {count} seeds", seeds.algorithm.to_uppercase()),
        },
        color: seeds.color,
    };
    let mut panels = Vec::new();
    for (y_label, height) in HEIGHTS {
        let steps: Quantity = |row| Some(row.environment_steps as f64);
        let secs: Quantity = |row| Some(row.wall_clock_secs);
        panels.push(panel("environment steps", y_label, found, (steps, height), step_ticks()));
        panels.push(panel("wall-clock time", y_label, found, (secs, height), time_ticks()));
    }
    Chart {
        title: format!("{task}: validation during training"),
        caption: CAPTION.to_string(),
        legend: found.iter().map(entry).collect(),
        columns: 2,
        panel_size: PANEL_SIZE,
        panels,
    }
}

fn panel(
    x_label: &str,
    y_label: &str,
    found: &[Seeds],
    (x, y): (Quantity, Quantity),
    ticks: Vec<(f64, String)>,
) -> Panel {
    let series: Vec<Series> = found
        .iter()
        .map(|seeds| {
            let points =
                |curve: &StoredCurve| curve.rows.iter().filter_map(|row| Some((x(row)?, y(row)?))).collect();
            Series::line(seeds.color, mean_line(&seeds.curves.iter().map(points).collect::<Vec<_>>()))
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

/// Returns the interquartile mean of curves, from the point where all of them have started. Between
/// its points a curve is linear; behind its end it keeps its last value, since training stopped
/// there because it was good enough.
fn mean_line(curves: &[Vec<(f64, f64)>]) -> Vec<Point> {
    let curves: Vec<&Vec<(f64, f64)>> = curves.iter().filter(|curve| !curve.is_empty()).collect();
    let start = curves.iter().map(|curve| curve[0].0).fold(0.0, f64::max);
    let mut grid: Vec<f64> = curves.iter().flat_map(|curve| curve.iter().map(|(x, _)| *x)).collect();
    grid.retain(|x| *x >= start);
    grid.sort_by(f64::total_cmp);
    grid.dedup();
    let (every, last) = (grid.len().div_ceil(MOST_POINTS).max(1), grid.len().saturating_sub(1));
    let kept = (0..grid.len()).filter(|i| i % every == 0 || *i == last).map(|i| grid[i]);
    kept.filter_map(|x| {
        let values: Vec<f64> = curves.iter().map(|curve| value_at(curve, x)).collect();
        let band = if values.len() >= BAND_SEEDS { interquartile_mean_interval(&values) } else { None };
        Some(Point { x, y: interquartile_mean(&values)?, band })
    })
    .collect()
}

fn value_at(curve: &[(f64, f64)], x: f64) -> f64 {
    let next = curve.partition_point(|point| point.0 < x);
    match (next.checked_sub(1).map(|before| curve[before]), curve.get(next)) {
        (Some((x0, y0)), Some((x1, y1))) => y0 + (y1 - y0) * (x - x0) / (x1 - x0),
        (Some((_, y)), None) | (None, Some(&(_, y))) => y,
        (None, None) => f64::NAN,
    }
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
    let (secs, minutes) = (counted(1.0, "s", &[1, 3, 10, 30]), counted(60.0, "min", &[1, 3, 10, 30]));
    [secs, minutes, counted(3600.0, "h", &[1, 3, 10, 30])].concat()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn the_mean_line_interpolates_and_extends_curves() {
        // From 10 on both have started; at 15 the second is halfway from 0.5 to 1.0; after 20 it
        // has ended.
        let first = vec![(5.0, 0.0), (10.0, 0.25), (15.0, 0.5), (30.0, 0.75)];
        let second = vec![(10.0, 0.5), (20.0, 1.0)];
        let found = mean_line(&[first, second, vec![]]);
        let expected = [(10.0, 0.375), (15.0, 0.625), (20.0, (0.5 + 0.25 / 3.0 + 1.0) / 2.0), (30.0, 0.875)];
        assert_eq!(found.len(), expected.len());
        for (point, (x, y)) in found.iter().zip(expected) {
            assert_eq!((point.x, point.band), (x, None));
            assert!((point.y - y).abs() < 1e-12, "{point:?}, expected {y}");
        }
    }

    #[test]
    fn three_seeds_have_a_band_around_the_line() {
        let seed = |rate: f64| vec![(1.0, 0.0), (2.0, rate)];
        let found = mean_line(&[seed(0.2), seed(0.4), seed(1.0)]);
        assert_eq!(found[0].band, Some([0.0, 0.0]));
        let [low, high] = found[1].band.unwrap();
        assert!(low <= found[1].y && found[1].y <= high, "{:?}", found[1]);
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
    fn a_chart_has_units_a_caption_and_the_same_bytes_each_time() {
        let row = |environment_steps, rate| StoredCurveRow {
            environment_steps,
            wall_clock_secs: environment_steps as f64 / 1e3,
            mean_return: None,
            success_rate: Some(rate),
            strict_success_rate: Some(rate),
            validation_return: None,
        };
        let curve = StoredCurve { rows: vec![row(1_000, 0.1), row(100_000, 0.9)] };
        let found = Seeds { algorithm: "ppo", color: COLORS[0], curves: vec![curve.clone(), curve] };
        let svg = chart("a-task", &[found]).svg();
        for words in ["a-task: validation during training", "PPO, 2 seeds", CAPTION, "success rate, %"] {
            assert!(svg.contains(words), "{words}");
        }
        let again = Seeds { algorithm: "ppo", color: COLORS[0], curves: vec![] };
        assert!(chart("a-task", &[again]).svg().contains("wall-clock time"));
    }

    #[test]
    fn the_shipped_charts_are_drawn_from_the_shipped_curves() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let folder = ZooFolder::new(&root);
        let mut charts = 0;
        for entry in std::fs::read_dir(root.join("controllers/curves")).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                let task = path.file_name().unwrap().to_str().unwrap();
                let shipped = std::fs::read_to_string(folder.chart(task)).unwrap();
                let drawn = chart(task, &kept(&folder, task).unwrap()).svg();
                assert!(shipped == drawn, "{task}: run `cargo run --release -p mishandle-zoo -- tables`");
                charts += 1;
            }
        }
        assert_eq!(charts, 8);
    }
}
