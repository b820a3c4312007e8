use std::io;
use std::path::Path;

use mishandle_training::{Checkpoint, Progress};

use super::row::{COLUMNS, CurveRow, REWARD, secs_cell};
use super::{CurveProblem, read};
use crate::MishandleError;
use mishandle_files::GrowingFile;

/// A curve's file, being written: each row as soon as it is there.
#[derive(Debug)]
pub(crate) struct CurveWriter {
    file: GrowingFile,
}

impl CurveWriter {
    /// Begins a file that must not be there yet.
    ///
    /// # Errors
    /// If it is there, or cannot be made.
    pub(crate) fn create(path: &Path, reward_terms: &[String]) -> Result<CurveWriter, MishandleError> {
        let columns = COLUMNS.iter().map(|name| (*name).to_string());
        let columns = columns.chain(reward_terms.iter().map(|name| format!("{REWARD}{name}")));
        let file = GrowingFile::create(path.to_path_buf(), &line(columns));
        Ok(CurveWriter { file: file.map_err(|source| unwritten(path, source))? })
    }

    /// Goes on behind the row of the checkpoint. Rows behind it are of iterations that will be made again: they go
    /// when the next is written. A file that is not there, or has no row, is begun there.
    ///
    /// # Errors
    /// If the file is no curve, another training's, or ends before the checkpoint was taken.
    pub(crate) fn resume(
        path: &Path,
        reward_terms: &[String],
        checkpoint: &Checkpoint,
    ) -> Result<CurveWriter, MishandleError> {
        if !path.exists() {
            return CurveWriter::create(path, reward_terms);
        }
        let wrong = |problem| MishandleError::Curve { path: path.to_path_buf(), problem };
        let iteration = checkpoint.u64s("iteration", 1)?[0];
        let wanted = secs_cell(checkpoint.f64s("wall_clock_secs", 1)?[0]);
        let (curve, length) = read(path, Some(iteration))?;
        if curve.reward_terms != reward_terms {
            let wanted = reward_terms.to_vec();
            return Err(wrong(CurveProblem::RewardTerms { wanted, found: curve.reward_terms }));
        }
        if let Some(row) = curve.rows.last() {
            let found = secs_cell(row.wall_clock_secs);
            if row.iteration != iteration {
                return Err(wrong(CurveProblem::Behind { wanted: iteration }));
            }
            if found != wanted {
                return Err(wrong(CurveProblem::OtherTraining { iteration, wanted, found }));
            }
        }
        let file = GrowingFile::open(path.to_path_buf(), length).map_err(|source| unwritten(path, source))?;
        Ok(CurveWriter { file })
    }

    /// Takes the file away again, if it was begun here.
    pub(crate) fn discard(self) {
        self.file.discard();
    }

    /// Writes the row of an iteration. What cannot be written is tried again with the next.
    pub(crate) fn write(&mut self, progress: &Progress) -> Result<(), MishandleError> {
        let written = self.file.append(&line(CurveRow::from(progress).cells()));
        written.map_err(|source| unwritten(self.file.path(), source))
    }

    /// Has all rows reach the disk.
    pub(crate) fn finish(&mut self) -> Result<(), MishandleError> {
        self.file.finish().map_err(|source| unwritten(self.file.path(), source))
    }
}

fn unwritten(path: &Path, source: io::Error) -> MishandleError {
    MishandleError::Write { what: "curve", path: path.to_path_buf(), source }
}

/// A line of the file.
fn line(cells: impl IntoIterator<Item = String>) -> Vec<u8> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let right = "a vector takes all that is written to it";
    writer.write_record(cells).expect(right);
    writer.into_inner().expect(right)
}
