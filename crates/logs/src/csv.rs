//! CSV files, in the dialects of Excel, MATLAB, pandas, NumPy, PlotJuggler and `rostopic echo -p`.

mod decode;
mod head;

use std::cell::Cell as SharedCell;
use std::io::{self, Read};
use std::rc::Rc;

use csv::{ByteRecord, Reader, Terminator};
use head::{Ahead, Head, MAX_ROW, too_long};
use mishandle_results::{Choice, Key, Remedy};
use mishandle_text::{plural, visible};

use crate::cell::{Cell, Sink, Sinks};
use crate::date;
use crate::error::{Result, content, undecided};
use crate::options::{Options, Unit};
use crate::place::Counted;
use crate::table::Table;

/// A CSV file whose header was read.
pub(crate) struct CsvTable {
    reader: Reader<RowLimit<Box<dyn Read>>>,
    row_bytes: Rc<SharedCell<usize>>,
    is_ended: Rc<SharedCell<bool>>,
    head: Head,
    decimal_comma: Option<bool>,
}

/// Fails after [`MAX_ROW`] bytes of one row. The reader of CSV collects a whole row, and a hostile
/// file can consist of one.
///
/// Ends the last line with a line break if it has none, so that the reader has always consumed the
/// line break of a row.
struct RowLimit<R> {
    source: R,
    /// Number of bytes since the last complete row.
    row_bytes: Rc<SharedCell<usize>>,
    is_in_line: bool,
    /// Whether the reader got the end of the file. It asks for it within a row only if a quote is
    /// open.
    is_ended: Rc<SharedCell<bool>>,
}

impl<R: Read> Read for RowLimit<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut count = self.source.read(buffer)?;
        if let (0, true, Some(first)) = (count, self.is_in_line, buffer.first_mut()) {
            (*first, count) = (b'\n', 1);
        }
        self.is_ended.set(count == 0);
        if let Some(last) = count.checked_sub(1) {
            self.is_in_line = buffer[last] != b'\n';
        }
        self.row_bytes.set(self.row_bytes.get() + count);
        if self.row_bytes.get() > MAX_ROW {
            return Err(io::Error::new(io::ErrorKind::InvalidData, too_long()));
        }
        Ok(count)
    }
}

impl CsvTable {
    /// Reads the header: the names of the columns. Spaces around a name and a byte order mark are
    /// ignored. A column that nobody reads may have any name, also none or that of another one.
    pub(crate) fn open(source: Box<dyn Read>, options: &Options) -> Result<CsvTable> {
        let mut ahead = Ahead::new(decode::utf8(source)?);
        let (head, start) = Head::read(&mut ahead, options)?;
        let rest: Box<dyn Read> = if head.has_blanks {
            Box::new(decode::Blanks {
                source: ahead.rest_from(start),
                is_due: false,
                is_quoted: false,
                is_in_line: false,
            })
        } else {
            Box::new(ahead.rest_from(start))
        };
        let row_bytes = Rc::new(SharedCell::new(0));
        let is_ended = Rc::new(SharedCell::new(false));
        let limits = (row_bytes.clone(), is_ended.clone());
        let source = RowLimit { source: rest, row_bytes: limits.0, is_in_line: false, is_ended: limits.1 };
        // Errors about lines are our own: the reader counts records, and loses count at blank lines
        // and at `\r\n`.
        let mut builder = csv::ReaderBuilder::new();
        builder.has_headers(false).terminator(Terminator::Any(b'\n')).flexible(true);
        builder.delimiter(head.delimiter);
        let reader = builder.from_reader(source);
        let decimal_comma = options.decimal_comma.or((head.delimiter == b',').then_some(false));
        Ok(CsvTable { reader, row_bytes, is_ended, head, decimal_comma })
    }

    /// Returns the line of the file at which the reader is.
    fn position(&self) -> u64 {
        self.reader.position().line() + self.head.next_line - 1
    }

    /// Returns the line on which the record begins, counted from 1. The reader has consumed it with
    /// its line break.
    fn line(&self, record: &ByteRecord) -> u64 {
        let within = record.as_slice().iter().filter(|byte| **byte == b'\n').count() as u64;
        self.position().saturating_sub(1 + within)
    }

    /// Checks that no blank line of a log with one column is before `line`: it would be a sample.
    fn check_blank(&self, line: u64, next: u64) -> Result<()> {
        if self.head.names.len() > 1 || line <= next {
            return Ok(());
        }
        let name = visible(&self.head.names[0]);
        Err(content(format!(
            "line {next} is blank, so `{name}` lacks a number there; write one, or remove the line"
        )))
    }
}

/// Replaces the decimal comma of a number by a point, if the file has commas there.
struct Decimals {
    /// As the user or the separator of the cells says.
    stated: Option<bool>,
    /// As the numbers so far say.
    seen: Option<bool>,
    text: String,
}

impl Decimals {
    fn read<'a>(&'a mut self, cell: &'a str, line: u64) -> Result<&'a str> {
        if self.stated == Some(false) || !cell.contains([',', '.']) {
            return Ok(cell);
        }
        let is_number = |text: &str| text.parse::<f64>().is_ok();
        let is_comma = match (cell.contains(','), cell.contains('.')) {
            (false, true) if is_number(cell) => false,
            (true, false) => {
                self.text.clear();
                self.text.push_str(cell);
                if let Some(at) = cell.find(',') {
                    self.text.replace_range(at..=at, ".");
                }
                if !is_number(&self.text) {
                    return Ok(cell);
                }
                true
            }
            _ => return Ok(cell),
        };
        match self.stated.or(self.seen) {
            Some(known) if known != is_comma => Err(undecided(
                [Remedy::set(Key::LOG_DECIMAL, Choice::OneOf(&["comma", "point"]))],
                format!(
                    "line {line}: `{}` has a decimal {}, the numbers before have a {}",
                    visible(&cell.chars().take(40).collect::<String>()),
                    if is_comma { "comma" } else { "point" },
                    if known { "comma" } else { "point" },
                ),
            )),
            _ => {
                self.seen = Some(is_comma);
                Ok(if is_comma { &self.text } else { cell })
            }
        }
    }
}

impl Table for CsvTable {
    fn names(&self) -> &[String] {
        &self.head.names
    }

    fn counted(&self) -> Counted {
        Counted::Lines
    }

    fn known_time(&self) -> Option<(usize, Unit)> {
        self.head.is_rostopic.then_some((0, Unit::Nanoseconds))
    }

    fn foreign(&self) -> Option<usize> {
        self.head.foreign.first().copied()
    }

    fn read(mut self: Box<Self>, sinks: &mut Sinks) -> Result<()> {
        let mut record = ByteRecord::new();
        let mut decimals = Decimals { stated: self.decimal_comma, seen: None, text: String::new() };
        let mut next_line = self.position();
        while self.reader.read_byte_record(&mut record).map_err(csv_error)? {
            self.row_bytes.set(0);
            // No line break ends a record with an open quote.
            let is_open = self.is_ended.get();
            let line = self.line(&record) + u64::from(is_open);
            // The reader skips blank lines, but for those of a file whose lines end with `\r\n`.
            let is_blank = record.as_slice() == b"\r" && record.len() == 1;
            self.check_blank(if is_blank { line + 1 } else { line }, next_line)?;
            next_line = self.position();
            if is_blank {
                continue;
            }
            if is_comment(&record, line, &self.head.names, sinks)? {
                continue;
            }
            if is_open {
                return Err(content(format!("line {line} has a quote (\") that is not closed")));
            }
            if record.len() != self.head.names.len() {
                return Err(content(format!(
                    "line {line} has {}, but the header has {}; every line must have one cell for each name",
                    plural(record.len(), "cell"),
                    plural(self.head.names.len(), "name")
                )));
            }
            for (column, sink) in &mut sinks.columns {
                let cell = record.get(*column).unwrap_or_default().trim_ascii();
                let text = String::from_utf8_lossy(cell);
                sink.push(Cell::Text(decimals.read(&text, line)?), line)?;
            }
            sinks.end_row(line)?;
        }
        self.check_blank(self.position(), next_line)
    }
}

/// Returns whether a record is a comment: a line that starts with `#` or `%`.
///
/// A first cell can start so, too, in a row whose other cells are read: that is an error, because
/// no row is left out without a word.
fn is_comment(record: &ByteRecord, line: u64, names: &[String], sinks: &Sinks) -> Result<bool> {
    let first = record.get(0).unwrap_or_default().trim_ascii_start();
    let Some(mark @ (b'#' | b'%')) = first.first().copied() else { return Ok(false) };
    let mark = char::from(mark);
    if record.as_slice().contains(&b'\n') {
        return Err(content(format!(
            "line {line} starts with {mark}, as a comment, but a quote in it opens a cell of several lines; remove the quote"
        )));
    }
    let is_value = |column: &usize| {
        let cell = String::from_utf8_lossy(record.get(*column).unwrap_or_default().trim_ascii());
        *column > 0 && (cell.replacen(',', ".", 1).parse::<f64>().is_ok() || date::written(&cell).is_some())
    };
    let mut read = sinks.columns.iter().filter(|(_, sink)| !matches!(sink, Sink::Topics(_)));
    if record.len() == names.len() && read.all(|(column, _)| is_value(column)) {
        return Err(content(format!(
            "line {line} starts with {mark}, as a comment, but has the cells of a row; remove the line, or {mark}"
        )));
    }
    Ok(true)
}

fn csv_error(error: csv::Error) -> crate::LogError {
    let message = error.to_string();
    match error.into_kind() {
        csv::ErrorKind::Io(error) => error.into(),
        _ => content(message),
    }
}
