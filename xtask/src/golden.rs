//! `cargo xtask golden`: regenerates the golden files, which hold results of reference programs
//! (RTAMT, SciPy, PyTorch).
//!
//! A folder `crates/<crate>/tests/golden/<name>` contains a `make.py`, its `requirements.txt`, and
//! the files that it writes: the same bytes each time. It runs in its own virtual environment under
//! `target`.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};

use crate::process::run;
use crate::venv;

struct Golden {
    /// `<crate>-<name>`
    id: String,
    /// `<name>`
    name: String,
    folder: PathBuf,
}

/// Runs `make.py` in the folders with one of the given names (in all folders if there is no name),
/// and shows the changes.
///
/// # Errors
/// If no folder has one of the names, or a command fails.
pub fn remake(root: &Path, names: &[String]) -> Result<()> {
    let found = find(root)?;
    let known = || found.iter().map(|golden| golden.id.as_str()).collect::<Vec<_>>().join(", ");
    let is_called = |golden: &Golden, name: &String| golden.name == *name || golden.id == *name;
    for name in names {
        ensure!(
            found.iter().any(|golden| is_called(golden, name)),
            "unknown golden files `{name}`; expected one of {}",
            known()
        );
    }
    let chosen: Vec<&Golden> = found
        .iter()
        .filter(|golden| names.is_empty() || names.iter().any(|name| is_called(golden, name)))
        .collect();
    for golden in &chosen {
        eprintln!("{}: running {}", golden.id, golden.folder.join("make.py").display());
        let python = venv::installed(
            &root.join("target/golden-venv").join(&golden.id),
            &golden.folder.join("requirements.txt"),
        )?;
        // No .pyc files beside the golden files, and no order that depends on random hashes.
        let fixed = [("PYTHONDONTWRITEBYTECODE", "1"), ("PYTHONHASHSEED", "0")];
        run(Command::new(python).arg("make.py").current_dir(&golden.folder).envs(fixed), &[0])?;
    }
    let folders = || chosen.iter().map(|golden| &golden.folder);
    eprintln!("regenerated {}; changes in git:", chosen.len());
    run(Command::new("git").args(["status", "--short", "--"]).args(folders()).current_dir(root), &[0])?;
    run(
        Command::new("git").args(["--no-pager", "diff", "--stat", "--"]).args(folders()).current_dir(root),
        &[0],
    )
}

/// Returns every golden folder, sorted by its id.
fn find(root: &Path) -> Result<Vec<Golden>> {
    let mut found = Vec::new();
    for package in folders_in(&root.join("crates"))? {
        for folder in folders_in(&package.join("tests/golden"))? {
            let of = file_name(&package);
            let name = file_name(&folder);
            if folder.join("make.py").is_file() {
                found.push(Golden { id: format!("{of}-{name}"), name, folder });
            }
        }
    }
    found.sort_by(|a, b| a.id.cmp(&b.id));
    Ok(found)
}

/// Returns the folders in a folder; none if it does not exist.
fn folders_in(folder: &Path) -> Result<Vec<PathBuf>> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let entries = fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))?;
    let paths = entries.map(|entry| Ok(entry?.path())).collect::<Result<Vec<_>>>()?;
    Ok(paths.into_iter().filter(|path| path.is_dir()).collect())
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
