//! Whether a target file stays in its folder.

use std::path::Path;

use crate::description::{Description, PolicySource};
use crate::document::{self, Fields, Text};
use crate::error::{Problem, RobotError};
use crate::target::read_text;

/// Checks that a target file of others names only files in its own folder, before any of them is
/// read.
///
/// # Errors
/// If the file cannot be read or is wrong, or names a file outside its folder or allows one; the
/// message names the line.
pub fn check_inside(path: &Path) -> Result<(), RobotError> {
    let text = read_text(path)?;
    let problem = |problem: Problem| problem.at(path, &text);
    let description = document::parse(&text).and_then(|table| Description::new(&table)).map_err(problem)?;
    let allows = Fields::new(&description.model, "[model]").flag("allow_outside").map_err(problem)?;
    let outside = |file: &Text, message: String| problem(Problem::new(&file.span, message));
    if allows {
        let message =
            "`allow_outside` is not possible here; the files must be in the folder of the target file";
        return Err(outside(&description.model_file, message.to_string()));
    }
    let policy = match &description.policy.source {
        PolicySource::File(file) => Some(file),
        _ => None,
    };
    for file in [Some(&description.model_file), policy].into_iter().flatten() {
        if leaves(path.parent().unwrap_or(Path::new("")), &file.text) {
            let message = format!("`{}` is outside the folder of the target file", file.text);
            return Err(outside(file, message));
        }
    }
    Ok(())
}

/// Returns whether a path leads out of a folder, also through a symbolic link.
fn leaves(folder: &Path, path: &str) -> bool {
    use std::path::Component;
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let is_plain = |part: Component<'_>| matches!(part, Component::Normal(_) | Component::CurDir);
    let is_inside = |found: &Path| folder.canonicalize().is_ok_and(|folder| found.starts_with(folder));
    // A missing file is an error of its own.
    !Path::new(path).components().all(is_plain)
        || folder.join(path).canonicalize().is_ok_and(|found| !is_inside(&found))
}
