//! The tables of README.md and controllers/README.md, made of the records.

use anyhow::Result;
use serde_json::Value;

use super::bars::{Rates, missed};
use super::home::Home;
use super::measure::{EPISODES, NOISE};
use super::plan::{ALGORITHMS, SHIPPED_SEED};
use super::record::Record;
use super::state::{Standing, State};
use super::summary::summary;
use super::{paper, seed_tables};
use crate::marks::replace;

/// What a cell holds where there is nothing to say.
pub const NOTHING: &str = "-";

/// The page that the tables stand in.
const PAGE: &str = "controllers/README.md";

/// All that the tables are made of.
pub struct Shown<'a> {
    /// The benchmark's tasks, as the program tells them.
    pub tasks: &'a [Value],
    /// All trainings of the plan.
    pub standings: &'a [Standing],
    /// The records of the experts.
    pub experts: &'a [Record],
}

impl Shown<'_> {
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.tasks.iter().filter_map(|task| task["name"].as_str())
    }

    /// How a training stands, if it has a record.
    pub fn recorded(&self, task: &str, algorithm: &str, seed: u64) -> Option<(&Standing, &Record)> {
        let is_it = |standing: &&Standing| {
            let training = &standing.training;
            (training.task.as_str(), training.algorithm.as_str(), training.seed) == (task, algorithm, seed)
        };
        let standing = self.standings.iter().find(is_it)?;
        Some((standing, standing.record.as_ref()?))
    }

    fn expert(&self, task: &str) -> Option<&Record> {
        self.experts.iter().find(|record| record.task == task)
    }
}

/// Writes all tables, and shows the pictures of the tasks in `drawn`.
///
/// # Errors
/// If a page cannot be read or written, or has no place for a table.
pub fn write(home: &Home, shown: &Shown<'_>, drawn: &[String]) -> Result<()> {
    replace(&home.path("README.md"), "tasks", &tasks(shown))?;
    for (name, made) in [
        ("summary", summary(shown)),
        ("controllers", performance(shown, 0)),
        ("noise", performance(shown, 1)),
        ("training", seed_tables::training(home, shown)?),
        ("seeds", seed_tables::seeds(shown)),
        ("further-seeds", seed_tables::further(shown)),
        ("curves", curves(drawn)),
    ] {
        replace(&home.path(PAGE), name, &made)?;
    }
    Ok(())
}

/// One line a task: its formula, how the expert does and how the shipped PPO does.
fn tasks(shown: &Shown<'_>) -> String {
    let mut table = String::from(
        "| task | success | expert: SR | strict | PPO: SR | SR, noise 0.5 | strict | broken, noise 0.5 |\n\
         |---|---|--:|--:|--:|--:|--:|--:|\n",
    );
    for task in shown.tasks {
        let [name, success] = ["name", "success"].map(|key| task[key].as_str().unwrap_or_default());
        let ppo = shown.recorded(name, "ppo", SHIPPED_SEED).map(|(_, record)| record);
        let of = |record: Option<&Record>, noise: usize, key: &str| {
            record.map_or(NOTHING.to_string(), |record| percent(&record.estimate(noise, key)["value"], 1))
        };
        table += &format!(
            "| `{name}` | `{success}` | {} | {} | {} | {} | {} | {} |\n",
            of(shown.expert(name), 0, "success_rate"),
            of(shown.expert(name), 0, "strict_success_rate"),
            of(ppo, 0, "success_rate"),
            of(ppo, 1, "success_rate"),
            of(ppo, 0, "strict_success_rate"),
            ppo.and_then(Record::broken).unwrap_or(NOTHING.to_string()),
        );
    }
    table
}

/// What was measured of the shipped controllers and the experts, under one of the noises.
fn performance(shown: &Shown<'_>, noise: usize) -> String {
    let mut table = format!(
        "{EPISODES} starts, action noise of standard deviation {}.\n\n\
         | task | controller | SR | strict SR | DBR | TCT | paper: SR | paper: DBR | paper: TCT | {} | commit |\n\
         |---|---|--:|--:|--:|--:|--:|--:|--:|---|---|\n",
        NOISE[noise],
        if noise == 0 { "misses" } else { "broken" },
    );
    for task in shown.names() {
        for algorithm in ALGORITHMS {
            match shown.recorded(task, algorithm, SHIPPED_SEED) {
                Some((standing, record)) => {
                    let last = if noise == 0 { remarks(standing, record) } else { broken(standing, record) };
                    table += &rows(record, algorithm, noise, &last);
                }
                None => table += &format!("| `{task}` | `{algorithm}` | not run | | | | | | | | |\n"),
            }
        }
        if let Some(expert) = shown.expert(task) {
            table += &rows(expert, "expert", noise, if noise == 0 { "" } else { NOTHING });
        }
    }
    table
}

/// In how many trials a controller that is put to the test was broken.
fn broken(standing: &Standing, record: &Record) -> String {
    let found = record.broken().filter(|_| standing.training.is_falsified());
    found.unwrap_or(NOTHING.to_string())
}

/// A controller's row, and one for the whole box where that is another.
fn rows(record: &Record, algorithm: &str, noise: usize, last: &str) -> String {
    let paper = paper::performance(&record.task, algorithm).map(|found| found[noise]);
    let of_paper = |number: Option<f64>, decimals: usize| {
        number.map_or(NOTHING.to_string(), |number| format!("{number:.decimals$}"))
    };
    let mut rows = format!(
        "| `{}` | `{algorithm}` | {} | {} | {} | {} | {last} | {} |\n",
        record.task,
        figures(|key| record.estimate(noise, key)),
        of_paper(paper.map(|paper| paper.success), 0),
        of_paper(paper.map(|paper| paper.danger), 2),
        of_paper(paper.map(|paper| paper.completion), 1),
        record.commit(),
    );
    if record.estimate_of_whole_box(noise, "success_rate").is_some() {
        let whole = |key: &str| record.estimate_of_whole_box(noise, key).unwrap_or(&Value::Null);
        rows += &format!("| `{}` | `{algorithm}`, whole box | {} | | | | | |\n", record.task, figures(whole));
    }
    rows
}

/// The four figures of an evaluation with their intervals, as cells.
pub fn figures<'a>(estimate: impl Fn(&str) -> &'a Value) -> String {
    let rate = |key: &str, decimals: usize| interval(estimate(key), |value| percent(value, decimals));
    [
        rate("success_rate", 1),
        rate("strict_success_rate", 1),
        rate("dangerous_behavior_rate", 2),
        interval(estimate("task_completion_time"), |value| decimal(value, 1)),
    ]
    .join(" | ")
}

fn interval(estimate: &Value, show: impl Fn(&Value) -> String) -> String {
    match (&estimate["low"], &estimate["high"]) {
        (Value::Null, _) | (_, Value::Null) => show(&estimate["value"]),
        (low, high) => format!("{} [{}, {}]", show(&estimate["value"]), show(low), show(high)),
    }
}

/// What is to be said against a controller: bars that it misses, and what it is not up to date with.
pub fn remarks(standing: &Standing, record: &Record) -> String {
    let mut remarks = misses(standing, record);
    match &standing.state {
        State::Missing(why) | State::Interrupted { why, .. } => remarks.push(format!("out of date ({why})")),
        State::Unmeasured => remarks.push("to be measured again".to_string()),
        State::NotPlanned => remarks.push("without settings".to_string()),
        State::Done => {}
    }
    remarks.join("; ")
}

/// The bars that a controller misses.
pub fn misses(standing: &Standing, record: &Record) -> Vec<String> {
    let rate =
        |noise: usize, key: &str| record.estimate(noise, key)["value"].as_f64().map_or(0.0, |x| 100.0 * x);
    let rates = Rates {
        success: [rate(0, "success_rate"), rate(1, "success_rate")],
        strict: rate(0, "strict_success_rate"),
    };
    missed(&record.task, &standing.training.algorithm, rates)
}

/// The pictures of the learning curves.
fn curves(drawn: &[String]) -> String {
    if drawn.is_empty() {
        return "No training has a curve yet.".to_string();
    }
    drawn.iter().map(|task| format!("![learning curves of {task}](curves/{task}.svg)\n")).collect()
}

/// A share in percent.
pub fn percent(value: &Value, decimals: usize) -> String {
    value.as_f64().map_or(NOTHING.to_string(), |value| format!("{:.decimals$}", 100.0 * value))
}

/// A number.
pub fn decimal(value: &Value, decimals: usize) -> String {
    value.as_f64().map_or(NOTHING.to_string(), |value| format!("{value:.decimals$}"))
}
