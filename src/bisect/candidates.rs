//! Candidates of a bisection: the controllers of a folder.

use std::path::{Path, PathBuf};

use mishandle_text::{path_text, plural};

use crate::error::{MishandleError, problem};

/// Endings of controllers.
const ENDINGS: [&str; 2] = ["safetensors", "onnx"];

/// A controller of an ordered list.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Candidate {
    /// Name of the file.
    pub name: String,
    /// Path of the controller.
    pub controller: PathBuf,
}

/// Returns the controllers of a folder, ordered by name. Numbers in names are ordered by value, so
/// that `step-9` is before `step-10`.
///
/// # Errors
/// If the folder cannot be read, or has fewer than two controllers.
pub(super) fn candidates(folder: &Path) -> Result<Vec<Candidate>, MishandleError> {
    if folder.is_file() {
        return Err(problem(format!("{} is a file: name the folder of the controllers", path_text(folder))));
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
