//! The reports in the folder of a check.

use std::path::{Path, PathBuf};

use anyhow::Result;
use mishandle::results::Check;
use mishandle_report::check_page;

use crate::show::{check, output};

/// Writes the page, the table in Markdown and the verdicts as JUnit XML to the folder of a check.
/// Returns the path of the page.
pub fn write(found: &Check, folder: &Path) -> Result<PathBuf> {
    let page = folder.join("report.html");
    for (path, content) in [
        (folder.join("junit.xml"), check::junit(found)),
        (folder.join("report.md"), check::markdown(found)),
        (page.clone(), check_page(found)),
    ] {
        output::write_atomically(&path, true, content.as_bytes())?;
    }
    Ok(page)
}
