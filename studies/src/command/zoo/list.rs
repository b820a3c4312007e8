//! The list of training runs, as text and as JSON.

use anyhow::Result;
use mishandle_studies::zoo::{PlanEntry, TrainingState, Zoo};
use serde_json::{Value, json};

/// Returns a line for each training run and one with their number.
pub fn text(zoo: &Zoo<'_>, entries: &[PlanEntry]) -> String {
    let done = entries.iter().filter(|entry| entry.state == TrainingState::Done).count();
    let lines = entries.iter().map(|entry| line(zoo, entry));
    lines.chain([format!("{done} of {} done", entries.len())]).collect::<Vec<_>>().join("\n")
}

fn line(zoo: &Zoo<'_>, entry: &PlanEntry) -> String {
    let is_trained = entry.state.is_trained();
    let is_adopted = entry.summary.as_ref().is_some_and(|summary| summary.adopted);
    let adopted = if is_trained && is_adopted { ", adopted" } else { "" };
    let curve = if is_trained && !zoo.has_curve(entry) { ", no learning curve" } else { "" };
    let missed = zoo.missed_thresholds(entry);
    let below =
        if missed.is_empty() { String::new() } else { format!(", below threshold: {}", missed.join(", ")) };
    format!("{:<28} {}{adopted}{curve}{below}", entry.training.name(), entry.state)
}

/// Returns an array with an object for each training run.
pub fn json(zoo: &Zoo<'_>, entries: &[PlanEntry]) -> Result<String> {
    let documents: Vec<Value> = entries.iter().map(|entry| document(zoo, entry)).collect();
    Ok(serde_json::to_string_pretty(&documents)?)
}

fn document(zoo: &Zoo<'_>, entry: &PlanEntry) -> Value {
    let training = &entry.training;
    let rate = |noise: usize| entry.record.as_ref()?.evaluation(noise)?.success_rate.value;
    let steps = match entry.state {
        TrainingState::Interrupted { steps, .. } => steps,
        _ => None,
    };
    json!({
        "task": training.task,
        "algorithm": training.algorithm,
        "state": entry.state.name(),
        "reason": entry.state.reason(),
        "checkpoint_environment_steps": steps,
        "adopted": entry.summary.as_ref().is_some_and(|summary| summary.adopted),
        "has_curve": zoo.has_curve(entry),
        "success_rate": rate(0),
        "success_rate_with_noise": rate(1),
        "missed_thresholds": zoo.missed_thresholds(entry),
    })
}
