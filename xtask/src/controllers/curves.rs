//! Pictures of learning curves, made of the curves that are kept: one for each task.

use anyhow::Result;

use super::aggregate::{interquartile_mean, interval};
use super::chart::{Chart, Entry, Line, Panel, Point};
use super::curve::{Curve, Row};
use super::home::{Home, write};
use super::plan::{ALGORITHMS, Training, seeds};

/// Colors of the algorithms that also those tell apart who see fewer colors.
///
/// Okabe and Ito, "Color universal design", 2008.
const COLORS: [&str; ALGORITHMS.len()] = ["#0072b2", "#d55e00", "#009e73", "#e69f00", "#cc79a7"];

/// Seeds from which on there is a band.
const BANDED: usize = 3;

/// Most points of a line.
const MOST_POINTS: usize = 200;

/// Most marks on an axis.
const MOST_TICKS: usize = 6;

/// A quantity of a row, if the row has it.
type Quantity = fn(&Row) -> Option<f64>;

/// What is drawn upwards.
const HEIGHTS: [(&str, Quantity); 2] =
    [("success rate, %", |row| row.success_rate), ("strict success rate, %", |row| row.strict_success_rate)];

/// The curves of an algorithm, a seed each.
struct Seeds {
    algorithm: &'static str,
    color: &'static str,
    curves: Vec<Curve>,
}

/// Draws every task that has a curve into `controllers/curves/TASK.svg`, and gives the names of these tasks.
///
/// # Errors
/// If a curve cannot be read, or a picture cannot be written.
pub fn draw(home: &Home, tasks: &[String]) -> Result<Vec<String>> {
    let mut drawn = Vec::new();
    for task in tasks {
        let found: Vec<Seeds> = (ALGORITHMS.iter().zip(COLORS))
            .map(|(algorithm, color)| load(home, task, algorithm, color))
            .collect::<Result<_>>()?;
        let found: Vec<Seeds> = found.into_iter().filter(|seeds| !seeds.curves.is_empty()).collect();
        let path = home.path(&format!("controllers/curves/{task}.svg"));
        if found.is_empty() {
            super::measure::remove(&path)?;
            continue;
        }
        write(&path, chart(task, &found).svg().as_bytes())?;
        drawn.push(task.clone());
    }
    Ok(drawn)
}

fn load(home: &Home, task: &str, algorithm: &'static str, color: &'static str) -> Result<Seeds> {
    let of = |seed| home.curve(&Training { task: task.to_string(), algorithm: algorithm.to_string(), seed });
    let paths = seeds(algorithm).into_iter().map(of).filter(|path| path.is_file());
    let curves = paths.map(|path| Curve::read(&path)).collect::<Result<_>>()?;
    Ok(Seeds { algorithm, color, curves })
}

fn chart(task: &str, found: &[Seeds]) -> Chart {
    let entry = |seeds: &Seeds| Entry {
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
        panels.push(panel("wall clock", y_label, found, (secs, height), time_ticks()));
    }
    Chart {
        title: format!("{task}: validation while training"),
        legend: found.iter().map(entry).collect(),
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
    let lines: Vec<Line> = found
        .iter()
        .map(|seeds| {
            let of = |curve: &Curve| curve.rows.iter().filter_map(|row| Some((x(row)?, y(row)?))).collect();
            Line { color: seeds.color, points: line(&seeds.curves.iter().map(of).collect::<Vec<_>>()) }
        })
        .collect();
    let all = lines.iter().flat_map(|line| &line.points).map(|point| point.x);
    let (low, high) = all.fold((f64::INFINITY, 0.0_f64), |(low, high), x| (low.min(x), high.max(x)));
    // A single point needs room on both sides too.
    let range = if low < high { [low, high] } else { [0.5 * high, 2.0 * high] };
    Panel {
        x_label: x_label.to_string(),
        y_label: y_label.to_string(),
        range,
        ticks: chosen(ticks, range),
        lines,
    }
}

/// The interquartile mean of curves, from where all have begun. Where a curve has no point it is between its neighbours;
/// one that has ended, since it was good enough, stays as it was.
fn line(curves: &[Vec<(f64, f64)>]) -> Vec<Point> {
    let curves: Vec<&Vec<(f64, f64)>> = curves.iter().filter(|curve| !curve.is_empty()).collect();
    let begun = curves.iter().map(|curve| curve[0].0).fold(0.0, f64::max);
    let mut grid: Vec<f64> = curves.iter().flat_map(|curve| curve.iter().map(|(x, _)| *x)).collect();
    grid.retain(|x| *x >= begun);
    grid.sort_by(f64::total_cmp);
    grid.dedup();
    let (every, last) = (grid.len().div_ceil(MOST_POINTS).max(1), grid.len().saturating_sub(1));
    let kept = (0..grid.len()).filter(|i| i % every == 0 || *i == last).map(|i| grid[i]);
    kept.filter_map(|x| {
        let values: Vec<f64> = curves.iter().map(|curve| at(curve, x)).collect();
        let band = if values.len() >= BANDED { interval(&values) } else { None };
        Some(Point { x, y: interquartile_mean(&values)?, band })
    })
    .collect()
}

/// A curve's height at `x`: linear between its points, and as at its end behind it.
fn at(curve: &[(f64, f64)], x: f64) -> f64 {
    let next = curve.partition_point(|point| point.0 < x);
    match (next.checked_sub(1).map(|before| curve[before]), curve.get(next)) {
        (Some((x0, y0)), Some((x1, y1))) => y0 + (y1 - y0) * (x - x0) / (x1 - x0),
        (Some((_, y)), None) | (None, Some(&(_, y))) => y,
        (None, None) => f64::NAN,
    }
}

/// At most so many of the marks in a range, evenly.
fn chosen(mut ticks: Vec<(f64, String)>, [low, high]: [f64; 2]) -> Vec<(f64, String)> {
    ticks.retain(|(x, _)| (low..=high).contains(x));
    let every = ticks.len().div_ceil(MOST_TICKS).max(1);
    ticks.into_iter().step_by(every).collect()
}

/// 1, 2 and 5 times the powers of ten.
fn step_ticks() -> Vec<(f64, String)> {
    let label = |steps: f64| match steps {
        steps if steps >= 1e6 => format!("{} M", steps / 1e6),
        steps if steps >= 1e3 => format!("{} k", steps / 1e3),
        steps => steps.to_string(),
    };
    let all = (2..9).flat_map(|power| [1.0, 2.0, 5.0].map(|first| first * 10.0_f64.powi(power)));
    all.map(|steps| (steps, label(steps))).collect()
}

/// Durations that people use.
fn time_ticks() -> Vec<(f64, String)> {
    let counted = |secs: f64, unit: &str, counts: &[u32]| -> Vec<(f64, String)> {
        counts.iter().map(|count| (secs * f64::from(*count), format!("{count} {unit}"))).collect()
    };
    let (secs, minutes) = (counted(1.0, "s", &[1, 3, 10, 30]), counted(60.0, "min", &[1, 3, 10, 30]));
    [secs, minutes, counted(3600.0, "h", &[1, 3, 10, 30])].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_meet_on_one_axis() {
        // From 10 on both have begun; at 15 the second is halfway from 0.5 to 1.0; after 20 it has ended.
        let first = vec![(5.0, 0.0), (10.0, 0.25), (15.0, 0.5), (30.0, 0.75)];
        let second = vec![(10.0, 0.5), (20.0, 1.0)];
        let found = line(&[first, second, vec![]]);
        let expected = [(10.0, 0.375), (15.0, 0.625), (20.0, (0.5 + 0.25 / 3.0 + 1.0) / 2.0), (30.0, 0.875)];
        assert_eq!(found.len(), expected.len());
        for (point, (x, y)) in found.iter().zip(expected) {
            assert_eq!((point.x, point.band), (x, None));
            assert!((point.y - y).abs() < 1e-12, "{point:?}, expected {y}");
        }
    }

    #[test]
    fn three_seeds_have_a_band_that_holds_the_line() {
        let seed = |rate: f64| vec![(1.0, 0.0), (2.0, rate)];
        let found = line(&[seed(0.2), seed(0.4), seed(1.0)]);
        assert_eq!(found[0].band, Some([0.0, 0.0]));
        let [low, high] = found[1].band.unwrap();
        assert!(low <= found[1].y && found[1].y <= high, "{:?}", found[1]);
    }

    #[test]
    fn marks_are_few_and_within_the_axis() {
        for range in [[1e3, 2e3], [5e4, 1.6e7], [1e2, 9e8]] {
            let ticks = chosen(step_ticks(), range);
            assert!((1..=MOST_TICKS).contains(&ticks.len()), "{range:?}: {ticks:?}");
        }
        let labels: Vec<String> =
            chosen(time_ticks(), [20.0, 4000.0]).into_iter().map(|(_, label)| label).collect();
        assert_eq!(labels, ["30 s", "1 min", "3 min", "10 min", "30 min", "1 h"]);
    }
}
