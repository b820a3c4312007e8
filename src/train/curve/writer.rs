use std::io;
use std::path::Path;

use mishandle_rollout::Environment;
use mishandle_training::{AlgorithmSettings, Checkpoint, TrainingProgress};

use super::row::{COLUMNS, CURRICULUM_COLUMNS, CurveRow, REWARD, SCENARIO_COLUMNS, secs_cell};
use super::{Curve, read};
use crate::error::{CurveProblem, MishandleError};
use mishandle_files::{GrowingFile, limits, read_bounded};

/// Writes a curve; each row is written after its iteration.
#[derive(Debug)]
pub(crate) struct CurveWriter {
    file: GrowingFile,
    has_scenarios: bool,
    has_curriculum: bool,
}

/// Columns of a curve besides those of every curve.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CurveColumns<'a> {
    /// Whether it has the validations on scenarios.
    pub has_scenarios: bool,
    /// Whether it has the columns of a curriculum, after those on scenarios.
    pub has_curriculum: bool,
    /// Names of the reward terms.
    pub reward_terms: &'a [String],
}

impl<'a> CurveColumns<'a> {
    /// Returns the columns of a training run.
    pub(crate) fn new(settings: &AlgorithmSettings, environment: &'a dyn Environment) -> CurveColumns<'a> {
        CurveColumns {
            has_scenarios: settings.scenarios().is_used(),
            has_curriculum: settings.scenarios().curriculum.is_some(),
            reward_terms: environment.reward_terms(),
        }
    }
}

/// Returns whether a file is a curve without rows, or the start of its first line.
pub(crate) fn has_no_rows(path: &Path) -> bool {
    let is_start = |bytes: Vec<u8>| {
        let columns = COLUMNS.join(",").into_bytes();
        !bytes.contains(&b'\n') && (columns.starts_with(&bytes) || bytes.starts_with(&columns))
    };
    read_bounded(path, limits::CURVE).is_ok_and(is_start)
        || Curve::load(path).is_ok_and(|curve| curve.rows.is_empty())
}

impl CurveWriter {
    /// Creates a new file.
    ///
    /// # Errors
    /// If the file exists or cannot be created.
    ///
    /// A file without rows, which a run that was killed in its first iteration leaves, is replaced.
    pub(crate) fn create(path: &Path, shape: CurveColumns<'_>) -> Result<CurveWriter, MishandleError> {
        if has_no_rows(path) {
            std::fs::remove_file(path).map_err(|source| write_error(path, source))?;
        }
        let CurveColumns { has_scenarios, has_curriculum, reward_terms } = shape;
        let columns = COLUMNS.iter().chain(SCENARIO_COLUMNS.iter().filter(|_| has_scenarios));
        let columns = columns.chain(CURRICULUM_COLUMNS.iter().filter(|_| has_curriculum));
        let columns = columns.map(|name| (*name).to_string());
        let columns = columns.chain(reward_terms.iter().map(|name| format!("{REWARD}{name}")));
        let file = GrowingFile::create(path.to_path_buf(), &line(columns));
        Ok(CurveWriter {
            file: file.map_err(|source| write_error(path, source))?,
            has_scenarios,
            has_curriculum,
        })
    }

    /// Resumes a curve after the row of the checkpoint. The next write removes later rows, because
    /// their iterations are repeated. A missing file is created.
    ///
    /// # Errors
    /// If the file is not a curve, belongs to another training run, or ends before the checkpoint.
    pub(crate) fn resume(
        path: &Path,
        shape: CurveColumns<'_>,
        checkpoint: &Checkpoint,
    ) -> Result<CurveWriter, MishandleError> {
        if !path.exists() {
            return CurveWriter::create(path, shape);
        }
        let wrong = |problem| MishandleError::Curve { path: path.to_path_buf(), problem };
        let iteration = checkpoint.u64s("iteration", 1)?[0];
        let expected = secs_cell(checkpoint.f64s("wall_clock_secs", 1)?[0]);
        let (curve, length) = read(path, Some(iteration))?;
        let CurveColumns { has_scenarios, has_curriculum, reward_terms } = shape;
        if curve.has_scenarios != has_scenarios {
            return Err(wrong(CurveProblem::Scenarios { found: curve.has_scenarios }));
        }
        if curve.has_curriculum != has_curriculum {
            return Err(wrong(CurveProblem::Curriculum { found: curve.has_curriculum }));
        }
        if curve.reward_terms != reward_terms {
            let expected = reward_terms.to_vec();
            return Err(wrong(CurveProblem::RewardTerms { expected, found: curve.reward_terms }));
        }
        if let Some(row) = curve.rows.last() {
            let found = secs_cell(row.wall_clock_secs);
            if row.iteration != iteration {
                return Err(wrong(CurveProblem::MissingRow { iteration }));
            }
            if found != expected {
                return Err(wrong(CurveProblem::OtherTraining { iteration, expected, found }));
            }
        }
        let file =
            GrowingFile::open(path.to_path_buf(), length).map_err(|source| write_error(path, source))?;
        Ok(CurveWriter { file, has_scenarios, has_curriculum })
    }

    /// Deletes the file if this writer created it.
    pub(crate) fn discard(self) {
        self.file.discard();
    }

    /// Writes the row of an iteration. The next call repeats a failed write.
    pub(crate) fn write(&mut self, progress: &TrainingProgress) -> Result<(), MishandleError> {
        let written =
            self.file.append(&line(CurveRow::from(progress).cells(self.has_scenarios, self.has_curriculum)));
        written.map_err(|source| write_error(self.file.path(), source))
    }

    /// Flushes all rows to disk.
    pub(crate) fn finish(&mut self) -> Result<(), MishandleError> {
        self.file.finish().map_err(|source| write_error(self.file.path(), source))
    }
}

fn write_error(path: &Path, source: io::Error) -> MishandleError {
    MishandleError::Write { what: "curve", path: path.to_path_buf(), source }
}

/// Returns a line of the file.
fn line(cells: impl IntoIterator<Item = String>) -> Vec<u8> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let reason = "writing to a vector does not fail";
    writer.write_record(cells).expect(reason);
    writer.into_inner().expect(reason)
}
