//! The files of a folder of evidence.

use std::path::{Component, Path};

use mishandle::files::refuse_link;

use crate::error::EvidenceError;

/// File with the hashes of all others.
pub const SUMS: &str = "SHA256SUMS";

/// File with the signature of [`SUMS`]: the name that `ssh-keygen -Y sign` gives it.
pub const SIGNATURE: &str = "SHA256SUMS.sig";

/// File that describes the folder.
pub const MANIFEST: &str = "manifest.json";

/// File for people.
pub const README: &str = "README.md";

/// Folder of the run files.
pub const RUNS: &str = "runs";

/// Folder of the pages.
pub const PAGES: &str = "pages";

/// Folder of the folders of checks.
pub const CHECKS: &str = "checks";

/// Folder of the folders with the files of targets.
pub const FILES: &str = "files";

/// Largest number of files: ten models of the largest number of files.
pub const MAX_FILES: usize = 20_000;

/// Largest depth of folders.
const MAX_DEPTH: usize = 32;

/// Largest length of a name, in bytes.
const MAX_NAME: usize = 4096;

/// Contents of a folder.
#[derive(Debug, Default)]
pub struct Found {
    /// Names of the regular files, with `/`, sorted.
    pub files: Vec<String>,
    /// Entries that the folder must not contain: links, devices, impossible names.
    pub problems: Vec<String>,
}

/// Lists the files of a folder and of the folders in it. Links are not followed.
///
/// # Errors
/// If a folder cannot be read.
pub fn list(folder: &Path) -> Result<Found, EvidenceError> {
    let mut found = Found::default();
    let mut folders = vec![(folder.to_path_buf(), String::new(), 1)];
    while let Some((next, prefix, depth)) = folders.pop() {
        for entry in std::fs::read_dir(&next).map_err(EvidenceError::file(&next))? {
            let entry = entry.map_err(EvidenceError::file(&next))?;
            let path = entry.path();
            let kind = entry.file_type().map_err(EvidenceError::file(&next))?;
            let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
            if entry.file_name().to_str().is_none() || !is_name(&name) {
                found.problems.push(format!("{name}: the name is not possible"));
            } else if refuse_link(&path).is_err() || !(kind.is_file() || kind.is_dir()) {
                found
                    .problems
                    .push(format!("{name}: it is a link or a device, which no folder of evidence has"));
            } else if kind.is_dir() && depth < MAX_DEPTH {
                folders.push((path, format!("{name}/"), depth + 1));
            } else if kind.is_dir() {
                found.problems.push(format!("{name}: folders are nested more than {MAX_DEPTH} deep"));
            } else {
                found.files.push(name);
            }
            if found.files.len() + found.problems.len() > MAX_FILES {
                found.problems.push(format!("the folder has more than {MAX_FILES} files"));
                return Ok(found);
            }
        }
    }
    found.files.sort_unstable();
    Ok(found)
}

/// Returns whether a name is a relative path within a folder that every line of a list of hashes
/// can hold: `sha256sum` escapes backslashes and line breaks.
pub fn is_name(name: &str) -> bool {
    let is_plain = |part: Component<'_>| matches!(part, Component::Normal(_));
    (1..=MAX_NAME).contains(&name.len())
        && !name.contains(|c: char| c.is_control() || c == '\\')
        && name.split('/').all(|part| !["", ".", ".."].contains(&part))
        && Path::new(name).components().all(is_plain)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_stays_in_the_folder() {
        for name in ["a", "runs/a.sqlite", "files/1/my arm.xml", "größe.html", "..a", "-n"] {
            assert!(is_name(name), "{name}");
        }
        for name in ["", "/etc/passwd", "../a", "a/../b", "a//b", "./a", "a/", "a\nb", "a\\b", "a\u{1b}"] {
            assert!(!is_name(name), "{name}");
        }
    }
}
