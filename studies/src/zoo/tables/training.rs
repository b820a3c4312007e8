//! How controllers were trained.

use crate::paper::paper_training_time;
use crate::zoo::tables::{NOT_MEASURED, NOTHING, Shown, decimal};
use crate::zoo::{StoredCurve, TrainingSummary, ZooError, algorithms, success_threshold};

/// A training time above this share of the whole training run counts as "still rising", shown as
/// `≥`.
///
/// A return that rises evenly to the end has its training time at 0.94: the definition allows for
/// the last twentieth of the rise, and its mean looks back.
const LATE: f64 = 0.9;

/// The training runs of the shipped controllers.
///
/// # Errors
/// If a curve cannot be read.
pub(super) fn table(shown: &Shown<'_>) -> Result<String, ZooError> {
    let mut table = String::from(
        "| task | algorithm | environment steps | best after | wall clock, s | TT, control steps | TT, s | \
         paper: TT | time to threshold, s | command | commit |\n|---|---|--:|--:|--:|--:|--:|--:|--:|---|---|\n",
    );
    for task in shown.names() {
        for algorithm in algorithms() {
            let found = shown.recorded(task, algorithm).map(|(entry, _)| entry);
            let Some((entry, summary)) = found.and_then(|entry| Some((entry, entry.summary.as_ref()?)))
            else {
                table += &format!("| `{task}` | `{algorithm}` | {NOT_MEASURED} | | | | | | | | |\n");
                continue;
            };
            let path = shown.folder.curve(&entry.training);
            let curve = if path.is_file() { Some(StoredCurve::load(&path)?) } else { None };
            let threshold = success_threshold(task, algorithm);
            let reached =
                curve.zip(threshold).and_then(|(curve, threshold)| curve.secs_to(threshold / 100.0));
            table += &format!(
                "| `{task}` | `{algorithm}` | {} | {} | {} | `{}` | {}{} |\n",
                effort(summary),
                paper_training_time(task, algorithm).map_or(NOTHING.to_string(), |steps| steps.to_string()),
                decimal(reached, 0),
                summary.record.command,
                summary.record.git_commit,
                if summary.adopted { ", adopted" } else { "" },
            );
        }
    }
    Ok(table)
}

/// The cells: environment steps, steps to the best controller, seconds, training time in control
/// steps and in seconds.
fn effort(summary: &TrainingSummary) -> String {
    let time = summary.training_time;
    let is_flat = summary
        .trained_steps
        .zip(time)
        .is_none_or(|(steps, time)| time.environment_steps as f64 <= LATE * steps as f64);
    let shown_time = |value: Option<f64>| match decimal(value, 0) {
        shown if is_flat => shown,
        shown => format!("≥ {shown}"),
    };
    [
        summary.trained_steps.map_or(NOTHING.to_string(), |steps| steps.to_string()),
        summary.record.environment_steps.to_string(),
        decimal(Some(summary.record.wall_clock_secs), 0),
        shown_time(time.map(|time| time.control_steps as f64)),
        shown_time(time.map(|time| time.secs)),
    ]
    .join(" | ")
}
