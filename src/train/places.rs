//! Where a training's files go: whether they could go there, without a trace.

use std::path::Path;

use mishandle_training::Checkpoint;

use super::TrainPlan;
use crate::MishandleError;
use crate::curve::CurveWriter;
use crate::tensorboard::EventFile;

/// Checks that all that a plan wants written could be; `resumed` is the checkpoint that it carries on from.
///
/// # Errors
/// What a training would be refused for before its first step.
pub(crate) fn check(
    plan: &TrainPlan,
    reward_terms: &[String],
    resumed: Option<&Checkpoint>,
) -> Result<(), MishandleError> {
    plan.check_places()?;
    plan.check_presence()?;
    let here = Path::new(".");
    check_folder(plan.out.parent().unwrap_or(here))?;
    if let Some(csv) = &plan.csv {
        check_folder(csv.parent().unwrap_or(here))?;
        if let Some(checkpoint) = resumed.filter(|_| csv.exists()) {
            // Nothing is written when a curve is opened.
            CurveWriter::resume(csv, reward_terms, checkpoint)?;
        }
    }
    if let Some(folder) = &plan.tensorboard {
        EventFile::check(folder, resumed.is_some())?;
        check_folder(folder)?;
    }
    Ok(())
}

/// Checks that files can be made in a folder, or in the one that it would be made in.
fn check_folder(folder: &Path) -> Result<(), MishandleError> {
    let present = folder.ancestors().find(|folder| folder.exists()).unwrap_or(Path::new("."));
    // A file that has no name, and goes when it is closed.
    let file = tempfile::tempfile_in(present);
    file.map(drop).map_err(|source| MishandleError::File { path: folder.to_path_buf(), source })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_fine_if_it_can_be_made_and_nothing_is_left_in_it() {
        let bench = tempfile::tempdir().unwrap();
        let folder = bench.path();
        assert!(check_folder(folder).is_ok() && check_folder(&folder.join("a/b")).is_ok());
        assert_eq!(std::fs::read_dir(folder).unwrap().count(), 0);
        std::fs::write(folder.join("file"), "").unwrap();
        let refused = check_folder(&folder.join("file/a")).unwrap_err();
        assert!(
            matches!(&refused, MishandleError::File { path, .. } if path.ends_with("file/a")),
            "{refused}"
        );
        assert!(check_folder(Path::new("/proc/none")).is_err());
    }
}
