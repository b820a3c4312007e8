//! Draws the charts of the comparisons from the CSV files that their Python scripts write.
//!
//! `cargo run -p mishandle-studies --example comparison_charts` in the root of the repository writes
//! `studies/notebook/2026-11-22-skrl.svg` and `studies/notebook/2026-11-22-why-off-policy-failed.svg`.

use std::error::Error;
use std::path::Path;

use mishandle_report::charts::{Chart, ChartAxis, LegendEntry, Panel, Point, Series};
use serde::Deserialize;
use serde::de::DeserializeOwned;

/// A row of `studies/experiments/skrl/bands.csv`.
#[derive(Deserialize)]
struct Band {
    task: String,
    algorithm: String,
    seeds: u32,
    side: String,
    environment_steps: f64,
    mean: f64,
    low: f64,
    high: f64,
}

/// A row of `studies/experiments/off_policy/rates.csv`.
#[derive(Deserialize)]
struct Rates {
    algorithm: String,
    change: String,
    success_rate: f64,
    strict_success_rate: f64,
}

const SIDES: [(&str, &str); 2] = [("mishandle", "#0072b2"), ("skrl", "#d55e00")];
const SUCCESS: &str = "#9ecae1";
const STRICT: &str = "#0072b2";

fn main() -> Result<(), Box<dyn Error>> {
    let root = Path::new(".");
    let bands = rows(&root.join("studies/experiments/skrl/bands.csv"))?;
    std::fs::write(root.join("studies/notebook/2026-11-22-skrl.svg"), skrl(&bands).svg())?;
    let rates = rows(&root.join("studies/experiments/off_policy/rates.csv"))?;
    std::fs::write(
        root.join("studies/notebook/2026-11-22-why-off-policy-failed.svg"),
        off_policy(&rates).svg(),
    )?;
    Ok(())
}

fn rows<T: DeserializeOwned>(path: &Path) -> Result<Vec<T>, Box<dyn Error>> {
    Ok(csv::Reader::from_path(path)?.into_deserialize().collect::<Result<_, _>>()?)
}

/// Returns the distinct values of a column, in order of appearance.
fn distinct<T>(rows: &[T], key: impl Fn(&T) -> String) -> Vec<String> {
    let mut found = Vec::new();
    for value in rows.iter().map(key) {
        if !found.contains(&value) {
            found.push(value);
        }
    }
    found
}

fn legend<'a>(entries: impl IntoIterator<Item = (&'a str, &'static str)>) -> Vec<LegendEntry> {
    entries.into_iter().map(|(label, color)| LegendEntry { label: label.to_string(), color }).collect()
}

fn skrl(bands: &[Band]) -> Chart {
    let mut panels = Vec::new();
    for pair in distinct(bands, |band| format!("{} {}", band.task, band.algorithm)) {
        let own: Vec<&Band> =
            bands.iter().filter(|band| format!("{} {}", band.task, band.algorithm) == pair).collect();
        let low = own.iter().map(|band| band.low).fold(f64::INFINITY, f64::min);
        let high = own.iter().map(|band| band.high).fold(f64::NEG_INFINITY, f64::max);
        let margin = 0.05 * (high - low) + 0.01;
        let last = own.iter().map(|band| band.environment_steps).fold(0.0, f64::max);
        let mut x = ChartAxis::linear("environment steps", [0.0, last]);
        x.ticks =
            x.ticks.into_iter().step_by(2).map(|(steps, _)| (steps, format!("{} k", steps / 1e3))).collect();
        let series = SIDES.map(|(side, color)| {
            let side = own.iter().filter(|band| band.side == side);
            let point = |band: &&Band| Point {
                x: band.environment_steps,
                y: band.mean,
                band: Some([band.low, band.high]),
            };
            Series::line(color, side.map(point).collect())
        });
        let Some(first) = own.first() else { continue };
        panels.push(Panel {
            title: format!("{}, {} ({} seeds)", first.algorithm.to_uppercase(), first.task, first.seeds),
            x,
            y: ChartAxis::linear("mean return", [low - margin, high + margin]),
            areas: Vec::new(),
            series: series.to_vec(),
            marks: Vec::new(),
        });
    }
    Chart {
        title: "Mean return of the training episodes".to_string(),
        caption: "Line: interquartile mean over the seeds. Band: its 95 % bootstrap interval.".to_string(),
        legend: legend(SIDES),
        columns: 5,
        panel_size: [260, 230],
        panels,
    }
}

fn off_policy(rates: &[Rates]) -> Chart {
    let changes = distinct(rates, |row| row.change.clone());
    let panels = distinct(rates, |row| row.algorithm.clone()).into_iter().map(|algorithm| {
        let points = |rate: fn(&Rates) -> f64| {
            let own = rates.iter().filter(|row| row.algorithm == algorithm);
            let place = |row: &Rates| changes.iter().position(|change| *change == row.change);
            own.filter_map(|row| Some(Point { x: place(row)? as f64, y: rate(row), band: None })).collect()
        };
        Panel {
            title: algorithm.to_uppercase(),
            x: ChartAxis::categories("change", &changes),
            y: ChartAxis::percent("validation, %"),
            areas: Vec::new(),
            series: vec![
                Series::bars(SUCCESS, points(|row| row.success_rate)),
                Series::bars(STRICT, points(|row| row.strict_success_rate)),
            ],
            marks: Vec::new(),
        }
    });
    Chart {
        title: "ball-balancing: from the paper's settings to ours".to_string(),
        caption: "Each bar has its own change and all to its left. Mean over the seeds.".to_string(),
        legend: legend([("success rate", SUCCESS), ("strict success rate", STRICT)]),
        columns: 1,
        panel_size: [760, 250],
        panels: panels.collect(),
    }
}
