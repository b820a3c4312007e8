//! The reports in the folder of a check.

use std::path::{Path, PathBuf};

use anyhow::Result;
use mishandle::results::Check;
use mishandle_report::{CHECK_REPORTS, CheckFigures, check_reports};

use crate::show::output;

/// Writes the page, the table in Markdown and the verdicts as JUnit XML to the folder of a check.
/// Returns the path of the page. The drawing of counterexamples ends if `must_end` says so.
pub fn write(found: &Check, folder: &Path, must_end: &mut dyn FnMut() -> bool) -> Result<PathBuf> {
    for (name, content) in check_reports(found, &CheckFigures::draw(found, false, must_end)) {
        output::write_atomically(&folder.join(name), true, content.as_bytes())?;
    }
    Ok(folder.join(CHECK_REPORTS[0]))
}
