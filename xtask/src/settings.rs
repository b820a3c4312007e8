//! `cargo xtask settings`: writes the page of all training settings, which an example of the
//! training crate prints.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, ensure};

use crate::process::{cargo, output};

const PAGE: &str = "docs/reference/algorithms/settings.md";
const PRINT: &[&str] = &["run", "--quiet", "-p", "mishandle-training", "--example", "settings_page"];

/// Writes the page.
///
/// # Errors
/// If the example cannot be built, or the page cannot be written.
pub fn write(root: &Path) -> Result<()> {
    fs::write(root.join(PAGE), output(&mut cargo(root, PRINT))?).context(PAGE)
}

/// Checks that the page is up to date.
///
/// # Errors
/// If the example cannot be built, or the page is out of date.
pub fn check(root: &Path) -> Result<()> {
    compare(&fs::read_to_string(root.join(PAGE)).context(PAGE)?, &output(&mut cargo(root, PRINT))?)
}

fn compare(page: &str, printed: &str) -> Result<()> {
    let differing = (1..).zip(page.lines().zip(printed.lines())).find(|(_, (page, printed))| page != printed);
    let line = differing.map_or(1 + page.lines().count().min(printed.lines().count()), |(line, _)| line);
    ensure!(page == printed, "{PAGE}:{line}: the page is out of date; run `cargo xtask settings`");
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_line_that_differs_is_reported() {
        assert!(compare("a\nb\n", "a\nb\n").is_ok());
        for (page, line) in [("a\nc\n", 2), ("a\n", 2), ("a\nb\nc\n", 3), ("", 1)] {
            let error = compare(page, "a\nb\n").unwrap_err().to_string();
            assert!(
                error.starts_with(&format!("{PAGE}:{line}: the page is out of date")),
                "{page:?}: {error}"
            );
        }
    }
}
