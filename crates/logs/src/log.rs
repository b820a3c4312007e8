//! Logs: files whose columns are known, and the topics that are read from them.

mod whole;

use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use mishandle_results::{Choice, Key, Remedy};
use mishandle_stl::{Formula, nearest};
use mishandle_text::visible;

use crate::cell::{Sink, Sinks, TimeColumn, TopicColumn, ValueColumn};
use crate::csv::CsvTable;
use crate::error::{LogError, Result, content, state_period, undecided};
use crate::format;
use crate::json_lines::{HEAD_LINES, JsonHead, JsonTable};
use crate::numpy::NumpyTable;
use crate::options::{Format, Missing, Options, Unit};
use crate::place::Places;
use crate::samples::restarts;
use crate::stamp::{self, NanosecondColumn, TimeColumns};
use crate::table::Table;
use crate::times::Times;

/// Column with the time of each sample in seconds, if no other is named.
const TIME: &str = "time";

/// Words in the names of columns with times, in the logs of other programs.
const TIME_WORDS: [&str; 8] = ["t", "ts", "sec", "secs", "second", "seconds", "elapsed", "clock"];

/// A file of a log.
#[derive(Clone, Debug, PartialEq)]
pub struct Source {
    /// The topic of its columns, which are then named `topic/column`.
    pub topic: Option<String>,
    /// The path; `-` is stdin.
    pub path: PathBuf,
}

/// A log whose columns are known and whose rows were not read yet.
pub struct OpenLog {
    tables: Vec<(Option<String>, Box<dyn Table>)>,
    names: Vec<String>,
    options: Options,
}

/// The rows of a log: topics with columns.
#[derive(Clone, Debug)]
pub struct Log {
    /// The topics.
    pub topics: Vec<Topic>,
    /// The column that seems to have the times, if none was read as such.
    pub likely_time: Option<String>,
}

/// Signals that have the same times.
#[derive(Clone, Debug)]
pub struct Topic {
    /// The name, if the log has several topics.
    pub name: Option<String>,
    /// The time of each row, if the file has them.
    pub times: Option<Times>,
    /// The signals.
    pub columns: Vec<Column>,
    pub(crate) places: Places,
}

/// A signal.
#[derive(Clone, Debug)]
pub struct Column {
    /// The name, as a formula reads it: `topic/column` if the log has several topics.
    pub name: String,
    /// The value in each row; NaN where it is missing.
    pub values: Vec<f64>,
}

impl Topic {
    /// Creates a topic; all columns and the times must have the same length.
    pub fn new(name: Option<String>, times: Option<Times>, columns: Vec<Column>) -> Topic {
        let rows = columns.first().map_or_else(
            || times.as_ref().map_or(0, |times| times.secs().len()),
            |column| column.values.len(),
        );
        Topic { name, times, columns, places: Places::rows(rows) }
    }
}

impl OpenLog {
    /// Opens the files of a log and reads the names of their columns.
    ///
    /// # Errors
    /// If a file is not what its format requires, or the choices exclude each other.
    pub fn open(sources: &[Source], options: &Options) -> Result<OpenLog> {
        options.check()?;
        let mut tables = Vec::new();
        let mut names = Vec::new();
        for Source { topic, path } in sources {
            let plain = |input: Input| match input {
                Input::Stdin => Box::new(io::stdin()) as Box<dyn Read>,
                Input::File(file) => Box::new(file),
            };
            let head = JsonHead { lines: HEAD_LINES, more: &[] };
            let table = open_table(path, options, &head, plain).map_err(|error| match error {
                // Several files need their names.
                LogError::Content(message) if sources.len() > 1 => {
                    content(format!("{}: {message}", path.display()))
                }
                error => error,
            })?;
            names.extend(table.names().iter().map(|name| full_name(topic.as_deref(), name)));
            tables.push((topic.clone(), table));
        }
        Ok(OpenLog { tables, names, options: options.clone() })
    }

    /// Opens a file whose rows are handed out as they come.
    pub(crate) fn open_live(
        source: &Source,
        options: &Options,
        head: &JsonHead<'_>,
        wrapped: impl FnOnce(Input) -> Box<dyn Read>,
    ) -> Result<OpenLog> {
        let table = open_table(&source.path, options, head, wrapped)?;
        let topic = source.topic.clone();
        let names = table.names().iter().map(|name| full_name(topic.as_deref(), name)).collect();
        Ok(OpenLog { tables: vec![(topic, table)], names, options: options.clone() })
    }

    /// Opens a log in CSV from memory or a pipe.
    ///
    /// # Errors
    /// As for [`OpenLog::open`].
    pub fn open_csv(source: Box<dyn Read>, options: &Options) -> Result<OpenLog> {
        options.check()?;
        let table: Box<dyn Table> = Box::new(CsvTable::open(source, options)?);
        let names = table.names().to_vec();
        Ok(OpenLog { tables: vec![(None, table)], names, options: options.clone() })
    }

    /// Returns the names of all columns, as a formula reads them. With a column that names the
    /// topics, they are without the topics, which are known after reading.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Returns the name of a column that seems to have the times, if none is named `time`.
    pub fn likely_time(&self) -> Option<&str> {
        let names = self.tables.iter().flat_map(|(_, table)| table.names());
        names.map(String::as_str).find(|name| is_likely_time(name))
    }

    /// Checks that the log has the signals of the formula, each of them once.
    ///
    /// # Errors
    /// If it lacks one, or has it twice.
    pub fn check_signals(&self, formula: &Formula) -> Result<()> {
        if self.options.topic_column.is_some() {
            return Ok(());
        }
        for signal in formula.signals() {
            if self.place_of(signal)?.is_some() {
                continue;
            }
            self.check_read(signal)?;
            if let Some(column) = self.foreign() {
                return Err(not_utf8(signal, column));
            }
        }
        // Errors about signals and definitions, with the names of all columns.
        Ok(formula.check_names(&self.names)?)
    }

    /// Checks that a signal is not a column that is there and not read. The elements of an array
    /// that is not read have no names.
    fn check_read(&self, signal: &str) -> Result<()> {
        for (topic, table) in &self.tables {
            let is_signal = |name: &str| {
                let name = full_name(topic.as_deref(), name);
                let rest = signal.strip_prefix(name.as_str());
                rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('['))
            };
            if let Some((name, reason)) = table.not_read().iter().find(|(name, _)| is_signal(name)) {
                return Err(content(format!("the column `{}` is not read: {reason}", visible(name))));
            }
        }
        Ok(())
    }

    /// Returns the first column whose name is not UTF-8.
    pub(crate) fn foreign(&self) -> Option<usize> {
        self.tables.iter().find_map(|(_, table)| table.foreign())
    }

    /// Returns the table and the column of a signal.
    pub(crate) fn place_of(&self, signal: &str) -> Result<Option<(usize, usize)>> {
        let mut found = None;
        for (index, (topic, table)) in self.tables.iter().enumerate() {
            let name = match topic {
                Some(topic) => signal.strip_prefix(topic.as_str()).and_then(|rest| rest.strip_prefix('/')),
                None => Some(signal),
            };
            let Some(column) = name.map(|name| column(table.as_ref(), name)).transpose()?.flatten() else {
                continue;
            };
            if found.replace((index, column)).is_some() {
                return Err(content(format!("two files have the signal `{}`", visible(signal))));
            }
        }
        Ok(found)
    }

    /// Returns the columns with the times of a table, if there are some.
    fn time_columns(&self, table: &dyn Table) -> Result<Option<TimeColumns>> {
        let name = self.options.time.as_deref().map_or(TIME, str::trim);
        if let Some(both) = stamp::columns(table.names(), name) {
            if self.options.time_unit.is_some_and(|unit| unit != Unit::Seconds) {
                return Err(undecided(
                    [Remedy::Unset(Key::LOG_TIME_UNIT)],
                    format!("the times `{}` are seconds and nanoseconds in two columns", visible(name)),
                ));
            }
            return Ok(Some(both));
        }
        let one = match &self.options.time {
            Some(name) => Some(named_column(table, name, "time")?),
            None => column(table, TIME)?.or(table.known_time().map(|(column, _)| column)),
        };
        Ok(one.map(|times| TimeColumns { times, rest: None }))
    }

    /// Adds the columns with the times, if there are some, to those that are read.
    fn add_times(&self, table: &dyn Table, found: Option<TimeColumns>, sinks: &mut Sinks) {
        let Some(TimeColumns { times, rest }) = found else { return };
        let counted = table.counted();
        let known = table.known_time().filter(|(known, _)| *known == times).map(|(_, unit)| unit);
        let unit = known.or(rest.map(|_| Unit::Seconds));
        let name = &table.names()[times];
        sinks.columns.push((times, Sink::Times(TimeColumn::new(name, unit, &self.options, counted))));
        if let Some((column, unit)) = rest {
            let drops = self.options.missing == Missing::Drop;
            let rest = NanosecondColumn::new(&table.names()[column], unit, drops, counted);
            sinks.columns.push((column, Sink::Nanoseconds(rest)));
        }
    }

    /// Reads these signals, which the log must have, and the times. Other columns may hold
    /// anything.
    ///
    /// # Errors
    /// If a row has no number or time where one must be, or the file is not what its format
    /// requires.
    pub fn read(mut self, signals: &[&str]) -> Result<Log> {
        if let Some(name) = self.options.topic_column.clone() {
            return self.read_split(Some(signals), &name);
        }
        let likely_time = self.likely_time().map(str::to_owned);
        let mut columns: Vec<Vec<(usize, &str)>> = self.tables.iter().map(|_| Vec::new()).collect();
        for signal in signals {
            let Some((table, column)) = self.place_of(signal)? else {
                return Err(content(format!("no column is named `{}`", visible(signal))));
            };
            columns[table].push((column, signal));
        }
        // Without signals, the rows of the first file count.
        let is_read = |index: usize| !columns[index].is_empty() || (signals.is_empty() && index == 0);
        let mut topics = Vec::new();
        for (index, requested) in columns.iter().enumerate().filter(|(index, _)| is_read(*index)) {
            let mut sinks = self.sinks(index, requested)?;
            let clock = self.unnamed_clock(index, &mut sinks);
            self.take(index).read(&mut sinks)?;
            if let Some(name) = clock {
                check_clock(&name, &sinks)?;
            }
            topics.push(Topic::of(std::mem::take(&mut self.tables[index].0), sinks, requested.len())?);
        }
        if topics.iter().any(|topic| topic.places.is_empty()) {
            return Err(content("the file has a header, but no samples"));
        }
        Ok(Log { topics, likely_time })
    }

    /// Reads a column that seems to have the times of a table, last of all, where none is named and
    /// the samples have no stated distance. Returns its name.
    fn unnamed_clock(&self, index: usize, sinks: &mut Sinks) -> Option<String> {
        let has_times = sinks.columns.iter().any(|(_, sink)| matches!(sink, Sink::Times(_)));
        if has_times || self.options.period.is_some() {
            return None;
        }
        let table = self.tables[index].1.as_ref();
        let column = table.names().iter().position(|name| is_likely_time(name))?;
        let name = table.names()[column].clone();
        let options = Options { missing: Missing::Hold, ..self.options.clone() };
        sinks.columns.push((column, Sink::Values(ValueColumn::new(&name, &options, table.counted()))));
        Some(name)
    }

    /// Returns the columns that read these signals of a table, and its times.
    pub(crate) fn sinks(&self, index: usize, requested: &[(usize, &str)]) -> Result<Sinks> {
        let table = self.tables[index].1.as_ref();
        let counted = table.counted();
        let mut sinks = Sinks::new(counted);
        for (column, signal) in requested {
            let values = ValueColumn::new(signal, &self.options, counted);
            sinks.columns.push((*column, Sink::Values(values)));
        }
        self.add_times(table, self.time_columns(table)?, &mut sinks);
        // Rows are counted by a column, so one is read at least.
        if sinks.columns.is_empty() {
            let options = Options { missing: Missing::Hold, ..Options::default() };
            sinks.columns.push((0, Sink::Values(ValueColumn::new("", &options, counted))));
        }
        Ok(sinks)
    }

    /// Takes a table to read its rows.
    pub(crate) fn take(&mut self, index: usize) -> Box<dyn Table> {
        std::mem::replace(&mut self.tables[index].1, Box::new(Taken))
    }

    /// Returns the columns of a table whose rows belong to the topics that a column names: the
    /// topics, the times, and the columns of the signals, or all. Other signals are those of no
    /// topic.
    pub(crate) fn split_sinks(&self, signals: Option<&[&str]>, topic_column: &str) -> Result<Sinks> {
        let [(_, table)] = &self.tables[..] else {
            return Err(undecided(
                [Remedy::Unset(Key::LOG_TOPICS)],
                "a column names the topics of one file only",
            ));
        };
        let (table, names) = (table.as_ref(), table.names());
        let topic = named_column(table, topic_column, "topic")?;
        let time = self.time_columns(table)?;
        let is_candidate = |column: usize| {
            let ending = format!("/{}", names[column]);
            column != topic
                && match signals {
                    Some(signals) => signals.iter().any(|signal| signal.ends_with(&ending)),
                    None => !time.is_some_and(|time| time.has(column)),
                }
        };
        let counted = table.counted();
        let mut sinks = Sinks::new(counted);
        sinks.columns.push((topic, Sink::Topics(TopicColumn::new(&names[topic], counted))));
        self.add_times(table, time, &mut sinks);
        for column in (0..names.len()).filter(|column| is_candidate(*column)) {
            let values = ValueColumn::new(&names[column], &self.options, counted);
            sinks.columns.push((column, Sink::Values(values)));
        }
        Ok(sinks)
    }

    /// Reads signals, or all, of a log whose rows belong to the topics that a column names.
    fn read_split(mut self, signals: Option<&[&str]>, topic_column: &str) -> Result<Log> {
        let mut sinks = self.split_sinks(signals, topic_column)?;
        self.take(0).read(&mut sinks)?;
        let Sinks { columns, places, .. } = sinks;
        let mut topics = None;
        let mut times = None;
        let mut values = Vec::new();
        for (_, sink) in columns {
            match sink {
                Sink::Topics(column) => topics = Some(column),
                Sink::Times(column) => times = Some(column.finish()?),
                Sink::Nanoseconds(column) => {
                    times = times.map(|times: Times| column.after(&times)).transpose()?;
                }
                Sink::Values(column) => values.push(column),
            }
        }
        let topics = topics.ok_or_else(|| content("the file has no column with topics"))?;
        let mut found = Vec::new();
        for (index, topic) in topics.topics.iter().enumerate() {
            let requested: Vec<&ValueColumn> = values
                .iter()
                .filter(|column| {
                    let name = full_name(Some(topic), &column.name);
                    signals.is_none_or(|signals| signals.contains(&name.as_str()))
                })
                .collect();
            if requested.is_empty() {
                continue;
            }
            let rows: Vec<usize> =
                (0..topics.rows.len()).filter(|row| topics.rows[*row] as usize == index).collect();
            let columns = requested.into_iter().map(|column| Column {
                name: full_name(Some(topic), &column.name),
                values: rows.iter().map(|row| column.values[*row]).collect(),
            });
            found.push(Topic {
                name: Some(topic.clone()),
                columns: columns.collect(),
                times: times.as_ref().map(|times: &Times| times.of(&rows)),
                places: places.of(&rows),
            });
        }
        let has =
            |signal: &str| found.iter().flat_map(|topic| &topic.columns).any(|column| column.name == signal);
        if let Some(signal) = signals.unwrap_or_default().iter().find(|signal| !has(signal)) {
            let shown: Vec<String> =
                topics.topics.iter().take(20).map(|topic| format!("`{}`", visible(topic))).collect();
            return Err(content(format!(
                "no row has the signal `{}`; names are topic/column with the topics {}",
                visible(signal),
                shown.join(", ")
            )));
        }
        Ok(Log { topics: found, likely_time: None })
    }
}

impl Topic {
    fn of(name: Option<String>, sinks: Sinks, requested: usize) -> Result<Topic> {
        let mut times = None;
        let mut columns = Vec::new();
        for (_, sink) in sinks.columns {
            match sink {
                Sink::Values(ValueColumn { name, values, .. }) => columns.push(Column { name, values }),
                Sink::Times(column) => times = Some(column.finish()?),
                Sink::Nanoseconds(column) => {
                    times = times.map(|times: Times| column.after(&times)).transpose()?;
                }
                Sink::Topics(_) => {}
            }
        }
        columns.truncate(requested);
        Ok(Topic { name, times, columns, places: sinks.places })
    }
}

/// Returns whether the name of a column is one of times.
fn is_likely_time(name: &str) -> bool {
    let name = name.to_lowercase();
    let mut words = name.split(|c: char| !c.is_alphanumeric());
    name.contains("time") || name.contains("stamp") || words.any(|word| TIME_WORDS.contains(&word))
}

/// Checks that a column which seems to have the times, the last one that was read, does not start
/// again: then the table would be several logs, read as one.
fn check_clock(name: &str, sinks: &Sinks) -> Result<()> {
    let Some((_, Sink::Values(column))) = sinks.columns.last() else { return Ok(()) };
    // A flag such as `timeout` stays most of the time.
    let later = column.values.windows(2).filter(|pair| pair[1] > pair[0]).count();
    let starts = restarts(&column.values);
    let steps = column.values.len().saturating_sub(1 + starts.len());
    let Some(row) = starts.first().filter(|_| later >= steps).copied() else { return Ok(()) };
    let typed = (visible(name) == name).then(|| Choice::Text(name.to_owned()));
    Err(undecided(
        [Remedy::set(Key::LOG_TIME, typed.unwrap_or(Choice::COLUMN)), state_period()],
        format!(
            "`{}` looks like the times, and starts again in {}: several runs, or no clock",
            visible(name),
            sinks.places.text(row)
        ),
    ))
}

/// Returns the error for a signal that may be a column whose name is not UTF-8.
pub(crate) fn not_utf8(signal: &str, column: usize) -> LogError {
    content(format!(
        "no column is named `{}`, and the name of column {} is not UTF-8 text; save the file as UTF-8",
        visible(signal),
        column + 1
    ))
}

/// Takes the place of a table that is read.
struct Taken;

impl Table for Taken {
    fn names(&self) -> &[String] {
        &[]
    }

    fn counted(&self) -> crate::place::Counted {
        crate::place::Counted::Rows
    }

    fn read(self: Box<Self>, _: &mut Sinks) -> Result<()> {
        Ok(())
    }
}

pub(crate) fn full_name(topic: Option<&str>, name: &str) -> String {
    topic.map_or_else(|| name.to_owned(), |topic| format!("{topic}/{name}"))
}

/// Returns the column named `name`, if there is one.
fn column(table: &dyn Table, name: &str) -> Result<Option<usize>> {
    let names = table.names();
    let mut found = (0..names.len()).filter(|column| names[*column] == name);
    let first = found.next();
    let second = found.next();
    if let (Some(first), Some(second)) = (first, second) {
        return Err(content(format!(
            "two columns are named `{}`: {} and {}; rename one in the header",
            visible(name),
            first + 1,
            second + 1
        )));
    }
    Ok(first)
}

/// Returns the column with the times or topics that the user named.
fn named_column(table: &dyn Table, name: &str, what: &str) -> Result<usize> {
    if let Some(column) = column(table, name.trim())? {
        return Ok(column);
    }
    let similar = nearest(name, table.names().iter().map(String::as_str));
    let typed = similar.filter(|similar| visible(similar) == *similar);
    let hint = typed.map(|similar| format!("; did you mean `{similar}`?"));
    let fact = format!(
        "the {what} column is `{}`, but no column has this name{}",
        visible(name),
        hint.unwrap_or_default()
    );
    Err(undecided([], fact))
}

/// Where the bytes of a file come from.
pub(crate) enum Input {
    Stdin,
    File(File),
}

fn open_table(
    path: &Path,
    options: &Options,
    head: &JsonHead<'_>,
    wrapped: impl FnOnce(Input) -> Box<dyn Read>,
) -> Result<Box<dyn Table>> {
    if path.as_os_str() == "-" {
        let (format, source) = format::of(path, wrapped(Input::Stdin), options.format)?;
        return match format {
            Format::Csv => Ok(Box::new(CsvTable::open(source, options)?)),
            Format::JsonLines => Ok(Box::new(JsonTable::open(source, head)?)),
            Format::Numpy | Format::Parquet => Err(content("this format needs a file, not stdin")),
        };
    }
    if path.is_dir() {
        return Err(format::of_folder(path));
    }
    let file = File::open(path).map_err(|error| match path.metadata() {
        Ok(found) if !found.is_file() && !found.is_dir() => {
            io::Error::other("expected a file or a pipe, found a socket or a device")
        }
        _ => error,
    })?;
    let (format, source) = format::of(path, wrapped(Input::File(file)), options.format)?;
    let time = options.time.as_deref().unwrap_or(TIME);
    Ok(match format {
        Format::Csv => Box::new(CsvTable::open(source, options)?),
        Format::JsonLines => Box::new(JsonTable::open(source, head)?),
        Format::Numpy => Box::new(NumpyTable::open(path, time)?),
        #[cfg(feature = "parquet")]
        Format::Parquet => Box::new(crate::parquet::ParquetTable::open(path, time)?),
        #[cfg(not(feature = "parquet"))]
        Format::Parquet => return Err(content("this program was built without its feature `parquet`")),
    })
}
