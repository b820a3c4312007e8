//! Measures one controller.

use std::fs;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use anyhow::{Context, Result};
use serde_json::{Value, json};

use super::home::Home;
use super::program::Program;
use super::workers;

/// Starts of an evaluation, and its seed, of which no training and no validation draws a start.
pub const EPISODES: u32 = 1000;
const SEED: u32 = 1;

/// Trials of a falsification.
const TRIALS: u32 = 10;

/// Standard deviations of the action noise: none, and the paper's.
pub const NOISE: [f64; 2] = [0.0, 0.5];

/// What was measured, as the program printed it.
pub struct Measured {
    pub commit: String,
    pub conditions: Value,
    /// One for each of [`NOISE`], from the starts from which the task can be done.
    pub evaluations: Vec<Value>,
    /// The same from the whole box, if that is more; else null.
    pub whole_box: Value,
    /// Null if there was none.
    pub falsification: Value,
}

/// What a measurement hangs on beside the controller: the same, and it need not be made again.
pub fn conditions(task: &Value, task_hash: &str) -> Value {
    let formulas = ["success", "strict", "safe", "completion"].map(|name| task[name].clone());
    json!({
        "task_hash": task_hash,
        "formulas": formulas,
        "episodes": EPISODES,
        "seed": SEED,
        "noise": NOISE,
    })
}

/// Whose figures are wanted.
pub struct Candidate<'a> {
    /// The task, as the program tells it.
    pub task: &'a Value,
    pub task_hash: &'a str,
    /// A name of a shipped controller, or a path.
    pub controller: String,
    /// Whether it is put to the test too.
    pub falsifies: bool,
    /// What the files of this measurement are called.
    pub name: String,
}

/// Measures controllers by the program.
pub struct Bench<'a> {
    pub home: &'a Home,
    pub program: &'a Program,
    pub stop: &'a AtomicBool,
}

impl Bench<'_> {
    /// Measures one.
    ///
    /// # Errors
    /// If the program cannot, or is interrupted.
    pub fn measure(&self, candidate: &Candidate<'_>) -> Result<Measured> {
        let evaluate = |part: &str, noise: f64| {
            let (episodes, noise) = (EPISODES.to_string(), noise.to_string());
            let words = ["--box", part, "--episodes", &episodes, "--action-noise", &noise];
            self.run("evaluate", candidate, &words)
        };
        let both = |part: &str| NOISE.iter().map(|noise| evaluate(part, *noise)).collect::<Result<Vec<_>>>();
        let evaluations = both("reachable")?;
        let whole_box = match evaluations[0]["leaves_out_starts"] == true {
            true => Value::Array(both("whole")?),
            false => Value::Null,
        };
        let (trials, noise) = (TRIALS.to_string(), NOISE[1].to_string());
        let words = ["--search", "random", "--trials", &trials, "--action-noise", &noise];
        let falsification =
            if candidate.falsifies { self.run("falsify", candidate, &words)? } else { Value::Null };
        Ok(Measured {
            commit: self.program.commit()?,
            conditions: conditions(candidate.task, candidate.task_hash),
            evaluations,
            whole_box,
            falsification,
        })
    }

    fn run(&self, verb: &str, candidate: &Candidate<'_>, words: &[&str]) -> Result<Value> {
        let file = |ending: &str| self.home.path(&format!("target/controllers/{}{ending}", candidate.name));
        let (run, out, log) = (file(".sqlite"), file(".json"), file(".log"));
        remove(&run)?;
        let task = candidate.task["name"].as_str().unwrap_or_default();
        let (seed, path) = (SEED.to_string(), run.to_string_lossy());
        let ours = [verb, task, "--controller", &candidate.controller];
        let last = ["--seed", &seed, "--json", "--out", &path];
        let mut command = self.program.nice(&[&ours, words, &last].concat());
        // Exit code 1 says that a counterexample was found, which is what a falsification is for.
        let said = workers::run(&mut command, &[0, 1], &out, &log, self.stop)?;
        for file in [run, out] {
            remove(&file)?;
        }
        serde_json::from_str(&said).with_context(|| format!("`{verb}` wrote no JSON document"))
    }
}

/// Removes a file if it is there.
///
/// # Errors
/// If it is there and stays.
pub fn remove(path: &Path) -> Result<()> {
    if path.exists() {
        fs::remove_file(path).with_context(|| path.display().to_string())?;
    }
    Ok(())
}
