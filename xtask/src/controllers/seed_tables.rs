//! Tables of how controllers were trained, and of all seeds of an algorithm together.

use anyhow::Result;
use serde_json::Value;

use super::aggregate::interquartile_mean;
use super::bars::success_bar;
use super::curve::Curve;
use super::facts::Facts;
use super::home::Home;
use super::paper;
use super::plan::{self, ALGORITHMS, SHIPPED_SEED};
use super::record::Record;
use super::state::Standing;
use super::tables::{NOTHING, Shown, decimal, figures, misses, remarks};

/// The share of a training behind which a return that becomes flat is one that has not become flat.
///
/// That of a return which rises evenly to the end is found at 0.94: the definition allows for the last twentieth of the
/// rise, and its mean looks back.
const LATE: f64 = 0.9;

/// How the shipped controllers were trained.
///
/// # Errors
/// If a curve cannot be read.
pub fn training(home: &Home, shown: &Shown<'_>) -> Result<String> {
    let mut table = String::from(
        "| task | algorithm | seed | environment steps | best after | wall clock, s | TT, control steps | TT, s | \
         paper: TT | SR at its bar, s | command | commit |\n|---|---|--:|--:|--:|--:|--:|--:|--:|--:|---|---|\n",
    );
    for task in shown.names() {
        for algorithm in ALGORITHMS {
            let found = shown.recorded(task, algorithm, SHIPPED_SEED).map(|(standing, _)| standing);
            let Some((standing, facts)) =
                found.and_then(|standing| Some((standing, standing.facts.as_ref()?)))
            else {
                table += &format!("| `{task}` | `{algorithm}` | | not run | | | | | | | | |\n");
                continue;
            };
            let paper = paper::training_time(task, algorithm);
            let curve = home.curve(&standing.training);
            let curve = if curve.is_file() { Some(Curve::read(&curve)?) } else { None };
            let bar = success_bar(task, algorithm);
            let reached = curve.zip(bar).and_then(|(curve, bar)| curve.secs_to(bar / 100.0));
            table += &format!(
                "| `{task}` | `{algorithm}` | {SHIPPED_SEED} | {} | {} | {} | `{}` | {}{} |\n",
                effort(facts),
                paper.map_or(NOTHING.to_string(), |steps| steps.to_string()),
                reached.map_or(NOTHING.to_string(), |secs| format!("{secs:.0}")),
                facts.text("command"),
                facts.text("git_commit"),
                if facts.is_adopted() { ", adopted" } else { "" },
            );
        }
    }
    Ok(table)
}

/// What a training took, as cells: steps, steps to the best, seconds, training time in control steps and seconds.
fn effort(facts: &Facts) -> String {
    let time = &facts.0["training_time"];
    let count = |value: &Value| decimal(value, 0);
    let (steps, flat) = (facts.number("trained_steps"), time["environment_steps"].as_f64());
    let is_flat = steps.zip(flat).is_none_or(|(steps, flat)| flat <= LATE * steps);
    let time = ["control_steps", "secs"].map(|key| match count(&time[key]) {
        shown if is_flat => shown,
        shown => format!("≥ {shown}"),
    });
    [
        count(&facts.0["trained_steps"]),
        count(&facts.0["environment_steps"]),
        count(&facts.0["wall_clock_secs"]),
        time.join(" | "),
    ]
    .join(" | ")
}

/// The runs of an algorithm on a task, in the order of their seeds.
fn runs<'a>(shown: &'a Shown<'_>, task: &str, algorithm: &str) -> Vec<(&'a Standing, &'a Record)> {
    plan::seeds(algorithm).into_iter().filter_map(|seed| shown.recorded(task, algorithm, seed)).collect()
}

/// Interquartile mean, least and greatest over the seeds of each algorithm, and which of them miss a bar.
pub fn seeds(shown: &Shown<'_>) -> String {
    let mut table = String::from(
        "| task | algorithm | seeds | SR: IQM | min | max | SR with noise: IQM | min | max | strict SR: IQM | min | max | \
         seeds that miss a bar | seeds not run |\n|---|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|---|---|\n",
    );
    for task in shown.names() {
        for algorithm in ALGORITHMS {
            let runs = runs(shown, task, algorithm);
            if runs.is_empty() {
                table += &format!("| `{task}` | `{algorithm}` | 0 | | | | | | | | | | | all |\n");
                continue;
            }
            let rates = [("success_rate", 0), ("success_rate", 1), ("strict_success_rate", 0)];
            let cells = rates.map(|(key, noise)| spread(&runs, noise, key)).join(" | ");
            let missing: Vec<String> = (runs.iter())
                .filter_map(|(standing, record)| {
                    let missed = misses(standing, record);
                    let seed = standing.training.seed;
                    (!missed.is_empty()).then(|| format!("{seed} ({})", missed.join(", ")))
                })
                .collect();
            let has_run = |seed: &u64| runs.iter().any(|(standing, _)| standing.training.seed == *seed);
            let not_run: Vec<String> =
                plan::seeds(algorithm).iter().filter(|seed| !has_run(seed)).map(u64::to_string).collect();
            table += &format!(
                "| `{task}` | `{algorithm}` | {} | {cells} | {} | {} |\n",
                runs.len(),
                missing.join("; "),
                not_run.join(", "),
            );
        }
    }
    table
}

/// Interquartile mean, least and greatest of a rate over runs, in percent, as cells.
fn spread(runs: &[(&Standing, &Record)], noise: usize, key: &str) -> String {
    let of = |(_, record): &(&Standing, &Record)| record.estimate(noise, key)["value"].as_f64();
    let values: Vec<f64> = runs.iter().filter_map(of).collect();
    let least = values.iter().copied().reduce(f64::min);
    let greatest = values.iter().copied().reduce(f64::max);
    let cell =
        |value: Option<f64>| value.map_or(NOTHING.to_string(), |value| format!("{:.1}", 100.0 * value));
    // Of one run there is no spread.
    let is_spread = values.len() > 1;
    let ends = [least, greatest].map(|value| cell(value.filter(|_| is_spread)));
    [cell(interquartile_mean(&values)), ends.join(" | ")].join(" | ")
}

/// Each run of a further seed.
pub fn further(shown: &Shown<'_>) -> String {
    let mut table = String::new();
    for task in shown.names() {
        for algorithm in ALGORITHMS {
            for (standing, record) in runs(shown, task, algorithm) {
                let Some(facts) = record.facts().filter(|_| standing.training.seed != SHIPPED_SEED) else {
                    continue;
                };
                table += &format!(
                    "| `{task}` | `{algorithm}` | {} | {} | {} | {} | {} | {} |\n",
                    standing.training.seed,
                    effort(&facts),
                    figures(|key| record.estimate(0, key)),
                    figures(|key| record.estimate(1, key)),
                    remarks(standing, record),
                    facts.text("git_commit"),
                );
            }
        }
    }
    if table.is_empty() {
        return "None was run yet.".to_string();
    }
    String::from(
        "| task | algorithm | seed | environment steps | best after | wall clock, s | TT, control steps | TT, s | SR | \
         strict SR | DBR | TCT | with noise: SR | strict SR | DBR | TCT | misses | commit |\n\
         |---|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|---|---|\n",
    ) + &table
}
