//! The kind of thing that a path names, by its content, then by the ending of its name.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use mishandle::files::{limits, read_text_bounded};
use mishandle::harden::{finished, is_hardening};
use mishandle::results::{Bisection, Check, Hardening};
use mishandle::store::RunFile;
use mishandle_text::{path_text, shell_path};
use toml::Table;

use crate::words::shell_command;

/// First bytes of a run file.
const SQLITE: &[u8] = b"SQLite format 3\0";

/// Number of bytes that say what a file is.
const START: u64 = 64;

/// First bytes of a learning curve: the name of its first column.
const CURVE_START: &[u8] = b"iteration,";

/// Kinds of files that commands expect.
pub const RUN: &str = "a run file";
pub const LOG: &str = "a log";
pub const CURVE: &str = "a learning curve";
pub const TARGET: &str = "a target file";
pub const PLAN: &str = "a plan";

/// The kind of thing that a path names.
pub enum PathKind {
    /// A run file, also one that is missing or damaged.
    Run,
    /// An exported counterexample.
    Counterexample,
    /// A controller: a file, or `TASK/NAME`.
    Controller,
    /// The learning curve of a training.
    Curve,
    /// A log of a robot.
    Log,
    /// A file that describes a target.
    Target,
    /// A file of requirements.
    Requirements,
    /// A plan.
    Plan,
    /// The folder of a check, which has this result.
    Check(Box<Check>),
    /// The folder of bisections, the last of which has this result.
    Bisection(Box<Bisection>),
    /// The folder of a hardening.
    Hardening,
    /// Another folder: of a campaign, or with run files.
    Folder,
    /// A file of another kind, or a name without a file.
    Other,
}

/// Returns what a path names. `TASK/NAME` is a shipped controller, whether or not there is a file
/// with this path; `./TASK/NAME` names that file.
///
/// # Errors
/// If the result in a folder cannot be read, or does not follow from the runs there.
pub fn of(path: &Path) -> Result<PathKind> {
    if is_controller_name(path) {
        return Ok(PathKind::Controller);
    }
    if path.is_dir() {
        return of_folder(path);
    }
    let ending = path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
    Ok(match ending.as_deref() {
        _ if is_run(path) => PathKind::Run,
        Some("sqlite") => PathKind::Run,
        _ if is_counterexample(path) => PathKind::Counterexample,
        // A reader says what is wrong with a file that is not text.
        Some("csv")
            if start(path).is_none_or(|start| start.starts_with(CURVE_START) || start.contains(&0)) =>
        {
            PathKind::Curve
        }
        Some("csv" | "tsv" | "jsonl" | "ndjson" | "npz" | "npy" | "parquet" | "pq") => PathKind::Log,
        Some("safetensors" | "onnx") => PathKind::Controller,
        Some("toml") => of_toml(path),
        _ => PathKind::Other,
    })
}

/// Returns what a TOML file is, by its keys.
fn of_toml(path: &Path) -> PathKind {
    let table = read_text_bounded(path, limits::PLAN).ok().and_then(|text| toml::from_str(&text).ok());
    match table {
        Some(table) if is_target(&table) => PathKind::Target,
        Some(table) if has_requirements(&table) => PathKind::Requirements,
        Some(table) if table.contains_key("target") => PathKind::Plan,
        _ => PathKind::Other,
    }
}

/// Returns whether a table is a target file rather than a plan: no plan has these keys.
pub fn is_target(table: &Table) -> bool {
    table.contains_key("process") || table.contains_key("model")
}

/// Returns whether a table is a file of requirements.
pub fn has_requirements(table: &Table) -> bool {
    table.contains_key("requirement")
}

/// Checks that a file is not of a kind that another command reads: `expected` are the kinds that
/// this one reads. The error names the command with the file. A missing file, and one of an unknown
/// kind, are left to the reader.
///
/// # Errors
/// If it is.
pub fn refuse_others(path: &Path, expected: &[&str]) -> Result<()> {
    if !path.is_file() {
        return Ok(());
    }
    let kind = of(path)?;
    let file = shell_path(path);
    let (found, command) = match kind {
        PathKind::Run if RunFile::open_unchecked(path).is_err() => return Ok(()),
        PathKind::Run => (RUN, format!("explain it with: mishandle show {file}")),
        PathKind::Curve => (CURVE, format!("draw it with: mishandle report {file} --out curve.html")),
        PathKind::Log => (LOG, format!("judge it with: mishandle monitor --formula FORMULA {file}")),
        PathKind::Target => (TARGET, format!("find its failures with: mishandle falsify {file}")),
        PathKind::Requirements => (
            "a file of requirements",
            format!("check them with: mishandle check TARGET --requirements {file} --out FOLDER"),
        ),
        PathKind::Plan => (PLAN, format!("run it with: mishandle run {file}")),
        PathKind::Controller => ("a controller", format!("show it with: mishandle show {file}")),
        _ => return Ok(()),
    };
    let names = expected.join(" or ");
    ensure!(expected.contains(&found), "{} is {found}, not {names}; {command}", path.display());
    Ok(())
}

/// Returns whether the name of a path is one of an exported counterexample.
pub fn is_counterexample(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("json"))
}

fn of_folder(folder: &Path) -> Result<PathKind> {
    if let Some(found) = mishandle::check::verified(folder, shell_command)? {
        return Ok(PathKind::Check(Box::new(found)));
    }
    if let Some(found) = mishandle::bisect::finished(folder)? {
        return Ok(PathKind::Bisection(Box::new(found)));
    }
    Ok(if is_hardening(folder).is_some() { PathKind::Hardening } else { PathKind::Folder })
}

/// Returns the result of the hardening in a folder.
///
/// # Errors
/// If it is not finished.
pub fn hardening(folder: &Path) -> Result<Hardening> {
    finished(folder)?.with_context(|| {
        let name = shell_path(folder);
        format!("the hardening is not finished; continue it with: mishandle harden --resume {name}")
    })
}

/// Returns whether a file starts as a run file.
fn is_run(path: &Path) -> bool {
    start(path).is_some_and(|start| start.starts_with(SQLITE))
}

/// Returns the first bytes of a file. Devices and pipes are not read.
fn start(path: &Path) -> Option<Vec<u8>> {
    let file = path.is_file().then(|| File::open(path).ok()).flatten()?;
    let mut start = Vec::new();
    file.take(START).read_to_end(&mut start).ok()?;
    Some(start)
}

/// Returns whether a path has the form `TASK/NAME`, and no other file or folder than a task's.
fn is_controller_name(path: &Path) -> bool {
    let text = path_text(path);
    let Some((task, name)) = text.split_once('/') else { return false };
    let is_task = mishandle::tasks::task(task).is_some();
    !name.contains(['/', '.']) && !task.is_empty() && task != "." && (is_task || !path.exists())
}
