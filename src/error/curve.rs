//! Errors of the CSV file of a learning curve.

/// Problem with the CSV file of a curve.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CurveProblem {
    /// A column has the wrong name.
    #[error("column {number} of the header is `{found}`, expected {expected}, as a training writes it")]
    Columns {
        /// Column, counted from 1.
        number: usize,
        /// Expected name.
        expected: String,
        /// Name found; empty if the column is missing.
        found: String,
    },
    /// The cells are separated by another character than a comma.
    #[error("the header is separated by {separator}; expected commas, and points in numbers")]
    Separator {
        /// The character that separates the names, in words.
        separator: &'static str,
    },
    /// A line is not UTF-8 text.
    #[error("line {line} is not UTF-8 text; save the file as UTF-8")]
    NotUtf8 {
        /// Line, counted from 1.
        line: u64,
    },
    /// A line has too few or too many cells.
    #[error(
        "line {line}: the number of cells is {found}; it must be {expected}, one for each name in the header"
    )]
    Cells {
        /// Line, counted from 1.
        line: u64,
        /// Number of cells.
        found: usize,
        /// Number of names in the header.
        expected: usize,
    },
    /// A cell has the wrong type.
    #[error("line {line}: {column} is `{found}`, expected {expected}")]
    Cell {
        /// Line, counted from 1.
        line: u64,
        /// Name of the column.
        column: String,
        /// Content of the cell.
        found: String,
        /// Expected content.
        expected: &'static str,
    },
    /// Iterations are not consecutive.
    #[error("line {line}: iteration {found} cannot follow iteration {before}")]
    Order {
        /// Line, counted from 1.
        line: u64,
        /// The iteration of this line.
        found: u64,
        /// The iteration of the line before.
        before: u64,
    },
    /// Environment steps do not increase.
    #[error("line {line}: {found} environment steps cannot follow {before}")]
    Steps {
        /// Line, counted from 1.
        line: u64,
        /// Environment steps of this line.
        found: u64,
        /// Environment steps of the line before.
        before: u64,
    },
    /// The curve is that of a training run on other scenarios.
    #[error(
        "it {} columns of validations on scenarios, unlike this training",
        if *found { "has" } else { "lacks" }
    )]
    Scenarios {
        /// Whether the file has these columns.
        found: bool,
    },
    /// The curve is that of a training run with or without a curriculum.
    #[error(
        "it {} columns of a curriculum, unlike this training",
        if *found { "has" } else { "lacks" }
    )]
    Curriculum {
        /// Whether the file has these columns.
        found: bool,
    },
    /// The curve has other reward terms.
    #[error("its reward terms are {}, those of this training are {}", listed(found), listed(expected))]
    RewardTerms {
        /// Reward terms of the training run.
        expected: Vec<String>,
        /// Reward terms of the file.
        found: Vec<String>,
    },
    /// The curve ends before the checkpoint.
    #[error("it has no row for iteration {iteration} of the checkpoint, which the remaining rows follow")]
    MissingRow {
        /// Iteration of the checkpoint.
        iteration: u64,
    },
    /// The curve belongs to another training run.
    #[error(
        "it belongs to another training: the wall-clock time of iteration {iteration} is {found} s, in the checkpoint {expected} s"
    )]
    OtherTraining {
        /// Iteration of the checkpoint.
        iteration: u64,
        /// Wall-clock time of the checkpoint, s.
        expected: String,
        /// Wall-clock time of the row, s.
        found: String,
    },
    /// The file cannot be read as CSV.
    #[error(transparent)]
    Csv(#[from] csv::Error),
}

fn listed(names: &[String]) -> String {
    if names.is_empty() { "none".to_string() } else { names.join(", ") }
}
