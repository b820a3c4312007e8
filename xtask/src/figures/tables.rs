//! The tables, from the records.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};
use serde_json::Value;

use super::measure::{EPISODES, NOISE, Record};
use super::{paper, text};

/// One line a task: its formula, how the expert does and how the shipped PPO does.
pub fn tasks(tasks: &Value, records: &[Record]) -> String {
    let mut table = String::from(
        "| task | success | expert: SR | strict | PPO: SR | SR, noise 0.5 | strict | broken, noise 0.5 |\n\
         |---|---|--:|--:|--:|--:|--:|--:|\n",
    );
    for task in tasks.as_array().into_iter().flatten().filter(|task| task["variant_of"].is_null()) {
        let name = text(&task["name"]);
        let of = |controller: &str, noise: usize, key: &str| {
            records
                .iter()
                .find(|record| record.task == name && record.controller == controller)
                .map_or("-".to_string(), |record| percent(&record.estimate(noise, key)["value"]))
        };
        let ppo = records.iter().find(|record| record.task == name && record.controller == "ppo");
        table += &format!(
            "| `{name}` | `{}` | {} | {} | {} | {} | {} | {} |\n",
            text(&task["success"]),
            of("expert", 0, "success_rate"),
            of("expert", 0, "strict_success_rate"),
            of("ppo", 0, "success_rate"),
            of("ppo", 1, "success_rate"),
            of("ppo", 0, "strict_success_rate"),
            ppo.and_then(Record::broken).unwrap_or("-".to_string()),
        );
    }
    table
}

/// All that was measured, and how the learned ones were trained.
pub fn controllers(root: &Path, records: &[Record]) -> Result<String> {
    let mut table = format!(
        "Measured by `cargo xtask figures` with {EPISODES} starts and seed 1, preset `paper`, mean action; in percent, \
         with 95 %\nintervals (Wilson's for rates, bootstrap for DBR); TCT in control steps of 1/60 s. The second row of \
         each pair has action\nnoise of standard deviation {}. The starts are drawn from the whole box, of which no part \
         is proven to be out of reach. `broken`\ncounts the trials in which random search found a violation of the \
         success formula within 300 simulations, with that noise.\n\n\
         | task | controller | noise | SR | strict SR | DBR | TCT | the paper's SR | broken | commit |\n\
         |---|---|--:|--:|--:|--:|--:|--:|--:|---|\n",
        NOISE[1]
    );
    for record in records {
        for noise in 0..NOISE.len() {
            table += &row(record, noise);
        }
    }
    table += "\n| task | controller | command | environment steps to the best | wall clock of the training | commit |\n\
              |---|---|---|--:|--:|---|\n";
    for record in records {
        let file = format!("controllers/{}/{}.safetensors", record.task, record.controller);
        let path = root.join(file);
        if !path.is_file() {
            continue;
        }
        let training = training_record(&path)?;
        table += &format!(
            "| `{}` | `{}` | `{}` | {} | {:.0} s | {} |\n",
            record.task,
            record.controller,
            text(&training["command"]),
            training["environment_steps"],
            training["wall_clock_secs"].as_f64().unwrap_or_default(),
            text(&training["git_commit"])
        );
    }
    Ok(table)
}

fn row(record: &Record, noise: usize) -> String {
    let interval = |key: &str| {
        let estimate = record.estimate(noise, key);
        format!(
            "{} [{}, {}]",
            percent(&estimate["value"]),
            percent(&estimate["low"]),
            percent(&estimate["high"])
        )
    };
    let paper = paper::success_rates(&record.task, &record.controller);
    format!(
        "| `{}` | `{}` | {} | {} | {} | {} | {} | {} | {} | {} |\n",
        record.task,
        record.controller,
        NOISE[noise],
        interval("success_rate"),
        interval("strict_success_rate"),
        interval("dangerous_behavior_rate"),
        record.estimate(noise, "task_completion_time")["value"]
            .as_f64()
            .map_or("-".to_string(), |steps| format!("{steps:.1}")),
        paper.map_or("-".to_string(), |rates| rates[noise].to_string()),
        if noise == 0 { String::new() } else { record.broken().unwrap_or_default() },
        record.commit(),
    )
}

fn percent(value: &Value) -> String {
    value.as_f64().map_or("-".to_string(), |value| format!("{:.1}", 100.0 * value))
}

/// The training record in the header of a safetensors file: eight bytes of length, then JSON.
fn training_record(path: &Path) -> Result<Value> {
    let bytes = fs::read(path)?;
    let length = bytes.first_chunk::<8>().map(|bytes| u64::from_le_bytes(*bytes) as usize);
    let json = length.and_then(|length| bytes.get(8..8 + length)).context("the file is cut short")?;
    let header: Value = serde_json::from_slice(json)?;
    let ours: Value = serde_json::from_str(&text(&header["__metadata__"]["mishandle"]))?;
    Ok(ours["training"].clone())
}
