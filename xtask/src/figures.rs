//! `cargo xtask figures`: measures the shipped controllers and writes the tables of README.md and controllers/README.md.
//!
//! A table stands between two comments, `<!-- figures: NAME -->` and `<!-- end of figures -->`; nothing in it is typed
//! by hand. What the paper reports stands beside it, from the table of its performance experiment.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};
use serde_json::Value;

use crate::process::{cargo, output, run};

/// Starts of an evaluation, and its seed: no training has seen it.
const EPISODES: u32 = 1000;
const SEED: u32 = 1;

/// Standard deviation of the action noise: the paper's.
const NOISE: f64 = 0.5;

/// What the paper reports for PPO, in percent: success rate without and with noise.
const PAPER: &[(&str, f64, f64)] =
    &[("point-reaching", 93.0, 87.0), ("ball-balancing", 98.0, 89.0), ("ball-pushing", 98.0, 97.0)];

const PROGRAM: &str = "target/release/mishandle";

/// Measures every shipped controller and every expert, and rewrites the tables.
///
/// # Errors
/// If something cannot be built, measured, read or written.
pub fn remake(root: &Path) -> Result<()> {
    run(&mut cargo(root, &["build", "--release"]), &[0])?;
    let tasks: Value = serde_json::from_str(&output(program(root).args(["tasks", "--json"]))?)?;
    let mut measured = Vec::new();
    for task in tasks.as_array().context("`tasks --json` is no list")? {
        for controller in task["controllers"].as_array().into_iter().flatten() {
            let figures = Figures::measure(root, text(&task["name"]), text(controller))?;
            eprintln!("{} {}: measured", figures.task, figures.controller);
            measured.push(figures);
        }
    }
    let commit = output(Command::new("git").args(["rev-parse", "--short=12", "HEAD"]).current_dir(root))?;
    replace(&root.join("README.md"), "tasks", &tasks_table(&tasks, &measured))?;
    replace(&root.join("controllers/README.md"), "controllers", &controllers_table(&measured, commit.trim()))
}

fn program(root: &Path) -> Command {
    let mut command = Command::new(root.join(PROGRAM));
    command.current_dir(root);
    command
}

fn text(value: &Value) -> String {
    value.as_str().unwrap_or_default().to_string()
}

/// What was measured of one controller.
struct Figures {
    task: String,
    controller: String,
    /// Evaluations without and with noise.
    evaluations: [Value; 2],
    /// A falsification of the success formula, with noise.
    falsification: Value,
    /// The training record in the controller's file; null for an expert.
    training: Value,
}

impl Figures {
    fn measure(root: &Path, task: String, controller: String) -> Result<Figures> {
        let runs = root.join("target/figures");
        fs::create_dir_all(&runs)?;
        let measure = |arguments: &[String], file: &str| -> Result<Value> {
            let path = runs.join(format!("{task}-{controller}-{file}.sqlite"));
            if path.exists() {
                fs::remove_file(&path)?;
            }
            let mut command = program(root);
            command.args(arguments).args(["--seed", &SEED.to_string(), "--json", "--out"]).arg(&path);
            // Exit code 1 says that a counterexample was found, which is what a falsification is for.
            let said = command.output()?;
            ensure!(matches!(said.status.code(), Some(0 | 1)), "{}", String::from_utf8_lossy(&said.stderr));
            Ok(serde_json::from_slice(&said.stdout)?)
        };
        let words = |line: String| line.split(' ').map(String::from).collect::<Vec<_>>();
        let evaluate = |noise: f64| {
            let line = format!(
                "evaluate {task} --controller {controller} --episodes {EPISODES} --action-noise {noise}"
            );
            measure(&words(line), &format!("noise{noise}"))
        };
        let evaluations = [evaluate(0.0)?, evaluate(NOISE)?];
        let falsification = measure(
            &words(format!(
                "falsify {task} --controller {controller} --search random --action-noise {NOISE}"
            )),
            "random",
        )?;
        let path = root.join("controllers").join(&task).join(format!("{controller}.safetensors"));
        let training = if path.is_file() { training_record(&path)? } else { Value::Null };
        Ok(Figures { task, controller, evaluations, falsification, training })
    }

    fn rate(&self, noise: usize, key: &str) -> String {
        percent(&self.evaluations[noise][key]["value"])
    }

    fn interval(&self, noise: usize, key: &str) -> String {
        let estimate = &self.evaluations[noise][key];
        format!(
            "{} [{}, {}]",
            percent(&estimate["value"]),
            percent(&estimate["low"]),
            percent(&estimate["high"])
        )
    }

    fn falsified(&self) -> String {
        format!(
            "{} of {}",
            self.falsification["falsified_trials"],
            self.falsification["trials"].as_array().map_or(0, Vec::len)
        )
    }
}

fn percent(value: &Value) -> String {
    value.as_f64().map_or("-".to_string(), |value| format!("{:.1}", 100.0 * value))
}

/// The training record in the header of a safetensors file: eight bytes of length, then JSON.
fn training_record(path: &PathBuf) -> Result<Value> {
    let bytes = fs::read(path)?;
    let length = bytes.first_chunk::<8>().map(|bytes| u64::from_le_bytes(*bytes) as usize);
    let json = length.and_then(|length| bytes.get(8..8 + length)).context("the file is cut short")?;
    let header: Value = serde_json::from_slice(json)?;
    let ours: Value = serde_json::from_str(&text(&header["__metadata__"]["mishandle"]))?;
    Ok(ours["training"].clone())
}

fn tasks_table(tasks: &Value, measured: &[Figures]) -> String {
    let mut table = String::from(
        "| task | success | SR | SR, noise 0.5 | strict SR | broken by random search, noise 0.5 |\n\
         |---|---|--:|--:|--:|--:|\n",
    );
    for task in tasks.as_array().into_iter().flatten() {
        let learned = measured.iter().find(|figures| figures.task == text(&task["name"]));
        let Some(figures) = learned else { continue };
        table += &format!(
            "| `{}` | `{}` | {} % | {} % | {} % | {} trials |\n",
            figures.task,
            text(&task["success"]),
            figures.rate(0, "success_rate"),
            figures.rate(1, "success_rate"),
            figures.rate(0, "strict_success_rate"),
            figures.falsified()
        );
    }
    table
}

fn controllers_table(measured: &[Figures], commit: &str) -> String {
    let mut table = format!(
        "Measured at commit {commit} by `cargo xtask figures`: {EPISODES} starts drawn from the whole box with seed \
         {SEED}, preset `paper`,\nmean action; in percent, with 95 % intervals (Wilson's for rates, bootstrap for \
         DBR); TCT in control steps of 1/60 s.\nThe second row of each pair has action noise of standard deviation \
         {NOISE}. The last column counts the trials of 30 in which random\nsearch found a violation of the success \
         formula within 300 simulations, with that noise.\n\n\
         | task | controller | noise | SR | strict SR | DBR | TCT | the paper's SR (PPO) | broken |\n\
         |---|---|--:|--:|--:|--:|--:|--:|--:|\n"
    );
    for figures in measured {
        for (i, noise) in [0.0, NOISE].into_iter().enumerate() {
            let paper = PAPER.iter().find(|(task, ..)| *task == figures.task && figures.controller == "ppo");
            table += &format!(
                "| `{}` | `{}` | {noise} | {} | {} | {} | {} | {} | {} |\n",
                figures.task,
                figures.controller,
                figures.interval(i, "success_rate"),
                figures.interval(i, "strict_success_rate"),
                figures.interval(i, "dangerous_behavior_rate"),
                figures.evaluations[i]["task_completion_time"]["value"]
                    .as_f64()
                    .map_or("-".to_string(), |steps| format!("{steps:.1}")),
                paper.map_or("-".to_string(), |paper| if i == 0 { paper.1 } else { paper.2 }.to_string()),
                if i == 0 { String::new() } else { figures.falsified() },
            );
        }
    }
    table += "\n| task | controller | command | environment steps to the best | wall clock of the training | commit |\n\
              |---|---|---|--:|--:|---|\n";
    for figures in measured.iter().filter(|figures| !figures.training.is_null()) {
        let training = &figures.training;
        table += &format!(
            "| `{}` | `{}` | `{}` | {} | {:.0} s | {} |\n",
            figures.task,
            figures.controller,
            text(&training["command"]),
            training["environment_steps"],
            training["wall_clock_secs"].as_f64().unwrap_or_default(),
            text(&training["git_commit"])
        );
    }
    table
}

/// Puts `table` between the comments of that name in a file.
fn replace(path: &Path, name: &str, table: &str) -> Result<()> {
    let old = fs::read_to_string(path).with_context(|| path.display().to_string())?;
    let new = replaced(&old, name, table).with_context(|| path.display().to_string())?;
    fs::write(path, new)?;
    Ok(())
}

fn replaced(old: &str, name: &str, table: &str) -> Result<String> {
    let (begin, end) = (format!("<!-- figures: {name} -->"), "<!-- end of figures -->");
    let start = old.find(&begin).with_context(|| format!("it has no `{begin}`"))? + begin.len();
    let stop = start + old[start..].find(end).with_context(|| format!("it has no `{end}`"))?;
    Ok(format!("{}\n{}\n{}", &old[..start], table.trim_end(), &old[stop..]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_stands_between_the_comments_is_replaced() {
        let old = "a\n<!-- figures: x -->\nold\n<!-- end of figures -->\nb\n";
        let new = replaced(old, "x", "new\n").unwrap();
        assert_eq!(new, "a\n<!-- figures: x -->\nnew\n<!-- end of figures -->\nb\n");
        assert!(replaced(old, "y", "new").unwrap_err().to_string().contains("figures: y"));
    }
}
