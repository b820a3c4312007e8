//! The page about a run of a folder.

use mishandle::ResolvedPlan;
use mishandle::results::Words;
use mishandle::store::RunFile;
use mishandle_report::{RunReport, page};

use crate::error::EvidenceError;

/// Returns the page. It depends on the run, its name in the folder and the build alone, so
/// verifying compares it.
///
/// `resolved` is the plan as it resolves in the folder, or why it does not.
pub(crate) fn text(
    run: &RunFile,
    file: &str,
    resolved: Result<&ResolvedPlan, &str>,
    words: Words,
) -> Result<String, EvidenceError> {
    let mut report = RunReport::load(run, file, resolved.ok(), words)?;
    report.hide_paths();
    if let Err(why) = resolved {
        report.add_note(format!("Simulations cannot be replayed from the folder of evidence: {why}."));
    }
    report.note_no_simulations("the page shows what the run file contains");
    Ok(page(&[report]))
}
