//! Candidates of a bisection: the controllers of a folder, or the revisions of a file in Git.

use std::path::{Path, PathBuf};
use std::process::Command;

use mishandle_files::{limits, write_atomically};
use mishandle_text::{path_text, plural};

use crate::error::MishandleError;

/// Endings of controllers.
const ENDINGS: [&str; 2] = ["safetensors", "onnx"];

/// A controller of an ordered list.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Candidate {
    /// Name of the file, or the revision.
    pub name: String,
    /// Path of the controller.
    pub controller: PathBuf,
}

/// Where the candidates of a bisection come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Source {
    /// The controllers of a folder, ordered by name. Numbers in names are ordered by value, so that
    /// `step-9` is before `step-10`.
    Folder(PathBuf),
    /// The revisions of a file in Git that changed it.
    Revisions {
        /// The controller.
        file: PathBuf,
        /// The first revision; `None`: the first one that has the file.
        good: Option<String>,
        /// The last revision; `None`: `HEAD`.
        bad: Option<String>,
    },
}

impl Source {
    /// Returns the candidates, the oldest first. Files of revisions are written to `revisions`.
    ///
    /// # Errors
    /// If a file cannot be read, `git` fails, or there are fewer than two candidates.
    pub(super) fn candidates(&self, revisions: &Path) -> Result<Vec<Candidate>, MishandleError> {
        match self {
            Source::Folder(folder) => folder_candidates(folder),
            Source::Revisions { file, good, bad } => {
                git_candidates(file, (good.as_deref(), bad.as_deref()), revisions)
            }
        }
    }
}

pub(super) fn problem(problem: impl Into<String>) -> MishandleError {
    MishandleError::Bisect { problem: problem.into() }
}

fn folder_candidates(folder: &Path) -> Result<Vec<Candidate>, MishandleError> {
    if folder.is_file() {
        let path = path_text(folder);
        return Err(problem(format!(
            "{path} is a file: name the folder of the controllers, or its revisions with --git {path}"
        )));
    }
    let unreadable = |error| problem(format!("the folder {} cannot be read: {error}", path_text(folder)));
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        let ending = path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
        let is_controller = ending.is_some_and(|ending| ENDINGS.contains(&ending.as_str()));
        if is_controller && path.is_file() {
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            found.push(Candidate { name, controller: path });
        }
    }
    found.sort_by(|a, b| natural(&a.name).cmp(&natural(&b.name)).then_with(|| a.name.cmp(&b.name)));
    match found.len() {
        0 | 1 => Err(problem(format!(
            "{} has {} (*.safetensors, *.onnx); a bisection needs at least 2",
            path_text(folder),
            plural(found.len() as u64, "controller")
        ))),
        _ => Ok(found),
    }
}

/// Returns a name as texts and numbers by turns. Leading zeros do not count, so a longer number is
/// a larger one.
fn natural(name: &str) -> Vec<(String, usize, String)> {
    let mut parts = Vec::new();
    let mut rest = name;
    while !rest.is_empty() {
        let digits = rest.find(|c: char| c.is_ascii_digit()).unwrap_or(rest.len());
        let (text, after) = rest.split_at(digits);
        let end = after.find(|c: char| !c.is_ascii_digit()).unwrap_or(after.len());
        let (number, after) = after.split_at(end);
        let number = number.trim_start_matches('0');
        parts.push((text.to_string(), number.len(), number.to_string()));
        rest = after;
    }
    parts
}

/// Returns the revisions of a controller in Git from `good` to `bad` that changed it, the oldest
/// first, and writes their files to `folder`. Neither the working tree nor the index is touched.
fn git_candidates(
    file: &Path,
    (good, bad): (Option<&str>, Option<&str>),
    folder: &Path,
) -> Result<Vec<Candidate>, MishandleError> {
    let parent = file.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if file.is_dir() {
        return Err(problem(format!("{} is a folder: name a controller in it", path_text(file))));
    }
    let name = file.file_name().ok_or_else(|| problem(format!("{} names no file", path_text(file))))?;
    let name = name.to_string_lossy();
    if git(parent, &["rev-parse", "--git-dir"]).is_err() {
        return Err(problem(format!("{} is in no Git repository", path_text(file))));
    }
    let has_file =
        |revision: &str| git(parent, &["rev-parse", "--verify", "--quiet", &format!("{revision}:./{name}")]);
    let commit = |revision: &str| {
        let hint = match revision.contains("..") {
            true => "; a range is --good REV --bad REV",
            false => "",
        };
        let commit = format!("{revision}^{{commit}}");
        git(parent, &["rev-parse", "--verify", "--quiet", "--end-of-options", &commit])
            .map_err(|_| problem(format!("Git knows no revision {revision}{hint}")))
    };
    // Another revision in the place of a named end would be an answer to another question.
    let end = |revision: &str| -> Result<String, MishandleError> {
        let commit = text(&commit(revision)?);
        match has_file(&commit) {
            Ok(_) => Ok(commit),
            Err(_) => Err(problem(format!("the revision {revision} has no file {}", path_text(file)))),
        }
    };
    let last = bad.unwrap_or("HEAD");
    let (bad, first) = (end(last)?, good);
    let good = good.map(end).transpose()?;
    if let (Some(first), Some(good)) = (first, &good)
        && git(parent, &["merge-base", "--is-ancestor", good, &bad]).is_err()
    {
        return Err(problem(format!("the revision {first} is not an ancestor of {last}")));
    }
    let range = match &good {
        Some(good) => format!("{good}..{bad}"),
        None => bad.clone(),
    };
    let listed = git(parent, &["rev-list", "--reverse", "--topo-order", &range, "--", &name])?;
    let listed = text(&listed);
    // A revision that does not change the file has that of the one before.
    let mut revisions: Vec<&str> = good.as_deref().into_iter().chain(listed.lines()).collect();
    revisions.dedup();
    std::fs::create_dir_all(folder)
        .map_err(|error| problem(format!("the folder {} cannot be created: {error}", path_text(folder))))?;
    let mut candidates: Vec<Candidate> = Vec::new();
    let mut last = None;
    for revision in revisions {
        // A revision without the file is not a candidate.
        let Ok(blob) = has_file(revision) else { continue };
        let blob = text(&blob);
        if last.as_ref() == Some(&blob) {
            continue;
        }
        let size = text(&git(parent, &["cat-file", "-s", &blob])?);
        if size.parse::<u64>().map_or(true, |size| size > limits::CONTROLLER) {
            return Err(problem(format!(
                "{name} of the revision {revision} has {size} bytes, which is too large"
            )));
        }
        let short: String = revision.chars().take(12).collect();
        let controller = folder.join(format!("{short}-{name}"));
        let bytes = git(parent, &["cat-file", "blob", &blob])?;
        write_atomically(&controller, &bytes)
            .map_err(|error| problem(format!("{} cannot be written: {error}", path_text(&controller))))?;
        candidates.push(Candidate { name: short, controller });
        last = Some(blob);
    }
    match candidates.len() {
        0 | 1 => Err(problem(format!(
            "Git has {} of {} in this range; a bisection needs at least 2",
            plural(candidates.len() as u64, "revision"),
            path_text(file)
        ))),
        _ => Ok(candidates),
    }
}

/// Runs `git` in a folder and returns what it prints.
fn git(folder: &Path, arguments: &[&str]) -> Result<Vec<u8>, MishandleError> {
    let output = Command::new("git")
        .arg("-C")
        .arg(folder)
        // A repository of others may name programs to run.
        .args(["-c", "core.fsmonitor=false", "--literal-pathspecs", "--no-pager", "--no-optional-locks"])
        .args(arguments)
        .output()
        .map_err(|error| problem(format!("the program git cannot be started: {error}")))?;
    match output.status.success() {
        true => Ok(output.stdout),
        false => {
            let said = String::from_utf8_lossy(&output.stderr).trim().to_string();
            Err(problem(format!("git {} fails: {said}", arguments.first().copied().unwrap_or_default())))
        }
    }
}

fn text(output: &[u8]) -> String {
    String::from_utf8_lossy(output).trim().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_names_are_ordered_by_value() {
        let mut names = ["step-10.onnx", "step-9.onnx", "step-0100.onnx", "last.onnx", "step-9b.onnx"];
        names.sort_by_key(|name| natural(name));
        assert_eq!(names, ["last.onnx", "step-9.onnx", "step-9b.onnx", "step-10.onnx", "step-0100.onnx"]);
    }
}
