//! A training's curve: a CSV file with a row for each iteration.

mod row;
mod training_time;
mod writer;

use std::path::Path;

use csv::{ReaderBuilder, StringRecord};

use crate::MishandleError;
use row::{COLUMNS, REWARD, line_of};

pub use row::CurveRow;
pub use training_time::NoTrainingTime;
pub(crate) use writer::CurveWriter;

/// A training's curve, as `mishandle train --csv FILE` writes it.
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
/// let curve = mishandle::Curve::load(&path)?;
/// assert_eq!(curve.reward_terms, ["distance"]);
/// assert_eq!((curve.rows[0].mean_return, curve.rows[0].control_steps(512)), (None, 16));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// Names of the reward's terms.
    pub reward_terms: Vec<String>,
    /// One for each iteration, without gaps. The first has another number than 1 if the file was begun by a resumed
    /// training.
    pub rows: Vec<CurveRow>,
    /// Whether the end of the file's last line is missing, as a killed training may leave it: it is no row then.
    pub is_cut: bool,
}

/// What is wrong with the file of a curve.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CurveProblem {
    /// It is a folder or a device.
    #[error("it is no plain file")]
    NoFile,
    /// Other columns than a curve has.
    #[error(
        "column {number} of its first line is `{found}`; it has to be {wanted}, as in a curve that `train --csv` wrote"
    )]
    Columns {
        /// Counted from 1.
        number: usize,
        /// What would be right.
        wanted: String,
        /// Its name, empty if it is missing.
        found: String,
    },
    /// A cell that cannot be read.
    #[error("line {line}: {column} is `{found}`; it has to be {wanted}")]
    Cell {
        /// Counted from 1.
        line: u64,
        /// The column's name.
        column: String,
        /// What stands there.
        found: String,
        /// What would be right.
        wanted: &'static str,
    },
    /// Iterations are not one after the other.
    #[error("line {line}: iteration {found} cannot follow iteration {before}")]
    Order {
        /// Counted from 1.
        line: u64,
        /// The iteration of this line.
        found: u64,
        /// The iteration of the line before.
        before: u64,
    },
    /// Environment steps do not grow with the iterations.
    #[error("line {line}: {found} environment steps cannot follow {before}")]
    Steps {
        /// Counted from 1.
        line: u64,
        /// Environment steps of this line.
        found: u64,
        /// Those of the line before.
        before: u64,
    },
    /// Rows of another reward.
    #[error("its reward terms are {}, those of this training {}", listed(found), listed(wanted))]
    RewardTerms {
        /// Those of the training.
        wanted: Vec<String>,
        /// Those of the file.
        found: Vec<String>,
    },
    /// It cannot go on where the checkpoint was taken.
    #[error(
        "it has no row of iteration {wanted}, where the checkpoint was taken; give another --csv for the rest"
    )]
    Behind {
        /// Iteration of the checkpoint.
        wanted: u64,
    },
    /// It is another training's.
    #[error(
        "it is another training's: its row of iteration {iteration} is from second {found}, the checkpoint from {wanted}"
    )]
    OtherTraining {
        /// Iteration of the checkpoint.
        iteration: u64,
        /// Wall clock of the checkpoint, s.
        wanted: String,
        /// Wall clock of the row, s.
        found: String,
    },
    /// It is not CSV, or has lines of different lengths.
    #[error(transparent)]
    Csv(#[from] csv::Error),
}

fn listed(names: &[String]) -> String {
    if names.is_empty() { "none".to_string() } else { names.join(", ") }
}

impl Curve {
    /// Reads a curve.
    ///
    /// # Errors
    /// If the file cannot be read, or is no curve; the message names the line.
    pub fn load(path: &Path) -> Result<Curve, MishandleError> {
        let (curve, _) = read(path, None)?;
        Ok(curve)
    }
}

/// The curve in a file, and how many bytes it takes: up to the row of an iteration, or all of it.
fn read(path: &Path, last: Option<u64>) -> Result<(Curve, u64), MishandleError> {
    let wrong = |problem| MishandleError::Curve { path: path.to_path_buf(), problem };
    let failed = |source| MishandleError::File { path: path.to_path_buf(), source };
    // A device may have no end.
    if !std::fs::metadata(path).map_err(failed)?.is_file() {
        return Err(wrong(CurveProblem::NoFile));
    }
    parse(&std::fs::read(path).map_err(failed)?, last).map_err(wrong)
}

fn parse(bytes: &[u8], last: Option<u64>) -> Result<(Curve, u64), CurveProblem> {
    let whole = bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1);
    let mut reader = ReaderBuilder::new().from_reader(&bytes[..whole]);
    let columns = reader.headers()?.clone();
    let is_cut = whole < bytes.len();
    let mut curve = Curve { reward_terms: reward_terms(&columns)?, rows: Vec::new(), is_cut };
    let mut record = StringRecord::new();
    while reader.read_record(&mut record)? {
        let row = CurveRow::read(&columns, &record)?;
        if let Some(before) = curve.rows.last() {
            check_order(before, &row, line_of(&record))?;
        }
        let is_last = last == Some(row.iteration);
        curve.rows.push(row);
        if is_last {
            break;
        }
    }
    Ok((curve, reader.position().byte()))
}

/// Names of the reward's terms, if the other columns are those of a curve.
fn reward_terms(columns: &StringRecord) -> Result<Vec<String>, CurveProblem> {
    let wrong = |at: usize, wanted: String| CurveProblem::Columns {
        number: at + 1,
        wanted,
        found: columns.get(at).unwrap_or_default().to_string(),
    };
    for (at, name) in COLUMNS.iter().enumerate() {
        if columns.get(at) != Some(name) {
            return Err(wrong(at, format!("`{name}`")));
        }
    }
    let rest = columns.iter().enumerate().skip(COLUMNS.len());
    rest.map(|(at, name)| {
        let term = name.strip_prefix(REWARD).map(String::from);
        term.ok_or_else(|| wrong(at, format!("`{REWARD}` and the name of a reward term")))
    })
    .collect()
}

fn check_order(before: &CurveRow, row: &CurveRow, line: u64) -> Result<(), CurveProblem> {
    if row.iteration != before.iteration + 1 {
        return Err(CurveProblem::Order { line, found: row.iteration, before: before.iteration });
    }
    if row.environment_steps <= before.environment_steps {
        let (found, before) = (row.environment_steps, before.environment_steps);
        return Err(CurveProblem::Steps { line, found, before });
    }
    Ok(())
}

#[cfg(test)]
mod tests;
