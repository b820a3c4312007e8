//! Settings of questions about logs and formulas.

use std::collections::BTreeMap;

use mishandle_logs::{Duplicates, Format, Interpolation, Missing, Options, Sampling, Unit, utc_offset};
use mishandle_stl::TimeUnit;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize};

use super::declare::plan_table;
use super::keys::{self, Seconds, Within, wrong};
use crate::error::MishandleError;

const COLUMN: &str = "a string: the name of a column";
const HOW: &str = "\"hold\" or \"linear\"";
const SECONDS: &str = "a number of seconds above 0, such as 0.1";
const EXCLUDED: &str = "left out, because log.resample is set";

/// The mark before the fraction of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DecimalMark {
    /// `0.5`.
    Point,
    /// `0,5`.
    Comma,
}

plan_table! {
    /// How a log is read: the table `[log]`.
    pub struct LogSettings in "log" {
        /// Files of the topics of one log, by name. Their columns are named `NAME/column`.
        #[serde(skip_serializing_if = "BTreeMap::is_empty")]
        pub topics: BTreeMap<String, String> = BTreeMap::new(), "a table of files by topic, as [log.topics]";
        /// Column that names the topic of each row. Signals are then named `topic/column`.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub topic_column: Option<String> = None, COLUMN;
        /// Format; without it, by the first bytes, then by the ending of the name.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub format: Option<Format> = None, "\"csv\", \"jsonl\", \"numpy\" or \"parquet\"";
        /// Column with the times of the samples; without it, `time`, if there is one.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub time: Option<String> = None, COLUMN;
        /// Unit of times that are numbers; without it, seconds, and numbers that look otherwise are
        /// an error.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub time_unit: Option<Unit> = None, "\"s\", \"ms\", \"us\", \"ns\" or \"d\"";
        /// Offset from UTC of dates without a zone.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub utc_offset: Option<String> = None, "\"Z\", or an offset such as \"+02:00\"";
        /// Sampling period in seconds; without it, that of the times. Bounds in seconds need one of
        /// both.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub period: Option<f64> = None, SECONDS => Seconds;
        /// Resample to the period: the last value holds, or a line between two samples.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub resample: Option<Interpolation> = None, HOW;
        /// Read each signal as a function of time: the last value holds, or a line between two
        /// samples.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub dense: Option<Interpolation> = None, HOW;
        /// Longest step in seconds that resampling or dense time bridges; without it, any.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub tolerance: Option<f64> = None, SECONDS => Seconds;
        /// Cells without a finite number: an error, the last value, or left out.
        pub missing: Missing = Missing::Error, "\"error\", \"hold\" or \"drop\"";
        /// Rows with the same time: an error, the first, or the last one counts.
        pub duplicates: Duplicates = Duplicates::Error, "\"error\", \"first\" or \"last\"";
        /// Sort the rows by time.
        pub sort: bool = false, keys::BOOLEAN;
        /// Character between the cells of a CSV file; without it, the one that fits the first
        /// lines.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub delimiter: Option<String> = None, "\"tab\", or one character, such as \";\"";
        /// Decimal point or comma of a CSV file; without it, as its numbers show.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub decimal: Option<DecimalMark> = None, "\"point\" or \"comma\"";
        /// Unit of interval bounds without a unit; without it, such bounds count samples.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub unit: Option<TimeUnit> = None, "\"s\", \"ms\", \"us\" or \"ns\"";
        /// Use only windows inside the trace, instead of cutting them at its end as RTAMT does.
        pub strict_horizon: bool = false, keys::BOOLEAN;
    }
}

plan_table! {
    /// Contents of verdicts on logs, and how a log that is still written is followed: the table
    /// `[monitor]`.
    pub struct MonitorSettings in "monitor" {
        /// Add the robustness at each sample to the JSON document.
        pub values: bool = false, keys::BOOLEAN;
        /// Print the bounds of the robustness whenever they change, not only the verdict.
        pub bounds: bool = false, keys::BOOLEAN;
        /// Go on after a violation until every formula has a verdict.
        pub keep_going: bool = false, keys::BOOLEAN;
        /// Seconds of the log by which a row can come too late; without it, samples wait for all
        /// topics.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub lateness: Option<f64> = None, SECONDS => Seconds;
        /// Seconds without growth after which a file is complete; without it, it never is.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub idle: Option<f64> = None, "a number of seconds from 0 to 1000000000, such as 5" => Idle;
    }
}

plan_table! {
    /// How a formula is explained, and how its parameters are mined: the table `[formula]`.
    pub struct FormulaSettings in "formula" {
        /// Duration of an episode in seconds, with which the windows are compared.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub episode: Option<f64> = None, SECONDS => Seconds;
        /// Steps of the values of parameters, by name; without one, exact, or for a bound the
        /// sampling period.
        #[serde(skip_serializing_if = "BTreeMap::is_empty")]
        pub resolution: BTreeMap<String, f64> = BTreeMap::new(),
            "a table of steps by parameter, as [formula.resolution]";
        /// Share of the logs that must satisfy a formula with mined parameters.
        pub share: f64 = 1.0, "a number in (0, 1], such as 0.95" => PositiveShare;
        /// Number of points of the Pareto front of several parameters.
        pub points: u32 = 10, "an integer from 2 to 200" => Within<2, 200>;
        /// Largest number of random simulations of each run file, evenly chosen.
        pub simulations: u64 = 200, "an integer from 1 to 1000000000" => Within<1, 1_000_000_000>;
    }
}

/// The type of a wait, seconds.
struct Idle;

impl<'de> Deserialize<'de> for Idle {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let secs = f64::deserialize(deserializer)?;
        if (0.0..=1e9).contains(&secs) { Ok(Idle) } else { Err(D::Error::custom("out of range")) }
    }
}

/// The type of a share above 0.
struct PositiveShare;

impl<'de> Deserialize<'de> for PositiveShare {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let share = f64::deserialize(deserializer)?;
        if share > 0.0 && share <= 1.0 { Ok(PositiveShare) } else { Err(D::Error::custom("out of range")) }
    }
}

impl LogSettings {
    /// Returns the choices that turn files into samples.
    ///
    /// # Errors
    /// If the offset or the delimiter does not parse, or two choices exclude each other.
    pub fn options(&self) -> Result<Options, MishandleError> {
        let sampling = match (self.resample, self.dense) {
            (Some(_), Some(_)) => {
                let found = "set".to_string();
                let expected = EXCLUDED.to_string();
                return Err(MishandleError::KeyValue {
                    line: None,
                    key: "log.dense".to_string(),
                    found,
                    expected,
                });
            }
            (Some(interpolation), None) => Sampling::Resampled(interpolation),
            (None, Some(interpolation)) => Sampling::Dense(interpolation),
            (None, None) => Sampling::Even,
        };
        let offset = |text: &String| utc_offset(text).ok_or_else(|| wrong("log.utc-offset", text));
        let delimiter = |text: &String| delimiter(text).ok_or_else(|| wrong("log.delimiter", text));
        Ok(Options {
            format: self.format,
            time: self.time.clone(),
            time_unit: self.time_unit,
            utc_offset: self.utc_offset.as_ref().map(offset).transpose()?,
            period: self.period,
            sampling,
            tolerance: self.tolerance,
            missing: self.missing,
            duplicates: self.duplicates,
            sort: self.sort,
            topic_column: self.topic_column.clone(),
            delimiter: self.delimiter.as_ref().map(delimiter).transpose()?,
            decimal_comma: self.decimal.map(|mark| mark == DecimalMark::Comma),
        })
    }
}

fn delimiter(text: &str) -> Option<char> {
    match *text.chars().collect::<Vec<_>>() {
        _ if text == "tab" || text == "\\t" => Some('\t'),
        [character] if character.is_ascii() && !"\"\n\r".contains(character) => Some(character),
        _ => None,
    }
}
