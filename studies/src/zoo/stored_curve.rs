//! The learning curves in `controllers/curves`: the columns of a training run's curve that charts
//! need.

use std::path::Path;

use mishandle::train::{Curve, CurveRow};
use serde::Deserialize;

use crate::zoo::folder::read;
use crate::zoo::{CurveFileProblem, ZooError};

/// The columns of the CSV file: the fields of [`StoredCurveRow`].
const COLUMNS: [&str; 6] = [
    "environment_steps",
    "wall_clock_secs",
    "mean_return",
    "success_rate",
    "strict_success_rate",
    "validation_return",
];

/// One iteration of a training run.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
pub struct StoredCurveRow {
    /// Control steps of all environments together so far.
    pub environment_steps: u64,
    /// Wall-clock time so far, s; the file has one decimal.
    pub wall_clock_secs: f64,
    /// Mean return of the training episodes that ended in this iteration.
    pub mean_return: Option<f64>,
    /// Success rate on the validation episodes, if this iteration had a validation.
    pub success_rate: Option<f64>,
    /// Strict success rate on the validation episodes.
    pub strict_success_rate: Option<f64>,
    /// Mean return of the validation episodes.
    pub validation_return: Option<f64>,
}

impl From<&CurveRow> for StoredCurveRow {
    fn from(row: &CurveRow) -> StoredCurveRow {
        let validation = row.validation;
        StoredCurveRow {
            environment_steps: row.environment_steps,
            wall_clock_secs: row.wall_clock_secs,
            mean_return: row.mean_return,
            success_rate: validation.map(|found| found.success_rate),
            strict_success_rate: validation.map(|found| found.strict_success_rate),
            validation_return: validation.map(|found| found.mean_return),
        }
    }
}

/// A learning curve as the repository keeps it: one row per iteration.
#[derive(Clone, Debug, PartialEq)]
pub struct StoredCurve {
    /// The rows, in order.
    pub rows: Vec<StoredCurveRow>,
}

impl From<&Curve> for StoredCurve {
    fn from(curve: &Curve) -> StoredCurve {
        StoredCurve { rows: curve.rows.iter().map(StoredCurveRow::from).collect() }
    }
}

impl StoredCurve {
    /// Reads a kept curve.
    ///
    /// # Errors
    /// If the file cannot be read, lacks a column, or has a cell that is not a number.
    pub fn load(path: &Path) -> Result<StoredCurve, ZooError> {
        let bytes = read(path)?;
        StoredCurve::parse(&bytes).map_err(|problem| ZooError::Curve { path: path.to_path_buf(), problem })
    }

    fn parse(bytes: &[u8]) -> Result<StoredCurve, CurveFileProblem> {
        let rows: Vec<StoredCurveRow> =
            csv::Reader::from_reader(bytes).into_deserialize().collect::<Result<_, _>>()?;
        if rows.is_empty() {
            return Err(CurveFileProblem::Empty);
        }
        Ok(StoredCurve { rows })
    }

    /// Returns the wall-clock time of the first validation with at least this success rate, s.
    pub fn secs_to(&self, success_rate: f64) -> Option<f64> {
        let reached = |row: &&StoredCurveRow| row.success_rate.is_some_and(|rate| rate >= success_rate);
        self.rows.iter().find(reached).map(|row| row.wall_clock_secs)
    }

    /// Returns the curve as CSV. Rates and returns keep all their bits.
    pub fn csv(&self) -> String {
        let mut text = COLUMNS.join(",") + "\n";
        for row in &self.rows {
            let cell = |value: Option<f64>| value.map_or(String::new(), |value| value.to_string());
            let cells = [row.mean_return, row.success_rate, row.strict_success_rate, row.validation_return];
            let cells = cells.map(cell).join(",");
            text += &format!("{},{:.1},{cells}\n", row.environment_steps, row.wall_clock_secs);
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "environment_steps,wall_clock_secs,mean_return,success_rate,strict_success_rate,validation_return\n\
                        512,0.5,,,,\n\
                        1024,1.2,-3.5,0.5,0.25,-2\n";

    #[test]
    fn empty_cells_are_missing_values_and_the_bytes_come_back() {
        let curve = StoredCurve::parse(TEXT.as_bytes()).unwrap();
        assert_eq!((curve.rows[0].environment_steps, curve.rows[0].mean_return), (512, None));
        assert_eq!((curve.rows[1].success_rate, curve.rows[1].validation_return), (Some(0.5), Some(-2.0)));
        assert_eq!([0.5, 0.6].map(|rate| curve.secs_to(rate)), [Some(1.2), None]);
        assert_eq!(curve.csv(), TEXT);
    }

    #[test]
    fn a_file_without_the_columns_or_with_text_in_a_cell_is_an_error() {
        for (text, expected) in [
            ("a,b\n1,2\n", "missing field `environment_steps`"),
            ("a,b\n", "the learning curve has no rows"),
            ("", "the learning curve has no rows"),
            (&TEXT.replace("0.25,-2", "0.25"), "found record with 5 fields"),
            (&TEXT.replace("-3.5", "low"), "field 2"),
        ] {
            let error = StoredCurve::parse(text.as_bytes()).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
