//! Measures one controller, and keeps what was printed.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};
use serde_json::{Value, json};

use super::{program, text};
use crate::process::output;

/// Starts of an evaluation, and its seed: no training has seen it.
pub const EPISODES: u32 = 1000;
const SEED: u32 = 1;

/// Trials of a falsification.
const TRIALS: u32 = 10;

/// Standard deviations of the action noise: none, and the paper's.
pub const NOISE: [f64; 2] = [0.0, 0.5];

/// What was measured of one controller in one task.
pub struct Record {
    pub task: String,
    pub controller: String,
    document: Value,
}

impl Record {
    /// The record that was kept, if there is one.
    pub fn load(root: &Path, task: &str, controller: &str) -> Result<Option<Record>> {
        let path = file(root, task, controller);
        if !path.is_file() {
            return Ok(None);
        }
        let document =
            serde_json::from_slice(&fs::read(&path)?).with_context(|| path.display().to_string())?;
        Ok(Some(Record { task: task.to_string(), controller: controller.to_string(), document }))
    }

    /// Measures, and writes the record.
    pub fn measure(root: &Path, task: &Value, controller: &str) -> Result<Record> {
        let name = text(&task["name"]);
        let evaluate = |part: &str, noise: f64| {
            let line = format!(
                "evaluate {name} --controller {controller} --episodes {EPISODES} --box {part} --action-noise {noise}"
            );
            run(root, &line)
        };
        let part = |part: &str| -> Result<Value> {
            Ok(json!([evaluate(part, NOISE[0])?, evaluate(part, NOISE[1])?]))
        };
        let partly = task["reachable_share"].as_f64().is_some_and(|share| share < 1.0);
        // Experts are measured, not put to the test.
        let falsification = match controller {
            "expert" => Value::Null,
            _ => run(
                root,
                &format!(
                    "falsify {name} --controller {controller} --search random --trials {TRIALS} --action-noise {}",
                    NOISE[1]
                ),
            )?,
        };
        let commit = output(Command::new("git").args(["rev-parse", "--short=12", "HEAD"]).current_dir(root))?;
        let document = json!({
            "commit": commit.trim(),
            "whole": part("whole")?,
            "reachable": if partly { part("reachable")? } else { Value::Null },
            "falsification": falsification,
        });
        let path = file(root, &name, controller);
        fs::create_dir_all(path.parent().context("the file has no folder")?)?;
        fs::write(&path, format!("{document:#}\n"))?;
        Ok(Record { task: name, controller: controller.to_string(), document })
    }

    /// The commit that was measured.
    pub fn commit(&self) -> String {
        text(&self.document["commit"])
    }

    /// Whether part of the box is proven to be beyond any controller.
    pub fn is_partly_reachable(&self) -> bool {
        !self.document["reachable"].is_null()
    }

    /// An estimate over a part of the box (`whole` or `reachable`; the same where all of it is reachable).
    pub fn estimate(&self, part: &str, noise: usize, key: &str) -> &Value {
        let part = if self.is_partly_reachable() { part } else { "whole" };
        &self.document[part][noise][key]
    }

    /// In how many of its trials random search broke the success formula under noise; nothing for an expert.
    pub fn broken(&self) -> Option<String> {
        let trials = self.document["falsification"]["trials"].as_array()?.len();
        Some(format!("{} of {trials}", self.document["falsification"]["falsified_trials"]))
    }
}

fn file(root: &Path, task: &str, controller: &str) -> PathBuf {
    root.join("controllers/figures").join(task).join(format!("{controller}.json"))
}

/// Runs the program and reads the document it prints.
fn run(root: &Path, line: &str) -> Result<Value> {
    let runs = root.join("target/figures");
    fs::create_dir_all(&runs)?;
    let path = runs.join("run.sqlite");
    if path.exists() {
        fs::remove_file(&path)?;
    }
    let mut command = program(root);
    command.args(line.split(' ')).args(["--seed", &SEED.to_string(), "--json", "--out"]).arg(&path);
    // Exit code 1 says that a counterexample was found, which is what a falsification is for.
    let said = command.output()?;
    ensure!(matches!(said.status.code(), Some(0 | 1)), "{line}: {}", String::from_utf8_lossy(&said.stderr));
    Ok(serde_json::from_slice(&said.stdout)?)
}
