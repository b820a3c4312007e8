//! `cargo xtask settings`: writes the page of all training settings, which the program that declares them tells.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, ensure};

use crate::process::{cargo, output};

const PAGE: &str = "docs/algorithms/settings.md";
const TELL: &[&str] = &["run", "--quiet", "-p", "mishandle-training", "--example", "settings_page"];

/// Writes the page.
///
/// # Errors
/// If the program cannot be built, or the page not written.
pub fn write(root: &Path) -> Result<()> {
    fs::write(root.join(PAGE), output(&mut cargo(root, TELL))?).context(PAGE)
}

/// Checks that the page is what the program tells.
///
/// # Errors
/// If the program cannot be built, or the page is another.
pub fn check(root: &Path) -> Result<()> {
    compare(&fs::read_to_string(root.join(PAGE)).context(PAGE)?, &output(&mut cargo(root, TELL))?)
}

fn compare(page: &str, told: &str) -> Result<()> {
    let differing = (1..).zip(page.lines().zip(told.lines())).find(|(_, (page, told))| page != told);
    let line = differing.map_or(1 + page.lines().count().min(told.lines().count()), |(line, _)| line);
    ensure!(page == told, "{PAGE}:{line}: it is out of date; make it again with `cargo xtask settings`");
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_is_out_of_date_from_the_first_line_that_differs() {
        assert!(compare("a\nb\n", "a\nb\n").is_ok());
        for (page, line) in [("a\nc\n", 2), ("a\n", 2), ("a\nb\nc\n", 3), ("", 1)] {
            let told = compare(page, "a\nb\n").unwrap_err().to_string();
            assert!(told.starts_with(&format!("{PAGE}:{line}: it is out of date")), "{page:?}: {told}");
        }
    }
}
