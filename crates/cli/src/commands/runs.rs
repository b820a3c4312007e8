use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use clap::Args;
use mishandle::store::{RunFile, RunHeader, RunKind, TrialStatus};
use mishandle::{controller_name, decimal};
use serde_json::{Value, json};

use crate::exit_status::ExitStatus;
use crate::show::escape;
use crate::show::output::{self, number};

/// List run files with what they contain
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle runs
  mishandle runs runs/controllers        the folder of a campaign
  mishandle runs a.sqlite b.sqlite")]
pub struct Arguments {
    /// Run files, or folders that contain run files [default: the folder runs]
    #[arg(value_name = "PATH", default_value = "runs")]
    pub paths: Vec<PathBuf>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

/// What a run file contains.
struct Entry {
    path: PathBuf,
    contents: Result<Contents>,
}

struct Contents {
    header: RunHeader,
    controller: String,
    simulations: u64,
    failures: u64,
    trials: usize,
    falsified_trials: usize,
    is_running: bool,
    minimum_robustness: Option<f64>,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    let mut paths = Vec::new();
    for path in &command.paths {
        if path.is_dir() {
            paths.extend(run_files(path)?);
        } else {
            ensure!(path.exists(), "there is no run file or folder {}", path.display());
            paths.push(path.clone());
        }
    }
    let entries: Vec<Entry> =
        paths.into_iter().map(|path| Entry { contents: contents(&path), path }).collect();
    if command.json {
        output::json(Value::Array(entries.iter().map(document).collect()))?;
        return Ok(ExitStatus::Done);
    }
    if entries.is_empty() {
        output::message("no run files (*.sqlite)");
        return Ok(ExitStatus::Done);
    }
    let header = [
        "run",
        "kind",
        "target",
        "controller",
        "search",
        "simulations",
        "failures",
        "min robustness",
        "result",
    ];
    let mut rows = vec![header.map(String::from).to_vec()];
    rows.extend(entries.iter().map(row));
    output::line(&output::table(&rows))?;
    for entry in &entries {
        if let Err(error) = &entry.contents {
            let causes = output::with_causes(error.chain());
            output::message(&format!("warning: cannot read {}: {causes}", entry.path.display()));
        }
    }
    Ok(ExitStatus::Done)
}

/// Returns the run files of a folder and of the folders in it, sorted.
fn run_files(folder: &Path) -> Result<Vec<PathBuf>> {
    let list = |folder: &Path| -> Result<Vec<PathBuf>> {
        let entries = fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))?;
        let mut paths = entries.map(|entry| Ok(entry?.path())).collect::<Result<Vec<_>>>()?;
        paths.sort();
        Ok(paths)
    };
    let mut found = Vec::new();
    for path in list(folder)? {
        // A link could lead out of the folder or back into it.
        if path.is_dir() && !path.is_symlink() {
            found.extend(list(&path)?.into_iter().filter(|path| is_run_file(path)));
        } else if is_run_file(&path) {
            found.push(path);
        }
    }
    Ok(found)
}

fn is_run_file(path: &Path) -> bool {
    path.is_file() && path.extension().is_some_and(|extension| extension == "sqlite")
}

fn contents(path: &Path) -> Result<Contents> {
    // A list needs no check of every row; the commands that use a run check it.
    let file = RunFile::open_unchecked(path)?;
    let trials = file.trials()?;
    let counts = file.counts()?;
    let with_status = |status| trials.iter().filter(|trial| trial.trial.status == status).count();
    Ok(Contents {
        controller: controller(file.header()),
        simulations: counts.simulations,
        failures: counts.falsified,
        trials: trials.len(),
        falsified_trials: with_status(TrialStatus::Falsified),
        is_running: mishandle::unfinished(&file)?.is_some(),
        minimum_robustness: trials.iter().filter_map(|trial| trial.minimum_robustness).reduce(f64::min),
        header: file.header().clone(),
    })
}

/// Returns the name of the run's controller; empty if its target has none.
fn controller(header: &RunHeader) -> String {
    let component = header.components.iter().find(|component| component.role == "controller");
    component.map_or(String::new(), |component| controller_name(&component.name))
}

fn row(entry: &Entry) -> Vec<String> {
    let path = escape::name(&entry.path.to_string_lossy());
    let Ok(contents) = &entry.contents else {
        return vec![path, "not readable".to_string()];
    };
    let Contents { header, falsified_trials, trials, is_running, .. } = contents;
    let result = match header.kind {
        RunKind::Falsify => format!("falsified {falsified_trials} of {trials}"),
        RunKind::Evaluate => "evaluated".to_string(),
    };
    vec![
        path,
        kind(header).to_string(),
        escape::name(&header.target.name),
        escape::name(&contents.controller),
        header.search.clone(),
        contents.simulations.to_string(),
        contents.failures.to_string(),
        contents.minimum_robustness.map_or("-".to_string(), |rho| decimal(rho, 4)),
        if *is_running { format!("{result}, not finished") } else { result },
    ]
}

fn kind(header: &RunHeader) -> &'static str {
    match header.kind {
        RunKind::Falsify => "falsify",
        RunKind::Evaluate => "evaluate",
    }
}

fn document(entry: &Entry) -> Value {
    let run = entry.path.to_string_lossy();
    match &entry.contents {
        Err(error) => json!({ "run": run, "error": output::with_causes(error.chain()) }),
        Ok(contents) => json!({
            "run": run,
            "error": Value::Null,
            "kind": kind(&contents.header),
            "target": contents.header.target.name,
            "target_kind": contents.header.target.kind,
            "controller": contents.controller,
            "space": contents.header.space,
            "formula": contents.header.formula,
            "search": contents.header.search,
            "seed": contents.header.seed.to_string(),
            "simulations": contents.simulations,
            "failures": contents.failures,
            "trials": contents.trials,
            "falsified_trials": contents.falsified_trials,
            "is_complete": !contents.is_running,
            "minimum_robustness": contents.minimum_robustness.map(number),
            "commit": contents.header.build.git_commit,
        }),
    }
}
