//! Learning curve: a CSV file with one row per iteration.

mod row;
mod training_time;
mod writer;

use std::path::Path;

use csv::{ReaderBuilder, StringRecord};
use mishandle_files::{limits, read_bounded};
use row::{
    COLUMNS, CURRICULUM_COLUMNS, REWARD, SCENARIO_COLUMNS, has_curriculum_columns, has_scenario_columns,
};

use crate::error::{CurveProblem, MishandleError};

pub use row::CurveRow;
pub use training_time::NoTrainingTime;
pub(crate) use writer::has_no_rows;
pub(crate) use writer::{CurveColumns, CurveWriter};

/// Learning curve of a training run, as written by `mishandle train --csv FILE`.
///
/// # Example
/// ```
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("curve.csv");
/// let columns = "iteration,environment_steps,wall_clock_secs,mean_return,mean_episode_steps,terminated_rate,\
///                success_rate,strict_success_rate,validation_return,kl,entropy,learning_rate,physics_share,\
///                inference_share,learning_share,reward_distance";
/// let row = "1,8192,0.412,,,,,,,0.01,4.1,0.001,0.6,0.1,0.3,-0.25";
/// std::fs::write(&path, format!("{columns}\n{row}\n"))?;
/// let curve = mishandle::train::Curve::load(&path)?;
/// assert_eq!(curve.reward_terms, ["distance"]);
/// assert_eq!((curve.rows[0].mean_return, curve.rows[0].control_steps(512)), (None, 16));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// Whether it has the columns of the validations on scenarios.
    pub has_scenarios: bool,
    /// Whether it has the columns of a curriculum.
    pub has_curriculum: bool,
    /// Names of the reward terms.
    pub reward_terms: Vec<String>,
    /// One row per iteration, without gaps. The first iteration is not 1 if a resumed run created
    /// the file.
    pub rows: Vec<CurveRow>,
    /// Whether the last line of the file is incomplete, as after a killed run; `rows` does not
    /// contain it.
    pub is_truncated: bool,
}

impl Curve {
    /// Reads a curve, a regular file of at most [`limits::CURVE`] bytes.
    ///
    /// # Errors
    /// If the file cannot be read, is larger or is not a curve; the message names the line.
    pub fn load(path: &Path) -> Result<Curve, MishandleError> {
        let (curve, _) = read(path, None)?;
        Ok(curve)
    }
}

/// Reads a curve, or its part up to iteration `last`; returns the curve and its number of bytes.
fn read(path: &Path, last: Option<u64>) -> Result<(Curve, u64), MishandleError> {
    let wrong = |problem| MishandleError::Curve { path: path.to_path_buf(), problem };
    let failed = MishandleError::file(path);
    parse(&read_bounded(path, limits::CURVE).map_err(failed)?, last).map_err(wrong)
}

fn parse(bytes: &[u8], last: Option<u64>) -> Result<(Curve, u64), CurveProblem> {
    let whole = bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1);
    let text = &bytes[..whole];
    if let Err(error) = std::str::from_utf8(text) {
        return Err(CurveProblem::NotUtf8 { line: line_at(text, error.valid_up_to()) });
    }
    // The reader's own error for a line with another number of cells counts records instead of
    // lines.
    let mut reader = ReaderBuilder::new().flexible(true).from_reader(text);
    let columns = reader.headers()?.clone();
    let is_truncated = whole < bytes.len();
    let reward_terms = reward_terms(&columns)?;
    let has_scenarios = has_scenario_columns(&columns);
    let has_curriculum = has_curriculum_columns(&columns);
    let mut curve = Curve { has_scenarios, has_curriculum, reward_terms, rows: Vec::new(), is_truncated };
    let mut record = StringRecord::new();
    while reader.read_record(&mut record)? {
        let line = || line_of(text, &record);
        let found = record.len();
        let expected = columns.len();
        if found != expected {
            return Err(CurveProblem::Cells { line: line(), found, expected });
        }
        let row = CurveRow::read(&columns, &record, &line)?;
        if let Some(before) = curve.rows.last() {
            check_order(before, &row, line)?;
        }
        let is_last = last == Some(row.iteration);
        curve.rows.push(row);
        if is_last {
            break;
        }
    }
    Ok((curve, reader.position().byte()))
}

/// Returns the line of a record, counted from 1. Its position is before the blank lines that
/// precede it.
fn line_of(text: &[u8], record: &StringRecord) -> u64 {
    let start = record.position().map_or(0, csv::Position::byte) as usize;
    let blank = text.iter().skip(start).take_while(|byte| matches!(byte, b'\r' | b'\n')).count();
    line_at(text, start + blank)
}

/// Returns the line of a byte offset, counted from 1.
fn line_at(text: &[u8], offset: usize) -> u64 {
    1 + text.iter().take(offset).filter(|byte| **byte == b'\n').count() as u64
}

/// Returns the names of the reward terms.
///
/// # Errors
/// If the other columns are not those of a curve.
fn reward_terms(columns: &StringRecord) -> Result<Vec<String>, CurveProblem> {
    let wrong = |at: usize, expected: String| CurveProblem::Columns {
        number: at + 1,
        expected,
        found: columns.get(at).unwrap_or_default().to_string(),
    };
    if let (1, Some(header)) = (columns.len(), columns.get(0))
        && let Some((_, separator)) =
            [(';', "semicolons"), ('\t', "tabs")].iter().find(|(c, _)| header.contains(*c))
    {
        return Err(CurveProblem::Separator { separator });
    }
    let on_scenarios = SCENARIO_COLUMNS.iter().filter(|_| has_scenario_columns(columns));
    let of_curriculum = CURRICULUM_COLUMNS.iter().filter(|_| has_curriculum_columns(columns));
    let expected: Vec<&&str> = COLUMNS.iter().chain(on_scenarios).chain(of_curriculum).collect();
    for (at, name) in expected.iter().enumerate() {
        if columns.get(at) != Some(**name) {
            return Err(wrong(at, format!("`{name}`")));
        }
    }
    let rest = columns.iter().enumerate().skip(expected.len());
    rest.map(|(at, name)| {
        let term = name.strip_prefix(REWARD).map(String::from);
        term.ok_or_else(|| wrong(at, format!("`{REWARD}` and the name of a reward term")))
    })
    .collect()
}

fn check_order(before: &CurveRow, row: &CurveRow, line: impl Fn() -> u64) -> Result<(), CurveProblem> {
    if row.iteration != before.iteration + 1 {
        return Err(CurveProblem::Order { line: line(), found: row.iteration, before: before.iteration });
    }
    if row.environment_steps <= before.environment_steps {
        let found = row.environment_steps;
        let before = before.environment_steps;
        return Err(CurveProblem::Steps { line: line(), found, before });
    }
    Ok(())
}

#[cfg(test)]
mod tests;
