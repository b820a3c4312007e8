//! The program `mishandle`, as the chores call it.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail};
use serde_json::Value;

use super::facts::Wanted;
use super::home::{Home, write};
use super::measure::remove;
use super::plan::Training;
use crate::process::{as_typed, cargo, output, run};

const BUILT: &str = "target/release/mishandle";

/// How much below other programs trainings stand.
const NICENESS: &str = "10";

/// The program, and the folder that it works on.
#[derive(Clone, Debug)]
pub struct Program {
    file: PathBuf,
    home: Home,
}

impl Program {
    /// Builds the program.
    ///
    /// # Errors
    /// If it does not build.
    pub fn built(root: &Path, home: &Home) -> Result<Program> {
        run(&mut cargo(root, &["build", "--release", "-p", "mishandle-cli"]), &[0])?;
        Ok(Program { file: root.join(BUILT), home: home.clone() })
    }

    /// The program in that file.
    ///
    /// # Errors
    /// If there is none.
    pub fn at(file: &Path, home: &Home) -> Result<Program> {
        let file = file.canonicalize().with_context(|| file.display().to_string())?;
        Ok(Program { file, home: home.clone() })
    }

    /// The program with these words, on one thread, behind whatever else runs.
    pub fn nice(&self, words: &[&str]) -> Command {
        let mut command = Command::new("nice");
        command.args(["-n", NICENESS]).arg(&self.file).args(words).args(["--threads", "1"]);
        command.current_dir(self.home.folder()).env("MISHANDLE_HOME", self.home.folder());
        command
    }

    /// The commit that the program was built from.
    ///
    /// # Errors
    /// If the program does not tell it.
    pub fn commit(&self) -> Result<String> {
        let told = output(Command::new(&self.file).arg("-V"))?;
        let commit = told.trim().strip_suffix(')').and_then(|told| told.split_once('('));
        Ok(commit.with_context(|| format!("`-V` says `{}`", told.trim()))?.1.to_string())
    }

    fn json(&self, words: &[&str]) -> Result<Value> {
        let mut command = Command::new(&self.file);
        command.args(words).arg("--json").current_dir(self.home.folder());
        command.env("MISHANDLE_HOME", self.home.folder());
        let typed = as_typed(&command);
        serde_json::from_str(&output(&mut command)?)
            .with_context(|| format!("`{typed}` wrote no JSON document"))
    }

    /// The benchmark's tasks, without the variants of other tasks.
    ///
    /// # Errors
    /// If the program does not tell.
    pub fn tasks(&self) -> Result<Vec<Value>> {
        let Value::Array(mut tasks) = self.json(&["tasks"])? else { bail!("`tasks --json` is no list") };
        tasks.retain(|task| task["variant_of"].is_null());
        Ok(tasks)
    }

    /// What a training would hang on now.
    ///
    /// # Errors
    /// If its settings are wrong.
    pub fn wanted(&self, training: &Training) -> Result<Wanted> {
        let path = self.home.settings(training);
        let text = if path.is_file() { Some(std::fs::read_to_string(&path)?) } else { None };
        // Without settings of its own, the task is told under those of an empty text.
        let facts = self.dry_run(training, text.as_deref().unwrap_or_default());
        let facts = facts.with_context(|| path.display().to_string())?;
        let told = |key: &str| facts[key].as_str().unwrap_or_default().to_string();
        Ok(Wanted {
            settings: text.map(|_| told("settings")),
            task_hash: told("task_hash"),
            layout_hash: told("layout_hash"),
            formats: facts["formats"].clone(),
        })
    }

    /// Settings in full, as the present program reads them: what they leave out has its present default.
    ///
    /// # Errors
    /// If they are not settings of the algorithm any more.
    pub fn in_full(&self, training: &Training, settings: &str) -> Result<String> {
        let facts = self.dry_run(training, settings)?;
        Ok(facts["settings"].as_str().unwrap_or_default().to_string())
    }

    /// When a training became flat: `control_steps` of each environment and `secs`, null if its curve does not say.
    ///
    /// # Errors
    /// If the curve is none.
    pub fn training_time(&self, csv: &Path, environments: &str) -> Result<Value> {
        let path = csv.to_string_lossy();
        let told = self.json(&["curve", &path, "--environments", environments])?;
        Ok(told["training_time"].clone())
    }

    fn dry_run(&self, training: &Training, settings: &str) -> Result<Value> {
        let path = self.home.work(training, ".settings.toml");
        write(&path, settings.as_bytes())?;
        let (Training { task, algorithm, .. }, text) = (training, path.to_string_lossy());
        // Nothing is written there, but what is in the way of a training would keep a dry run, too.
        let out = self.home.work(training, ".dry-run");
        let places = ["--settings", &text, "--out", &out.to_string_lossy()];
        let told =
            self.json(&[&["train", task, "--algorithm", algorithm, "--dry-run"], &places[..]].concat());
        remove(&path)?;
        told
    }
}
