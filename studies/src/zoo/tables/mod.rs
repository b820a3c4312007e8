//! The tables of docs/reference/tasks.md and controllers/README.md, from the records.

mod summary;
mod training;

use mishandle::results::Estimate;

use crate::paper::{PaperPerformance, paper_performance};
use crate::zoo::folder::ZooFolder;
use crate::zoo::pages::replace;
use crate::zoo::{
    BenchmarkTask, EVALUATION_EPISODES, EvaluationRecord, FEWER_EPISODES, NOISE_LEVELS, PlanEntry, Rates,
    Record, ZooError, algorithms, missed_thresholds,
};

/// An empty cell.
const NOTHING: &str = "-";

/// A cell for something that the plan has and nobody has measured under the present conditions.
const NOT_MEASURED: &str = "not measured";

/// The page of the shipped controllers.
const PAGE: &str = "controllers/README.md";

/// Width of a task's picture: four fit into a row.
const PICTURE_WIDTH: &str = "24%";

/// Everything that the tables show.
pub(crate) struct Shown<'a> {
    pub folder: &'a ZooFolder,
    /// The tasks of the benchmark, in their order.
    pub tasks: &'a [BenchmarkTask],
    /// All training runs of the plan.
    pub entries: &'a [PlanEntry],
    /// The records of the experts.
    pub experts: &'a [Record],
}

impl Shown<'_> {
    fn names(&self) -> impl Iterator<Item = &str> {
        self.tasks.iter().map(|task| task.name.as_str())
    }

    /// Returns a training run of the plan with its record, if it is measured under the present
    /// conditions.
    fn recorded(&self, task: &str, algorithm: &str) -> Option<(&PlanEntry, &Record)> {
        let is_it = |entry: &&PlanEntry| entry.training.task == task && entry.training.algorithm == algorithm;
        let entry = self.entries.iter().find(is_it).filter(|entry| entry.state.is_measured())?;
        Some((entry, entry.record.as_ref()?))
    }

    fn expert(&self, task: &str) -> Option<&Record> {
        self.experts.iter().find(|record| record.task == task)
    }
}

/// Writes all tables, and shows the charts of the tasks in `drawn`.
///
/// # Errors
/// If a page cannot be read or written, or has no place for a table.
pub(crate) fn write(shown: &Shown<'_>, drawn: &[String]) -> Result<(), ZooError> {
    let reference = shown.folder.path("docs/reference/tasks.md");
    replace(&reference, "pictures", &pictures(shown))?;
    replace(&reference, "tasks", &tasks(shown))?;
    for (name, text) in [
        ("summary", summary::table(shown)),
        ("controllers", performance(shown, 0)),
        ("noise", performance(shown, 1)),
        ("training", training::table(shown)?),
        ("curves", curves(drawn)),
    ] {
        replace(&shown.folder.path(PAGE), name, &text)?;
    }
    Ok(())
}

/// The pictures of the tasks, which `cargo xtask pictures` draws.
fn pictures(shown: &Shown<'_>) -> String {
    let picture = |name: &str| {
        let folder = mishandle::tasks::folder(name);
        format!("<img src=\"../../{folder}/picture.png\" width=\"{PICTURE_WIDTH}\" alt=\"{name}\">\n")
    };
    shown.names().map(picture).collect()
}

/// One row per task: its success formula.
fn tasks(shown: &Shown<'_>) -> String {
    let mut table = String::from("| task | success |\n|---|---|\n");
    for BenchmarkTask { name, formulas, .. } in shown.tasks {
        table += &format!("| `{name}` | `{}` |\n", formulas[0]);
    }
    table
}

/// The measurements of the shipped controllers and the experts at one noise level.
fn performance(shown: &Shown<'_>, noise: usize) -> String {
    let fewer: String =
        FEWER_EPISODES.iter().map(|(task, episodes)| format!(" ({episodes} in {task})")).collect();
    let mut table = format!(
        "{EVALUATION_EPISODES} initial states{fewer}, {}.\n\n\
         | task | controller | SR | strict SR | careful SR | corners | DBR | episodes with danger | TCT | paper: SR | paper: DBR | paper: TCT | {} | commit |\n\
         |---|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|---|---|\n",
        if noise == 0 {
            "without action noise".to_string()
        } else {
            format!("action noise {}", NOISE_LEVELS[noise])
        },
        if noise == 0 { "below threshold" } else { "falsified trials" },
    );
    for task in shown.names() {
        for algorithm in algorithms() {
            match shown.recorded(task, algorithm) {
                Some((entry, record)) => {
                    let last = if noise == 0 {
                        missed(record, algorithm).join("; ")
                    } else {
                        falsified_trials(entry, record)
                    };
                    table += &rows(record, algorithm, noise, &last);
                }
                None => {
                    table +=
                        &format!("| `{task}` | `{algorithm}` | {NOT_MEASURED} | | | | | | | | | | | |\n");
                }
            }
        }
        if let Some(expert) = shown.expert(task) {
            let last = match noise {
                0 => missed(expert, "expert").join("; "),
                _ => NOTHING.to_string(),
            };
            table += &rows(expert, "expert", noise, &last);
        }
    }
    table
}

/// Returns in how many trials random search found a violation of the success formula under noise.
fn falsified_trials(entry: &PlanEntry, record: &Record) -> String {
    match &record.falsification {
        _ if !entry.training.is_falsified() => NOTHING.to_string(),
        Some(found) => format!("{} of {}", found.falsified_trials, found.trials.len()),
        None => NOT_MEASURED.to_string(),
    }
}

/// A controller's row, and one for the whole box if that has other starts.
fn rows(record: &Record, algorithm: &str, noise: usize, last: &str) -> String {
    let paper = paper_performance(&record.task, algorithm).map(|found| found[noise]);
    let of_paper = |number: fn(PaperPerformance) -> f64, decimals: usize| {
        paper.map_or(NOTHING.to_string(), |paper| format!("{:.decimals$}", number(paper)))
    };
    let mut rows = format!(
        "| `{}` | `{algorithm}` | {} | {} | {} | {} | {last} | {} |\n",
        record.task,
        figures(record.evaluation(noise)),
        of_paper(|paper| paper.success, 0),
        of_paper(|paper| paper.danger, 2),
        of_paper(|paper| paper.completion, 1),
        commits(record, noise),
    );
    if let Some(whole) = record.whole_box_evaluation(noise) {
        let figures = figures(Some(whole));
        rows += &format!("| `{}` | `{algorithm}`, whole box | {figures} | | | | | |\n", record.task);
    }
    rows
}

/// Returns the commit that measured a row. Under noise, the falsification can be of another one.
fn commits(record: &Record, noise: usize) -> String {
    match &record.falsification_commit {
        Some(falsification) if noise > 0 && *falsification != record.commit => {
            format!("{}; falsified trials: {falsification}", record.commit)
        }
        _ => record.commit.clone(),
    }
}

/// One of the averages of an evaluation.
type Rate = fn(&EvaluationRecord) -> &Estimate;

fn success(evaluation: &EvaluationRecord) -> &Estimate {
    &evaluation.success_rate
}

fn strict(evaluation: &EvaluationRecord) -> &Estimate {
    &evaluation.strict_success_rate
}

fn value(record: &Record, noise: usize, rate: Rate) -> Option<f64> {
    rate(record.evaluation(noise)?).value
}

/// An average with its interval.
fn shown_estimate(estimate: Estimate, show: &dyn Fn(Option<f64>) -> String) -> String {
    match (estimate.low, estimate.high) {
        (Some(low), Some(high)) => {
            format!("{} [{}, {}]", show(estimate.value), show(Some(low)), show(Some(high)))
        }
        _ => show(estimate.value),
    }
}

/// Returns at how many corners a controller succeeds, and succeeds strictly and carefully: `4/4;
/// strict 3/4; careful 2/4`. A failure is in bold.
fn corners(evaluation: Option<&EvaluationRecord>) -> String {
    let Some(EvaluationRecord { corners: found, .. }) = evaluation else {
        return NOTHING.to_string();
    };
    let cell = |count: u32, center: Option<bool>| {
        let center = if center == Some(false) { ", center fails" } else { "" };
        let text = format!("{count}/{}{center}", found.n);
        if count == found.n && center.is_empty() { text } else { format!("**{text}**") }
    };
    let mut text = cell(found.succeeding, found.center_succeeds);
    if let Some(count) = found.strictly_succeeding {
        text += &format!("; strict {}", cell(count, found.center_strictly_succeeds));
    }
    if let Some(count) = found.carefully_succeeding {
        text += &format!("; careful {}", cell(count, found.center_carefully_succeeds));
    }
    text
}

/// The averages of an evaluation with their intervals and the corners, as cells.
fn figures(evaluation: Option<&EvaluationRecord>) -> String {
    let cell = |of: Rate, show: &dyn Fn(Option<f64>) -> String| {
        shown_estimate(evaluation.map(|evaluation| *of(evaluation)).unwrap_or_default(), show)
    };
    let rate = |of: Rate| cell(of, &|value| percent(value, 1));
    [
        rate(success),
        rate(strict),
        rate(|evaluation| &evaluation.careful_success_rate),
        corners(evaluation),
        cell(|evaluation| &evaluation.dangerous_behavior_rate, &|value| percent(value, 2)),
        rate(|evaluation| &evaluation.dangerous_episode_rate),
        cell(|evaluation| &evaluation.task_completion_time, &|value| decimal(value, 1)),
    ]
    .join(" | ")
}

/// Returns the thresholds that a controller misses.
pub(crate) fn missed(record: &Record, controller: &str) -> Vec<String> {
    let rate = |noise: usize, rate: Rate| value(record, noise, rate).map_or(0.0, |rate| 100.0 * rate);
    let corners = record.evaluation(0).is_some_and(|evaluation| evaluation.corners.all_succeed());
    let rates = Rates { success: [rate(0, success), rate(1, success)], strict: rate(0, strict), corners };
    missed_thresholds(&record.task, controller, rates)
}

fn curves(drawn: &[String]) -> String {
    if drawn.is_empty() {
        return "No training run has a curve yet.".to_string();
    }
    drawn.iter().map(|task| format!("![learning curves of {task}](curves/{task}.svg)\n")).collect()
}

/// A share in percent.
fn percent(value: Option<f64>, decimals: usize) -> String {
    decimal(value.map(|value| 100.0 * value), decimals)
}

fn decimal(value: Option<f64>, decimals: usize) -> String {
    value.map_or(NOTHING.to_string(), |value| format!("{value:.decimals$}"))
}
