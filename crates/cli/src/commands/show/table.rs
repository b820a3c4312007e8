use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use mishandle::inspect::run_facts;
use mishandle::results::{RelationCounts, RunFacts, RunSummary};
use mishandle::store::RunFile;
use mishandle_text::{decimal, plural, shell_path};

use crate::exit_status::ExitStatus;
use crate::run::path_kind::is_counterexample;
use crate::show::escape;
use crate::show::output;
use crate::words;

/// Lists run files, and those in folders, with what they contain.
pub fn show(given: &[PathBuf], json: bool) -> Result<ExitStatus> {
    let mut paths = Vec::new();
    for path in given {
        if path.is_dir() {
            paths.extend(run_files(path)?);
        } else {
            ensure!(path.exists(), "there is no run file or folder {}", path.display());
            paths.push(path.clone());
        }
    }
    let entries: Vec<RunSummary> = paths.iter().map(|path| summary(path)).collect();
    if json {
        output::json_array(&entries)?;
        return Ok(ExitStatus::Done);
    }
    if entries.is_empty() {
        output::message("no run files (*.sqlite)");
        if let Some(folder) = given.iter().find(|path| has_counterexamples(path)) {
            let folder = shell_path(folder);
            output::message(&format!(
                "hint: `mishandle regress {folder}` simulates the counterexamples (*.json) there, `mishandle show FILE` explains one"
            ));
        }
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
        if let Some(causes) = &entry.error {
            output::message(&format!("warning: cannot read {}: {causes}", entry.run));
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

fn has_counterexamples(folder: &Path) -> bool {
    let entries = fs::read_dir(folder).into_iter().flatten();
    entries.flatten().any(|entry| is_counterexample(&entry.path()))
}

fn is_run_file(path: &Path) -> bool {
    path.is_file() && path.extension().is_some_and(|extension| extension == "sqlite")
}

fn summary(path: &Path) -> RunSummary {
    // A list needs no check of every row; the commands that use a run check it.
    let read = || -> Result<RunFacts> { Ok(run_facts(&RunFile::open_unchecked(path)?)?) };
    let (error, facts) = match read() {
        Ok(facts) => (None, Some(facts)),
        Err(error) => (Some(words::with_causes(error.chain())), None),
    };
    RunSummary { run: path.to_string_lossy().into_owned(), error, facts }
}

fn row(entry: &RunSummary) -> Vec<String> {
    let path = escape::name(&entry.run);
    let Some(facts) = &entry.facts else {
        return vec![path, "not readable".to_string()];
    };
    let result = match facts.kind.as_str() {
        _ if facts.simulations > 0 && facts.minimum_robustness.is_none() => "no verdict".to_string(),
        "falsify" => format!("falsified {} of {}", facts.falsified_trials, facts.trials),
        "margin" if facts.failures > 0 => "violation found".to_string(),
        "margin" => "no violation".to_string(),
        "risk" => "estimated".to_string(),
        _ => facts.relations.map_or("evaluated".to_string(), |RelationCounts { asked, broken }| {
            format!("broken {broken} of {}", plural(asked, "relation"))
        }),
    };
    vec![
        path,
        facts.kind.clone(),
        escape::name(&facts.target),
        format!(
            "{}{}",
            escape::name(&facts.controller),
            if facts.guard.is_some() { ", guarded" } else { "" }
        ),
        facts.search.clone(),
        facts.simulations.to_string(),
        facts.failures.to_string(),
        facts.minimum_robustness.map_or("-".to_string(), |rho| decimal(rho.0, 4)),
        if facts.is_complete { result } else { format!("{result}, not finished") },
    ]
}
