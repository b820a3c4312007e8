//! Files that the build makes from types and declarations within seconds: reference pages, the
//! schemas of JSON documents, and the Python classes of results. Git ignores them.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};

use crate::process::{cargo, run};

/// Folder of pages and schemas, from the root.
pub const FOLDER: &str = "target/reference";

/// Pages of `docs` that are the beginning of a page in [`FOLDER`].
pub const PAGES: [(&str, &str); 2] =
    [("docs/reference/json.md", "json.md"), ("docs/reference/algorithms/settings.md", "settings.md")];

/// Writes everything into an empty folder.
///
/// # Errors
/// As [`results`].
pub fn write(root: &Path) -> Result<()> {
    let folder = root.join(FOLDER);
    if folder.exists() {
        fs::remove_dir_all(&folder).with_context(|| format!("cannot remove {}", folder.display()))?;
    }
    results(root)?;
    settings(root)
}

/// `cargo xtask results`: writes the page and the schemas of results, and the Python classes.
///
/// # Errors
/// If the example cannot be built, or a file cannot be written.
pub fn results(root: &Path) -> Result<()> {
    example(root, &["-p", "mishandle-results", "--features", "schema", "--example", "generate"])
}

/// `cargo xtask settings`: writes the page of all training settings.
///
/// # Errors
/// As [`results`].
pub fn settings(root: &Path) -> Result<()> {
    example(root, &["-p", "mishandle-training", "--example", "settings_page"])
}

fn example(root: &Path, arguments: &[&str]) -> Result<()> {
    run(&mut cargo(root, &[&["run", "--quiet"], arguments].concat()), &[0])
}
