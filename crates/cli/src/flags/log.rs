//! Flags that say how a log is read.

use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Result, bail, ensure};
use clap::{Args, ValueEnum};
use mishandle_logs::{
    Duplicates, Following, Format, Interpolation, Missing, Options, Sampling, Source, Unit, utc_offset,
};

use super::numbers;

/// Sampling periods.
const PERIOD: &str = "a number of seconds above 0, such as 0.1";

/// Times without growth.
const IDLE: &str = "a number of seconds from 0 to 1e9, such as 5";

fn is_idle(secs: f64) -> bool {
    (0.0..=1e9).contains(&secs)
}

fn is_period(secs: f64) -> bool {
    secs > 0.0 && secs.is_finite()
}

/// The choices that turn files into samples.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Reading the log")]
pub struct LogFlags {
    /// File of a topic, whose columns are then named `NAME/column`; repeat the flag for several
    /// files of one log
    #[arg(long, value_name = "NAME=FILE", value_parser = topic)]
    pub topic: Vec<(String, PathBuf)>,
    /// Column that names the topic of each row; signals are then named `topic/column`
    #[arg(long, value_name = "COLUMN")]
    pub topic_column: Option<String>,
    /// Format [default: by the first bytes, then by the ending of the name]
    #[arg(long, value_name = "FORMAT")]
    pub format: Option<FormatFlag>,
    /// Column with the times of the samples [default: `time`, if there is one]
    #[arg(long, value_name = "COLUMN")]
    pub time: Option<String>,
    /// Unit of times that are numbers [default: seconds; numbers that look otherwise are an error]
    #[arg(long, value_name = "UNIT")]
    pub time_unit: Option<UnitFlag>,
    /// Offset from UTC of dates without a zone, such as Z or +02:00
    #[arg(long, value_name = "OFFSET", allow_hyphen_values = true, value_parser = offset)]
    pub utc_offset: Option<i32>,
    /// Sampling period in seconds [default: that of the times; bounds in seconds need one of both]
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, value_parser = numbers::number(PERIOD, is_period))]
    pub period: Option<f64>,
    /// Resample to --period: the last value holds, or a line between two samples
    #[arg(long, value_name = "INTERPOLATION", conflicts_with = "dense")]
    pub resample: Option<InterpolationFlag>,
    /// Read each signal as a function of time: the last value holds, or a line between two samples
    #[arg(long, value_name = "INTERPOLATION")]
    pub dense: Option<InterpolationFlag>,
    /// Longest step in seconds that --resample or --dense bridges [default: any]
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, value_parser = numbers::number(PERIOD, is_period))]
    pub tolerance: Option<f64>,
    /// Cells without a finite number: an error, the last value, or left out
    #[arg(long, value_name = "CHOICE", default_value = "error")]
    pub missing: MissingFlag,
    /// Rows with the same time: an error, the first, or the last one counts
    #[arg(long, value_name = "CHOICE", default_value = "error")]
    pub duplicates: DuplicatesFlag,
    /// Sort the rows by time
    #[arg(long)]
    pub sort: bool,
    /// Character between the cells of a CSV file [default: the one that fits the first lines]
    #[arg(long, value_name = "CHARACTER", value_parser = delimiter)]
    pub delimiter: Option<char>,
    /// Decimal point or comma of a CSV file [default: as its numbers show]
    #[arg(long, value_name = "CHOICE")]
    pub decimal: Option<DecimalFlag>,
}

/// The choices for a log that is still written.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Following a log")]
pub struct FollowFlags {
    /// Print the bounds of the robustness whenever they change, not only the verdict
    #[arg(long, requires = "follow")]
    pub bounds: bool,
    /// Go on after a violation until every formula has a verdict
    #[arg(long, requires = "follow")]
    pub keep_going: bool,
    /// Seconds of the log by which a row can come too late [default: samples wait for all topics]
    #[arg(long, requires = "follow", value_name = "SECONDS", allow_negative_numbers = true, value_parser = numbers::number(PERIOD, is_period))]
    pub lateness: Option<f64>,
    /// Seconds without growth after which a file is complete [default: it never is]
    #[arg(long, requires = "follow", value_name = "SECONDS", allow_negative_numbers = true, value_parser = numbers::number(IDLE, is_idle))]
    pub idle: Option<f64>,
}

impl FollowFlags {
    /// Returns the choices.
    pub fn following(&self) -> Following {
        Following { lateness: self.lateness, idle: self.idle.map(Duration::from_secs_f64) }
    }
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum FormatFlag {
    Csv,
    Jsonl,
    Numpy,
    Parquet,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum UnitFlag {
    S,
    Ms,
    Us,
    Ns,
    D,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum InterpolationFlag {
    Hold,
    Linear,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum MissingFlag {
    Error,
    Hold,
    Drop,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum DuplicatesFlag {
    Error,
    First,
    Last,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum DecimalFlag {
    Point,
    Comma,
}

impl LogFlags {
    /// Returns the choices.
    pub fn options(&self) -> Options {
        let interpolation = |flag| match flag {
            InterpolationFlag::Hold => Interpolation::Hold,
            InterpolationFlag::Linear => Interpolation::Linear,
        };
        Options {
            format: self.format.map(|format| match format {
                FormatFlag::Csv => Format::Csv,
                FormatFlag::Jsonl => Format::JsonLines,
                FormatFlag::Numpy => Format::Numpy,
                FormatFlag::Parquet => Format::Parquet,
            }),
            time: self.time.clone(),
            time_unit: self.time_unit.map(|unit| match unit {
                UnitFlag::S => Unit::Seconds,
                UnitFlag::Ms => Unit::Milliseconds,
                UnitFlag::Us => Unit::Microseconds,
                UnitFlag::Ns => Unit::Nanoseconds,
                UnitFlag::D => Unit::Days,
            }),
            utc_offset: self.utc_offset,
            period: self.period,
            sampling: match (self.resample, self.dense) {
                (Some(flag), _) => Sampling::Resampled(interpolation(flag)),
                (None, Some(flag)) => Sampling::Dense(interpolation(flag)),
                (None, None) => Sampling::Even,
            },
            tolerance: self.tolerance,
            missing: match self.missing {
                MissingFlag::Error => Missing::Error,
                MissingFlag::Hold => Missing::Hold,
                MissingFlag::Drop => Missing::Drop,
            },
            duplicates: match self.duplicates {
                DuplicatesFlag::Error => Duplicates::Error,
                DuplicatesFlag::First => Duplicates::First,
                DuplicatesFlag::Last => Duplicates::Last,
            },
            sort: self.sort,
            topic_column: self.topic_column.clone(),
            delimiter: self.delimiter,
            decimal_comma: self.decimal.map(|decimal| decimal == DecimalFlag::Comma),
        }
    }

    /// Returns the files of each log: one for each path, or all topics together.
    pub fn logs(&self, paths: &[PathBuf]) -> Result<Vec<Vec<Source>>> {
        if !self.topic.is_empty() {
            ensure!(paths.is_empty(), "--topic names the files of one log; leave out {}", paths[0].display());
            let source =
                |(name, path): &(String, PathBuf)| Source { topic: Some(name.clone()), path: path.clone() };
            return Ok(vec![self.topic.iter().map(source).collect()]);
        }
        if paths.is_empty() {
            bail!("there is no log: name a file, or several topics with --topic NAME=FILE");
        }
        Ok(paths.iter().map(|path| vec![Source { topic: None, path: path.clone() }]).collect())
    }
}

fn topic(text: &str) -> std::result::Result<(String, PathBuf), String> {
    match text.split_once('=') {
        Some((name, path)) if !name.is_empty() && !path.is_empty() => Ok((name.to_string(), path.into())),
        _ => Err("expected a name and a file, such as gripper=gripper.csv".to_string()),
    }
}

fn offset(text: &str) -> std::result::Result<i32, String> {
    utc_offset(text).ok_or_else(|| "expected Z or an offset such as +02:00".to_string())
}

fn delimiter(text: &str) -> std::result::Result<char, String> {
    let mut characters = text.chars();
    match (text, characters.next(), characters.next()) {
        ("\\t" | "tab", ..) => Ok('\t'),
        (_, Some(character), None) if character.is_ascii() && !"\"\n\r".contains(character) => Ok(character),
        _ => Err("expected one character, such as ';' or tab".to_string()),
    }
}
