//! The tables of README.md, docs/reference/tasks.md and controllers/README.md, from the records.

mod seeds;
mod summary;
mod training;

use crate::folder::ZooFolder;
use crate::pages::replace;
use crate::{
    BenchmarkTask, CornerThreshold, CornersRecord, EVALUATION_EPISODES, EstimateRecord, EvaluationRecord,
    FEWER_EPISODES, NOISE_LEVELS, PlanEntry, Rates, Record, SHIPPED_SEED, TrainingState, ZooError,
    algorithms, missed_thresholds,
};
use mishandle_paper::{PaperPerformance, paper_performance};

/// An empty cell.
const NOTHING: &str = "-";

/// A cell for something that the plan has and nobody has run.
const NOT_RUN: &str = "not run";

/// A cell of the corners in a record from before they were evaluated.
const NOT_MEASURED: &str = "not measured";

/// The page of the shipped controllers.
const PAGE: &str = "controllers/README.md";

/// Width of a task's picture in README.md: four fit into a row.
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

    /// Returns a training run of the plan with its record, if it has one.
    fn recorded(&self, task: &str, algorithm: &str, seed: u64) -> Option<(&PlanEntry, &Record)> {
        let is_it = |entry: &&PlanEntry| {
            let training = &entry.training;
            (training.task.as_str(), training.algorithm.as_str(), training.seed) == (task, algorithm, seed)
        };
        let entry = self.entries.iter().find(is_it)?;
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
    replace(&shown.folder.path("README.md"), "pictures", &pictures(shown))?;
    replace(&shown.folder.path("docs/reference/tasks.md"), "tasks", &tasks(shown))?;
    for (name, text) in [
        ("summary", summary::table(shown)),
        ("controllers", performance(shown, 0)),
        ("noise", performance(shown, 1)),
        ("training", training::table(shown)?),
        ("seeds", seeds::table(shown)),
        ("further-seeds", training::further_seeds(shown)),
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
        format!("<img src=\"{folder}/picture.png\" width=\"{PICTURE_WIDTH}\" alt=\"{name}\">\n")
    };
    shown.names().map(picture).collect()
}

/// One row per task: its formula, the expert's success rates and those of the shipped PPO.
fn tasks(shown: &Shown<'_>) -> String {
    let mut table = String::from(
        "| task | success | expert: SR | strict | careful | corners | PPO: SR | SR, noise 0.5 | strict | careful | corners | \
         corners, noise 0.5 | falsified trials, noise 0.5 |\n|---|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|\n",
    );
    for BenchmarkTask { name, formulas, .. } in shown.tasks {
        let ppo = shown.recorded(name, "ppo", SHIPPED_SEED);
        let rate = |record: Option<&Record>, noise: usize, rate: Rate| {
            record.map_or(NOTHING.to_string(), |record| percent(value(record, noise, rate), 1))
        };
        let of_ppo = |noise: usize, of: Rate| rate(ppo.map(|(_, record)| record), noise, of);
        table += &format!(
            "| `{name}` | `{}` | {} | {} | {} | {} | {} | {} | {} | {} | {} | {} | {} |\n",
            formulas[0],
            rate(shown.expert(name), 0, success),
            rate(shown.expert(name), 0, strict),
            careful(shown.expert(name)),
            corners(shown.expert(name).and_then(|record| record.evaluation(0))),
            of_ppo(0, success),
            of_ppo(1, success),
            of_ppo(0, strict),
            careful(ppo.map(|(_, record)| record)),
            corners(ppo.and_then(|(_, record)| record.evaluation(0))),
            corners(ppo.and_then(|(_, record)| record.evaluation(1))),
            ppo.map_or(NOTHING.to_string(), |(entry, record)| falsified_trials(entry, record)),
        );
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
            match shown.recorded(task, algorithm, SHIPPED_SEED) {
                Some((entry, record)) => {
                    let last =
                        if noise == 0 { remarks(entry, record) } else { falsified_trials(entry, record) };
                    table += &rows(record, algorithm, noise, &last);
                }
                None => table += &format!("| `{task}` | `{algorithm}` | {NOT_RUN} | | | | | | | | | | | |\n"),
            }
        }
        if let Some(expert) = shown.expert(task) {
            let last = match noise {
                0 => expert_remarks(task, expert),
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
        None => NOT_RUN.to_string(),
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
type Rate = fn(&EvaluationRecord) -> &EstimateRecord;

fn success(evaluation: &EvaluationRecord) -> &EstimateRecord {
    &evaluation.success_rate
}

fn strict(evaluation: &EvaluationRecord) -> &EstimateRecord {
    &evaluation.strict_success_rate
}

/// Returns the careful success rate without noise as a cell.
fn careful(record: Option<&Record>) -> String {
    let rate = record.and_then(|record| record.evaluation(0)?.careful_success_rate?.value);
    percent(rate, 1)
}

fn value(record: &Record, noise: usize, rate: Rate) -> Option<f64> {
    rate(record.evaluation(noise)?).value
}

/// An average with its interval.
fn shown_estimate(estimate: EstimateRecord, show: &dyn Fn(Option<f64>) -> String) -> String {
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
    let Some(evaluation) = evaluation else { return NOTHING.to_string() };
    let Some(found) = &evaluation.corners else { return NOT_MEASURED.to_string() };
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
    let dangerous = evaluation.and_then(|evaluation| evaluation.dangerous_episode_rate.as_ref());
    // Without the rate of episodes, the interval is from a bootstrap, which does not hold for rare
    // danger.
    let danger: Rate = |evaluation| &evaluation.dangerous_behavior_rate;
    let danger = match (evaluation, dangerous) {
        (Some(evaluation), None) => percent(danger(evaluation).value, 2),
        _ => cell(danger, &|value| percent(value, 2)),
    };
    [
        cell(success, &|value| percent(value, 1)),
        cell(strict, &|value| percent(value, 1)),
        shown_estimate(
            evaluation.and_then(|evaluation| evaluation.careful_success_rate).unwrap_or_default(),
            &|value| percent(value, 1),
        ),
        corners(evaluation),
        danger,
        shown_estimate(dangerous.copied().unwrap_or_default(), &|value| percent(value, 1)),
        cell(|evaluation| &evaluation.task_completion_time, &|value| decimal(value, 1)),
    ]
    .join(" | ")
}

/// Returns the thresholds that an expert misses.
fn expert_remarks(task: &str, record: &Record) -> String {
    missed_thresholds(task, "expert", rates(record, corner_threshold(record, true))).join("; ")
}

/// Remark on a controller that was measured under other conditions, such as another formula.
const MEASUREMENT_OUT_OF_DATE: &str = "measurement out of date";

/// Returns whether training, formulas and controller of a record are the present ones.
fn is_current(entry: &PlanEntry) -> bool {
    matches!(entry.state, TrainingState::Done | TrainingState::NeedsFalsification)
}

/// Returns the thresholds that a controller misses, and what is out of date.
fn remarks(entry: &PlanEntry, record: &Record) -> String {
    let mut remarks = missed(entry, record);
    match &entry.state {
        TrainingState::NeedsTraining { reason } | TrainingState::Interrupted { reason, .. } => {
            remarks.push(format!("out of date ({reason})"));
        }
        TrainingState::NeedsMeasurement { .. } => remarks.push(MEASUREMENT_OUT_OF_DATE.to_string()),
        TrainingState::NoSettings => remarks.push("no settings file".to_string()),
        TrainingState::Done | TrainingState::NeedsFalsification => {}
    }
    remarks.join("; ")
}

/// Returns the thresholds that a controller misses.
pub(crate) fn missed(entry: &PlanEntry, record: &Record) -> Vec<String> {
    let corners = corner_threshold(record, entry.training.is_shipped());
    missed_thresholds(&record.task, &entry.training.algorithm, rates(record, corners))
}

fn rates(record: &Record, corners: CornerThreshold) -> Rates {
    let rate = |noise: usize, rate: Rate| value(record, noise, rate).map_or(0.0, |rate| 100.0 * rate);
    Rates { success: [rate(0, success), rate(1, success)], strict: rate(0, strict), corners }
}

/// Returns whether a controller succeeds at the corners without noise. Those of further seeds are
/// not kept.
fn corner_threshold(record: &Record, is_kept: bool) -> CornerThreshold {
    let measured = record.evaluation(0).and_then(|evaluation| evaluation.corners.as_ref());
    match measured.map(CornersRecord::all_succeed) {
        Some(true) => CornerThreshold::Met,
        Some(false) => CornerThreshold::Missed,
        // An evaluation of a space without corners has none to measure.
        None if record.conditions.corners => CornerThreshold::Met,
        None if is_kept => CornerThreshold::NotMeasured,
        None => CornerThreshold::NotMeasurable,
    }
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
