//! Learning curves: CSV files, a row for each iteration of a training.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, ensure};

/// Columns that are kept, in this order; a training writes these and more.
pub const COLUMNS: [&str; 6] = [
    "environment_steps",
    "wall_clock_secs",
    "mean_return",
    "success_rate",
    "strict_success_rate",
    "validation_return",
];

/// Most rows of a curve that is kept, but for validations: below 20 kB.
const MOST_ROWS: usize = 300;

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

    /// The curve with fewer rows: every so many, all validations, and the last.
    pub fn thinned(&self) -> Curve {
        let every = self.rows.len().div_ceil(MOST_ROWS).max(1);
        let kept = |(i, row): (usize, &Row)| {
            let is_kept = row.success_rate.is_some() || (i + 1) % every == 0 || i + 1 == self.rows.len();
            is_kept.then_some(*row)
        };
        Curve { rows: self.rows.iter().enumerate().filter_map(kept).collect() }
    }

    /// The curve as a CSV text.
    pub fn text(&self) -> String {
        let mut text = COLUMNS.join(",") + "\n";
        for row in &self.rows {
            let cell = |value: Option<f64>, decimals: usize| {
                value.map_or(String::new(), |value| format!("{value:.decimals$}"))
            };
            text += &format!(
                "{},{:.1},{},{},{},{}\n",
                row.environment_steps,
                row.wall_clock_secs,
                cell(row.mean_return, 3),
                cell(row.success_rate, 4),
                cell(row.strict_success_rate, 4),
                cell(row.validation_return, 3),
            );
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

    #[test]
    fn a_thinned_curve_keeps_validations_and_the_end_in_few_bytes() {
        let row = |i: u64| Row {
            environment_steps: i * 32_768,
            wall_clock_secs: i as f64 * 1.37,
            mean_return: Some(-123.456_789),
            success_rate: i.is_multiple_of(20).then_some(0.5),
            strict_success_rate: i.is_multiple_of(20).then_some(0.25),
            validation_return: i.is_multiple_of(20).then_some(1.0),
        };
        let curve = Curve { rows: (1..=2003).map(row).collect() };
        let thinned = curve.thinned();
        assert_eq!(thinned.rows.iter().filter(|row| row.success_rate.is_some()).count(), 100);
        assert_eq!(thinned.rows.last(), curve.rows.last());
        assert!(thinned.text().len() < 20_000, "{}", thinned.text().len());
        let short = Curve { rows: curve.rows[..200].to_vec() };
        assert_eq!(short.thinned(), short);
    }
}
