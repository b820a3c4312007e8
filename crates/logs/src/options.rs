//! The choices that turn a file into samples. Remedies name them by the keys of the table `log`.

use mishandle_results::{Key, Remedy};
use mishandle_stl::Interpolation;
use serde::{Deserialize, Serialize};

use crate::error::{Result, dense, resample, state_period, undecided};

/// The format of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Format {
    /// Comma-separated values, also with semicolons, tabs or spaces.
    Csv,
    /// One JSON object per line.
    #[serde(rename = "jsonl")]
    JsonLines,
    /// NumPy's `.npz` and `.npy`.
    Numpy,
    /// Parquet.
    Parquet,
}

/// A unit of numbers that are times.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Unit {
    /// Days, as in date cells of Excel and MATLAB.
    #[serde(rename = "d")]
    Days,
    /// Seconds.
    #[serde(rename = "s")]
    Seconds,
    /// Milliseconds.
    #[serde(rename = "ms")]
    Milliseconds,
    /// Microseconds.
    #[serde(rename = "us")]
    Microseconds,
    /// Nanoseconds.
    #[serde(rename = "ns")]
    Nanoseconds,
}

impl Unit {
    /// All units with their symbols.
    pub const ALL: [(&'static str, Unit); 5] = [
        ("s", Unit::Seconds),
        ("ms", Unit::Milliseconds),
        ("us", Unit::Microseconds),
        ("ns", Unit::Nanoseconds),
        ("d", Unit::Days),
    ];

    /// Returns the attoseconds (10⁻¹⁸ s) of one unit.
    pub(crate) fn attoseconds(self) -> i128 {
        match self {
            Unit::Days => 86_400 * 10_i128.pow(18),
            Unit::Seconds => 10_i128.pow(18),
            Unit::Milliseconds => 10_i128.pow(15),
            Unit::Microseconds => 10_i128.pow(12),
            Unit::Nanoseconds => 10_i128.pow(9),
        }
    }
}

/// How samples become those of a formula.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Sampling {
    /// They are evenly spaced, and each one counts. Otherwise that is an error.
    #[default]
    Even,
    /// They are resampled to a period.
    Resampled(Interpolation),
    /// Each signal is a function of time.
    Dense(Interpolation),
}

/// The treatment of cells without a finite number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Missing {
    /// It is an error.
    #[default]
    Error,
    /// The last value of the column stays.
    Hold,
    /// The row is left out; with resampling or in dense time, in this column only.
    Drop,
}

/// The treatment of rows that have the same time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Duplicates {
    /// They are an error.
    #[default]
    Error,
    /// The first one counts.
    First,
    /// The last one counts.
    Last,
}

/// All choices.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Options {
    /// The format; `None`: by the first bytes, then by the ending of the file's name.
    pub format: Option<Format>,
    /// The column with the times; `None`: `time`, if there is one.
    pub time: Option<String>,
    /// The unit of times that are numbers; `None`: seconds, and numbers or names that look
    /// otherwise are an error.
    pub time_unit: Option<Unit>,
    /// Seconds by which times without a zone are ahead of UTC; `None`: such times are an error.
    pub utc_offset: Option<i32>,
    /// The sampling period in seconds.
    pub period: Option<f64>,
    /// How samples become those of the formula.
    pub sampling: Sampling,
    /// The longest step between two samples in seconds, when resampling or in dense time; `None`:
    /// any.
    pub tolerance: Option<f64>,
    /// The treatment of cells without a finite number.
    pub missing: Missing,
    /// The treatment of rows of the same time.
    pub duplicates: Duplicates,
    /// Whether rows are sorted by time.
    pub sort: bool,
    /// The column that names the topic of each row.
    pub topic_column: Option<String>,
    /// The character between the cells of a CSV file; `None`: the one that fits the first lines.
    pub delimiter: Option<char>,
    /// Whether numbers have a decimal comma; `None`: as the numbers show, if the cells are not
    /// separated by commas.
    pub decimal_comma: Option<bool>,
}

impl Options {
    /// Checks the choices against each other.
    ///
    /// # Errors
    /// If one needs another one, or excludes it.
    pub fn check(&self) -> Result<()> {
        let is_resampled = matches!(self.sampling, Sampling::Resampled(_));
        if is_resampled && self.period.is_none() {
            return Err(undecided([state_period()], "resampling needs the new period"));
        }
        if matches!(self.sampling, Sampling::Dense(_)) && self.period.is_some() {
            return Err(undecided(
                [Remedy::Unset(Key::LOG_PERIOD), Remedy::Unset(Key::LOG_DENSE)],
                "dense time has no sampling period",
            ));
        }
        if self.tolerance.is_some() && self.sampling == Sampling::Even {
            return Err(undecided(
                [resample(), dense()],
                "the tolerance is the longest step that resampling or dense time bridges",
            ));
        }
        Ok(())
    }
}
