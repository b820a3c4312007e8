//! Cells of a table, and the columns that collect them.

use mishandle_results::{Choice, Key, Remedy};
use mishandle_text::{number_text, visible};

use crate::date::{self, Written};
use crate::decimal::Decimal;
use crate::error::{LogError, Result, content, drop_missing, hold_or_drop, undecided};
use crate::options::{Missing, Options, Unit};
use crate::place::{Counted, Places};
use crate::stamp::NanosecondColumn;
use crate::times::{FAR, Times, last_digit, looks_like_a_part};
use crate::unit_name::unit_in;

/// Largest number of characters of a cell in a message.
const SHOWN_CELL: usize = 40;

/// Numbers from here on cannot be seconds: 10¹¹ s are in the year 5138, 10¹¹ ms in 1973.
const NOT_SECONDS: f64 = 1e11;

/// Largest number of rows of a log: 2 GiB for each column that is read.
pub(crate) const MAX_ROWS: usize = 1 << 28;

/// A cell of a table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Cell<'a> {
    /// No value.
    Missing,
    /// A number of 64 bits.
    Number(f64),
    /// A number of 32 bits.
    Single(f32),
    /// An integer.
    Integer(i128),
    /// An exact time in attoseconds, and the power of ten of its last digit in seconds.
    Time(i128, i32),
    /// Text without spaces around it: that of a number, too.
    Text(&'a str),
}

/// Returns whether the text stands for a missing number.
fn is_missing(text: &str) -> bool {
    let words = ["", "nan", "na", "n/a", "<na>", "nat", "null", "none", "nil", "-", "--", "inf", "-inf"];
    words.iter().any(|word| text.eq_ignore_ascii_case(word))
}

fn number(text: &str) -> Option<f64> {
    match text {
        "true" | "True" | "TRUE" => Some(1.0),
        "false" | "False" | "FALSE" => Some(0.0),
        text => text.parse().ok(),
    }
}

/// Returns a cell for a message, shortened and on one line.
pub(crate) fn shown(cell: Cell<'_>) -> String {
    let text = match cell {
        Cell::Missing => String::new(),
        Cell::Number(value) => number_text(value),
        Cell::Single(value) => value.to_string(),
        Cell::Integer(value) => value.to_string(),
        Cell::Time(..) => "a date".to_owned(),
        Cell::Text(text) => text.to_owned(),
    };
    let mut shown = visible(&text.chars().take(SHOWN_CELL).collect::<String>());
    if text.chars().nth(SHOWN_CELL).is_some() {
        shown += "...";
    }
    shown
}

/// The values of a signal; NaN where one is missing.
#[derive(Clone, Debug)]
pub(crate) struct ValueColumn {
    pub(crate) name: String,
    pub(crate) values: Vec<f64>,
    pub(crate) missing: usize,
    is_error: bool,
    counted: Counted,
}

impl ValueColumn {
    pub(crate) fn new(name: &str, options: &Options, counted: Counted) -> ValueColumn {
        // Rows of other topics may lack a value.
        let is_error = options.missing == Missing::Error && options.topic_column.is_none();
        ValueColumn { name: name.to_owned(), values: Vec::new(), missing: 0, is_error, counted }
    }

    pub(crate) fn push(&mut self, cell: Cell<'_>, at: u64) -> Result<()> {
        let value = match cell {
            Cell::Missing | Cell::Time(..) => None,
            Cell::Number(value) => Some(value),
            // The shortest text is the number that was meant: 0.1, not 0.10000000149.
            Cell::Single(value) => value.to_string().parse().ok(),
            Cell::Integer(value) => Some(value as f64),
            Cell::Text(text) => number(text),
        };
        let value = value.filter(|value| value.is_finite());
        if value.is_none() && self.is_error {
            let name = visible(&self.name);
            return Err(undecided(
                [hold_or_drop()],
                format!(
                    "{}: `{name}` is `{}`; it must be a number such as 0.25",
                    self.counted.text(at),
                    shown(cell)
                ),
            ));
        }
        if self.values.len() >= MAX_ROWS {
            return Err(content(format!("the log has more than {MAX_ROWS} rows; split it")));
        }
        self.missing += usize::from(value.is_none());
        self.values.push(value.unwrap_or(f64::NAN));
        Ok(())
    }
}

/// The kind of the cells of a column with times.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Number,
    Date,
    Duration,
}

impl Kind {
    fn text(self) -> &'static str {
        match self {
            Kind::Number => "a number",
            Kind::Date => "a date",
            Kind::Duration => "a duration",
        }
    }
}

/// The times of the rows while they are read.
#[derive(Clone, Debug)]
pub(crate) struct TimeColumn {
    times: Times,
    name: String,
    counted: Counted,
    unit: Option<Unit>,
    utc_offset: Option<i32>,
    drops: bool,
    kind: Option<Kind>,
    /// The first time of rows that are taken one by one, and whether another one followed.
    first: Option<f64>,
    has_step: bool,
}

impl TimeColumn {
    /// `known` is the unit that the format states.
    pub(crate) fn new(name: &str, known: Option<Unit>, options: &Options, counted: Counted) -> TimeColumn {
        TimeColumn {
            times: Times::new(name, counted),
            name: visible(name),
            counted,
            unit: options.time_unit.or(known),
            utc_offset: options.utc_offset,
            drops: options.missing == Missing::Drop,
            kind: None,
            first: None,
            has_step: false,
        }
    }

    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// Returns the times, if those without a stated unit look like seconds.
    pub(crate) fn finish(self) -> Result<Times> {
        if self.unit.is_none()
            && self.kind == Some(Kind::Number)
            && let Some((step, looks)) = self.times.other_unit()
        {
            return Err(self.looks_like(step, looks));
        }
        Ok(self.times)
    }

    fn looks_like(&self, step: f64, looks: &str) -> LogError {
        undecided(
            [state_unit(&["s", "ms", "us", "ns", "d"])],
            format!("column `{}` mostly steps by {}, which looks like {looks}", self.name, number_text(step)),
        )
    }

    /// Takes the time of the last row. The first step of times without a stated unit must look like
    /// seconds: the others are not known yet.
    fn take(&mut self) -> Result<Option<RowTime>> {
        let Some(time) = self.times.pop() else { return Ok(None) };
        let is_open = self.unit.is_none() && self.kind == Some(Kind::Number) && !self.has_step;
        if is_open && !time.secs.is_nan() {
            let step = (time.secs - *self.first.get_or_insert(time.secs)).abs();
            if let Some(looks) = looks_like_a_part(step) {
                return Err(self.looks_like(step, looks));
            }
            self.has_step = step > 0.0;
        }
        Ok(Some(time))
    }

    pub(crate) fn push(&mut self, cell: Cell<'_>, at: u64) -> Result<()> {
        match cell {
            Cell::Missing => self.missing(cell, at),
            Cell::Number(value) => self.number(&value.to_string(), value, cell, at),
            Cell::Single(value) => {
                let text = value.to_string();
                self.number(&text, text.parse().unwrap_or(f64::NAN), cell, at)
            }
            Cell::Integer(value) => self.number(&value.to_string(), value as f64, cell, at),
            Cell::Time(attoseconds, last_digit) => self.exact(Kind::Date, attoseconds, last_digit, at),
            Cell::Text(text) => match text.parse::<f64>() {
                Ok(value) => self.number(text, value, cell, at),
                Err(_) if is_missing(text) => self.missing(cell, at),
                Err(_) => self.date(text, at),
            },
        }
    }

    fn missing(&mut self, cell: Cell<'_>, at: u64) -> Result<()> {
        if !self.drops {
            let message = format!(
                "{}: `{}` is `{}`; every row needs a finite time",
                self.counted.text(at),
                self.name,
                shown(cell)
            );
            return Err(undecided([drop_missing()], message));
        }
        self.times.push_missing(at);
        Ok(())
    }

    fn number(&mut self, text: &str, value: f64, cell: Cell<'_>, at: u64) -> Result<()> {
        if !value.is_finite() {
            return self.missing(cell, at);
        }
        if self.unit.is_none() {
            self.check_seconds(value, at)?;
        }
        let unit = self.unit.unwrap_or(Unit::Seconds);
        // Days have 86,400 s, so that their last digit is worth up to 10⁵ s.
        let digits = match unit {
            Unit::Days => 5,
            Unit::Seconds => 0,
            Unit::Milliseconds => -3,
            Unit::Microseconds => -6,
            Unit::Nanoseconds => -9,
        };
        let last = last_digit(text).saturating_add(digits);
        let secs = value * (unit.attoseconds() as f64 / 1e18);
        let exact = Decimal::parse(text).and_then(|decimal| decimal.times(unit.attoseconds()));
        let is_first = self.kind.is_none();
        self.same_kind(Kind::Number, at)?;
        if let Some(exact) = exact {
            if is_first && (unit != Unit::Seconds || secs.abs() >= FAR) {
                let is_whole = last_digit(text) >= 0 && unit != Unit::Days;
                self.times.set_origin(exact, if is_whole { 0.0 } else { f64::EPSILON * secs.abs() });
            }
            if self.times.origin().is_some() {
                self.times.push_exact(exact, last, at);
                return Ok(());
            }
        }
        self.times.push_secs(secs, last, at);
        Ok(())
    }

    /// Checks that the numbers of a column without a stated unit look like seconds.
    fn check_seconds(&self, value: f64, at: u64) -> Result<()> {
        let units = || [state_unit(&["s", "ms", "us", "ns"])];
        if value.abs() >= NOT_SECONDS {
            let message = format!(
                "{}: `{}` is {}, which looks like ms, us or ns",
                self.counted.text(at),
                self.name,
                number_text(value)
            );
            return Err(undecided(units(), message));
        }
        if self.kind.is_none()
            && let Some(unit) = unit_in(&self.name)
        {
            let message = format!("the name of column `{}` looks like {unit}", self.name);
            return Err(undecided(units(), message));
        }
        Ok(())
    }

    fn date(&mut self, text: &str, at: u64) -> Result<()> {
        let place = self.counted.text(at);
        // A date can have points, too.
        let clock = text.find(':').map_or(text, |at| &text[at..]);
        let fraction = clock.split_once(['.', ',']).map_or("", |(_, rest)| rest);
        let last = -(fraction.bytes().take_while(u8::is_ascii_digit).count() as i32);
        match date::written(text) {
            Some(Written::Instant(time)) => self.exact(Kind::Date, time, last, at),
            Some(Written::Duration(time)) => self.exact(Kind::Duration, time, last, at),
            Some(Written::Local(time)) => match self.utc_offset {
                Some(offset) => {
                    self.exact(Kind::Date, time - i128::from(offset) * Unit::Seconds.attoseconds(), last, at)
                }
                None => Err(undecided(
                    [Remedy::set(Key::LOG_UTC_OFFSET, Choice::Shape("Z|+02:00"))],
                    format!(
                        "{place}: `{}` is `{}`, a date without a zone",
                        self.name,
                        shown(Cell::Text(text))
                    ),
                )),
            },
            None => Err(content(format!(
                "{place}: `{}` is `{}`; a time must be a number of seconds, or a date such as 2024-01-31T12:00:00Z",
                self.name,
                shown(Cell::Text(text))
            ))),
        }
    }

    fn exact(&mut self, kind: Kind, attoseconds: i128, last_digit: i32, at: u64) -> Result<()> {
        if self.kind.is_none() {
            self.times.set_origin(attoseconds, 0.0);
        }
        self.same_kind(kind, at)?;
        self.times.push_exact(attoseconds, last_digit, at);
        Ok(())
    }

    fn same_kind(&mut self, kind: Kind, at: u64) -> Result<()> {
        let known = *self.kind.get_or_insert(kind);
        if known == kind {
            return Ok(());
        }
        Err(content(format!(
            "{}: `{}` is {}, but {} in the rows before",
            self.counted.text(at),
            self.name,
            kind.text(),
            known.text()
        )))
    }
}

/// Returns the remedy to state the unit of times.
fn state_unit(units: &'static [&'static str]) -> Remedy {
    Remedy::set(Key::LOG_TIME_UNIT, Choice::OneOf(units))
}

/// The topic of each row.
#[derive(Clone, Debug)]
pub(crate) struct TopicColumn {
    pub(crate) name: String,
    pub(crate) topics: Vec<String>,
    pub(crate) rows: Vec<u32>,
    counted: Counted,
}

/// Largest number of topics of a log.
const MAX_TOPICS: usize = 1000;

impl TopicColumn {
    pub(crate) fn new(name: &str, counted: Counted) -> TopicColumn {
        TopicColumn { name: visible(name), topics: Vec::new(), rows: Vec::new(), counted }
    }

    pub(crate) fn push(&mut self, cell: Cell<'_>, at: u64) -> Result<()> {
        let name = match cell {
            Cell::Missing => String::new(),
            Cell::Integer(value) => value.to_string(),
            Cell::Text(text) => text.to_owned(),
            Cell::Number(_) | Cell::Single(_) | Cell::Time(..) => shown(cell),
        };
        if name.is_empty() {
            return Err(content(format!(
                "{}: `{}` is blank; it must name a topic",
                self.counted.text(at),
                self.name
            )));
        }
        // Rows of a topic often follow each other, and topics are few.
        let known = self.topics.iter().position(|known| *known == name);
        let topic = known.unwrap_or_else(|| {
            self.topics.push(name);
            self.topics.len() - 1
        });
        if topic >= MAX_TOPICS {
            return Err(content(format!("column `{}` has more than {MAX_TOPICS} topics", self.name)));
        }
        self.rows.push(topic as u32);
        Ok(())
    }
}

/// The columns of a table that somebody reads, and where its rows are.
pub(crate) struct Sinks {
    /// The index of each column in the file, and what it is read as.
    pub(crate) columns: Vec<(usize, Sink)>,
    pub(crate) places: Places,
    /// Takes each row as soon as it is read; without it, the columns keep all rows.
    pub(crate) each: Option<Box<dyn FnMut(Row) -> Result<()>>>,
}

/// A row that was read.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Row {
    /// Its number, as the places of its file count.
    pub(crate) number: u64,
    /// The topic that a column names.
    pub(crate) topic: Option<String>,
    /// The time, if the file has times.
    pub(crate) time: Option<RowTime>,
    /// The values in the order of the columns; NaN where one is missing.
    pub(crate) values: Vec<f64>,
}

/// The time of a row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct RowTime {
    /// In seconds since the origin of its file; NaN if it is missing.
    pub(crate) secs: f64,
    /// The instant of 0 s in attoseconds, if times are differences from it.
    pub(crate) origin: Option<i128>,
    /// Largest error by rounding, as the times of the file show so far.
    pub(crate) rounding: f64,
}

impl Sinks {
    pub(crate) fn new(counted: Counted) -> Sinks {
        Sinks { columns: Vec::new(), places: Places::new(counted), each: None }
    }

    /// States that each column has a cell of row `number`.
    pub(crate) fn end_row(&mut self, number: u64) -> Result<()> {
        let Some(each) = &mut self.each else {
            self.places.push(number);
            return Ok(());
        };
        let mut row = Row { number, topic: None, time: None, values: Vec::with_capacity(self.columns.len()) };
        for (_, sink) in &mut self.columns {
            match sink {
                Sink::Values(column) => row.values.extend(column.values.pop()),
                Sink::Times(column) => row.time = column.take()?,
                // It follows the column with the times.
                Sink::Nanoseconds(column) => row.time = row.time.map(|time| column.take_after(time)),
                Sink::Topics(column) => {
                    row.topic = column.rows.pop().map(|topic| column.topics[topic as usize].clone());
                }
            }
        }
        each(row)
    }
}

/// A column that collects cells.
#[derive(Debug)]
pub(crate) enum Sink {
    Values(ValueColumn),
    Times(TimeColumn),
    /// The part of the times after their whole seconds.
    Nanoseconds(NanosecondColumn),
    Topics(TopicColumn),
}

impl Sink {
    pub(crate) fn push(&mut self, cell: Cell<'_>, at: u64) -> Result<()> {
        match self {
            Sink::Values(column) => column.push(cell, at),
            Sink::Times(column) => column.push(cell, at),
            Sink::Nanoseconds(column) => column.push(cell, at),
            Sink::Topics(column) => column.push(cell, at),
        }
    }
}
