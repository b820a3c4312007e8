//! Checks that the output files of a training run can be written, without creating them.

use std::path::Path;

use mishandle_training::Checkpoint;

use crate::error::MishandleError;
use crate::plan::TrainPlan;
use crate::train::curve::{CurveColumns, CurveWriter};
use crate::train::tensorboard::EventFile;

/// Checks that all output files of a plan can be written; `resumed` is the checkpoint to resume
/// from.
///
/// # Errors
/// The errors with which training would fail before its first step.
pub(crate) fn check(
    plan: &TrainPlan,
    columns: CurveColumns<'_>,
    resumed: Option<&Checkpoint>,
) -> Result<(), MishandleError> {
    plan.check_extension()?;
    plan.check_distinct_outputs()?;
    plan.check_existing_files()?;
    let here = Path::new(".");
    check_folder(plan.out.parent().unwrap_or(here))?;
    if let Some(csv) = &plan.csv {
        check_folder(csv.parent().unwrap_or(here))?;
        if let Some(checkpoint) = resumed.filter(|_| csv.exists()) {
            // Opening a curve writes nothing.
            CurveWriter::resume(csv, columns, checkpoint)?;
        }
    }
    if let Some(folder) = &plan.tensorboard {
        EventFile::check(folder, resumed.is_some())?;
        check_folder(folder)?;
    }
    Ok(())
}

/// Checks that files can be created in a folder, or in its nearest existing parent.
fn check_folder(folder: &Path) -> Result<(), MishandleError> {
    let present = folder.ancestors().find(|folder| folder.exists()).unwrap_or(Path::new("."));
    // A temporary file without a name; the system deletes it when it is closed.
    let file = tempfile::tempfile_in(present);
    file.map(drop).map_err(MishandleError::write("folder", folder))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checking_a_folder_leaves_no_files() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        assert!(check_folder(folder).is_ok() && check_folder(&folder.join("a/b")).is_ok());
        assert_eq!(std::fs::read_dir(folder).unwrap().count(), 0);
        std::fs::write(folder.join("file"), "").unwrap();
        let error = check_folder(&folder.join("file/a")).unwrap_err();
        assert!(matches!(&error, MishandleError::Write { path, .. } if path.ends_with("file/a")), "{error}");
        assert!(check_folder(Path::new("/proc/none")).is_err());
    }
}
