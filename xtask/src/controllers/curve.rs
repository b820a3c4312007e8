//! Learning curves: CSV files, a row for each iteration of a training.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, ensure};

/// Columns that are kept of every iteration, in this order: what the pictures and the training time are made of. A training
/// writes these and more.
pub const COLUMNS: [&str; 6] = [
    "environment_steps",
    "wall_clock_secs",
    "mean_return",
    "success_rate",
    "strict_success_rate",
    "validation_return",
];

/// An iteration of a training.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    pub environment_steps: u64,
    pub wall_clock_secs: f64,
    /// Mean return of the training's episodes that ended in it, if any did.
    pub mean_return: Option<f64>,
    /// What a validation found, if there was one.
    pub success_rate: Option<f64>,
    pub strict_success_rate: Option<f64>,
    pub validation_return: Option<f64>,
}

/// The iterations of a training, in order.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    pub rows: Vec<Row>,
}

impl Curve {
    /// Reads a curve.
    ///
    /// # Errors
    /// If it cannot be read, lacks a column, or has a cell that is no number.
    pub fn read(path: &Path) -> Result<Curve> {
        let read = || Curve::parse(&fs::read_to_string(path)?);
        read().with_context(|| path.display().to_string())
    }

    /// The curve that a CSV text holds; columns that are not known are passed over.
    ///
    /// # Errors
    /// If it lacks a column, or has a cell that is no number.
    pub fn parse(text: &str) -> Result<Curve> {
        let mut lines = text.lines();
        let names: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
        let place = |column: &&str| {
            let found = names.iter().position(|name| name == column);
            found.with_context(|| format!("it has no column `{column}`"))
        };
        let places = COLUMNS.iter().map(place).collect::<Result<Vec<_>>>()?;
        let row = |(number, line): (usize, &str)| {
            let cells: Vec<&str> = line.split(',').collect();
            ensure!(cells.len() == names.len(), "line {number} has {} cells", cells.len());
            let cell = |column: usize| match cells[places[column]] {
                "" => Ok(None),
                text => {
                    text.parse().map(Some).with_context(|| format!("line {number}: `{text}` is no number"))
                }
            };
            Ok(Row {
                environment_steps: cell(0)?.with_context(|| format!("line {number} has no steps"))? as u64,
                wall_clock_secs: cell(1)?.unwrap_or(f64::NAN),
                mean_return: cell(2)?,
                success_rate: cell(3)?,
                strict_success_rate: cell(4)?,
                validation_return: cell(5)?,
            })
        };
        Ok(Curve { rows: (2..).zip(lines).map(row).collect::<Result<_>>()? })
    }

    /// Seconds until a validation first had at least this success rate; `None` if none had.
    pub fn secs_to(&self, success_rate: f64) -> Option<f64> {
        let reached = |row: &&Row| row.success_rate.is_some_and(|rate| rate >= success_rate);
        self.rows.iter().find(reached).map(|row| row.wall_clock_secs)
    }

    /// The curve as a CSV text. Returns come back to the bit, so that the training time can be told of it.
    pub fn text(&self) -> String {
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

    const TEXT: &str = "iteration,environment_steps,wall_clock_secs,mean_return,kl,success_rate,\
                        strict_success_rate,validation_return\n\
                        1,512,0.5,,0.01,,,\n\
                        2,1024,1.25,-3.5,0.02,0.5,0.25,-2\n";

    #[test]
    fn columns_are_found_by_name_and_empty_cells_are_nothing() {
        let curve = Curve::parse(TEXT).unwrap();
        assert_eq!(curve.rows.len(), 2);
        assert_eq!((curve.rows[0].environment_steps, curve.rows[0].mean_return), (512, None));
        assert_eq!((curve.rows[1].success_rate, curve.rows[1].validation_return), (Some(0.5), Some(-2.0)));
        // What is kept is a curve too, and the same one.
        assert_eq!(Curve::parse(&curve.text().replace("1.2,", "1.25,")).unwrap(), curve);
        assert_eq!([0.5, 0.6].map(|rate| curve.secs_to(rate)), [Some(1.25), None]);
    }

    #[test]
    fn what_is_no_curve_is_refused() {
        for (text, told) in [
            ("", "it has no column `environment_steps`"),
            (&TEXT.replace("0.25,-2", "0.25"), "line 3 has 7 cells"),
            (&TEXT.replace("-3.5", "low"), "line 3: `low` is no number"),
        ] {
            let error = format!("{:#}", Curve::parse(text).unwrap_err());
            assert!(error.contains(told), "{error}");
        }
    }
}
