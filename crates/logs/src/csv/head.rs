//! The first lines of a CSV file: its dialect and the names of its columns.

use std::io::{self, Read};

use mishandle_results::{Choice, Key, Remedy};
use mishandle_text::{plural, visible};

use crate::date;
use crate::error::{Result, content, undecided};
use crate::options::Options;
use crate::table::retried;

/// Largest size of a row in bytes. A row of 80,000 numbers with all their digits has 2 MB.
pub(super) const MAX_ROW: usize = 16 << 20;

/// Characters that separate cells, in files of Excel and other programs.
const DELIMITERS: [char; 3] = [',', ';', '\t'];

/// Number of bytes that are read at once.
const BLOCK: usize = 1 << 16;

/// The dialect and the columns of a file.
#[derive(Debug)]
pub(super) struct Head {
    pub(super) delimiter: u8,
    /// Whether spaces separate cells; they become tabs.
    pub(super) has_blanks: bool,
    pub(super) names: Vec<String>,
    /// The columns whose names are not UTF-8, of which `names` has an approximation.
    pub(super) foreign: Vec<usize>,
    /// The number of the first line after the header.
    pub(super) next_line: u64,
    /// Whether `rostopic echo -p` wrote the file, with times in nanoseconds.
    pub(super) is_rostopic: bool,
}

/// A source whose first lines can be read before the rest.
pub(super) struct Ahead<R> {
    source: R,
    bytes: Vec<u8>,
    /// Number of bytes of complete lines that were taken.
    taken: usize,
    is_end: bool,
}

impl<R: Read> Ahead<R> {
    pub(super) fn new(source: R) -> Ahead<R> {
        Ahead { source, bytes: Vec::new(), taken: 0, is_end: false }
    }

    /// Returns the next line with its line break, which a quoted cell may contain, and steps over
    /// it; `None` at the end.
    fn line(&mut self) -> io::Result<Option<Vec<u8>>> {
        let mut at = self.taken;
        let mut is_quoted = false;
        loop {
            while at < self.bytes.len() {
                let byte = self.bytes[at];
                at += 1;
                if is_quoted {
                    is_quoted = byte != b'"';
                    continue;
                }
                // A quote within a cell is a character of it.
                let is_first = at < 2
                    || at - 1 == self.taken
                    || matches!(self.bytes[at - 2], b',' | b';' | b'\t' | b' ' | b'"');
                is_quoted = byte == b'"' && is_first;
                if byte == b'\n' {
                    let line = self.bytes[self.taken..at].to_vec();
                    self.taken = at;
                    return Ok(Some(line));
                }
            }
            if self.bytes.len() - self.taken > MAX_ROW {
                return Err(io::Error::new(io::ErrorKind::InvalidData, too_long()));
            }
            if !self.is_end {
                // What is there: a pipe has the rest of a block only later.
                let known = self.bytes.len();
                self.bytes.resize(known + BLOCK, 0);
                let read = retried(|| self.source.read(&mut self.bytes[known..]));
                self.bytes.truncate(known + *read.as_ref().unwrap_or(&0));
                self.is_end = read? == 0;
                continue;
            }
            let line = self.bytes[self.taken..].to_vec();
            self.taken = self.bytes.len();
            return Ok((!line.is_empty()).then_some(line));
        }
    }

    /// Returns the bytes from `start` on.
    pub(super) fn rest_from(mut self, start: usize) -> impl Read {
        io::Cursor::new(self.bytes.split_off(start)).chain(self.source)
    }
}

pub(super) fn too_long() -> String {
    format!("a row, or blank lines in succession, have more than {} MiB; is this a CSV file?", MAX_ROW >> 20)
}

impl Head {
    /// Reads the header and the first row. Returns also the position of the byte after the header.
    pub(super) fn read<R: Read>(ahead: &mut Ahead<R>, options: &Options) -> Result<(Head, usize)> {
        let mut line_number = 1;
        let mut stated = options.delimiter;
        let mut comment: Option<(Vec<u8>, u64)> = None;
        let (header, start, end) = loop {
            let start = ahead.taken;
            let Some(line) = ahead.line()? else {
                let message = "the file is empty; the first line must contain the signal names";
                // A file of comments has no samples either.
                return match comment {
                    Some(_) => Err(content("the file has comments, but no samples")),
                    None => Err(content(message)),
                };
            };
            let first = line_number;
            line_number += line.iter().filter(|byte| **byte == b'\n').count() as u64;
            let text = line.trim_ascii();
            if text.is_empty() {
                continue;
            }
            if let Some(rest) = text.to_ascii_lowercase().strip_prefix(b"sep=")
                && rest.len() <= 1
                && first == 1
            {
                stated = stated.or(Some(rest.first().map_or('\t', |byte| char::from(*byte))));
                continue;
            }
            if let b'#' | b'%' = text.first().copied().unwrap_or_default() {
                comment = Some((text.to_vec(), first));
                continue;
            }
            break (line, start, ahead.taken);
        };
        let header_lines = header.iter().filter(|byte| **byte == b'\n').count() as u64;
        let mut row = None;
        while let Some(line) = ahead.line()? {
            if !line.trim_ascii().is_empty() && !line.starts_with(b"#") && !line.starts_with(b"%") {
                row = Some(line);
                break;
            }
        }
        // A comment is the header if the line after it starts with a time, in as many cells.
        if let Some((text, _)) = &comment {
            let names = text[1..].trim_ascii_start();
            let delimiter = delimiter(stated, names, Some(&header))?;
            let cells = split(&header, delimiter);
            let is_row = cells.first().is_some_and(|cell| is_time(cell))
                || cells.iter().all(|cell| is_number_or_blank(cell));
            if is_row && split(names, delimiter).len() == cells.len() {
                let is_rostopic = text.starts_with(b"%time,");
                let before = ahead.bytes[..start].iter().filter(|byte| **byte == b'\n').count() as u64;
                let mut head = Head::of(names, delimiter, before + 1);
                if is_rostopic && let Some(first) = head.names.first_mut() {
                    "%time".clone_into(first);
                    head.is_rostopic = true;
                }
                return Ok((head, start));
            }
        }
        let delimiter = delimiter(stated, &header, row.as_deref())?;
        let before = ahead.bytes[..start].iter().filter(|byte| **byte == b'\n').count() as u64;
        let head = Head::of(&header, delimiter, before + header_lines + 1);
        if !head.names.is_empty()
            && head.names.iter().all(|name| is_number(name.as_bytes()))
            && row.is_some_and(|row| split(&row, delimiter).iter().all(|cell| is_number_or_blank(cell)))
        {
            return Err(content(format!(
                "line {} has {} where the names of the signals must be; write them into the first line",
                before + 1,
                plural(head.names.len(), "number")
            )));
        }
        Ok((head, end))
    }

    fn of(header: &[u8], delimiter: char, next_line: u64) -> Head {
        let mut names = Vec::new();
        let mut foreign = Vec::new();
        for (column, name) in split(header, delimiter).iter().enumerate() {
            if std::str::from_utf8(name).is_err() {
                foreign.push(column);
            }
            names.push(String::from_utf8_lossy(name).trim().to_owned());
        }
        let has_blanks = delimiter == ' ';
        let delimiter = if has_blanks { b'\t' } else { u8::try_from(delimiter).unwrap_or(b',') };
        Head { delimiter, has_blanks, names, foreign, next_line, is_rostopic: false }
    }
}

/// Returns the character that separates cells.
fn delimiter(stated: Option<char>, header: &[u8], row: Option<&[u8]>) -> Result<char> {
    if let Some(stated) = stated {
        return Ok(stated);
    }
    let count = |line: &[u8], delimiter| split(line, delimiter).len();
    let several: Vec<char> =
        DELIMITERS.into_iter().filter(|delimiter| count(header, *delimiter) > 1).collect();
    let Some(row) = row else { return Ok(several.first().copied().unwrap_or(',')) };
    let fits = |delimiter: &char| count(row, *delimiter) == count(header, *delimiter);
    let fitting: Vec<char> = several.iter().copied().filter(fits).collect();
    match (&fitting[..], &several[..]) {
        ([only], _) => Ok(*only),
        ([first, second, ..], _) => Err(undecided(
            [Remedy::set(Key::LOG_DELIMITER, Choice::Text(visible(&first.to_string())))],
            format!("the columns can be separated by {} or by {}", named(*first), named(*second)),
        )),
        ([], [first, ..]) => Ok(*first),
        ([], []) => {
            let cells = split(row, ' ');
            let are_numbers = cells.len() > 1 && cells.iter().all(|cell| is_number(cell));
            Ok(if are_numbers && count(header, ' ') == cells.len() { ' ' } else { ',' })
        }
    }
}

fn named(delimiter: char) -> &'static str {
    match delimiter {
        ',' => "commas",
        ';' => "semicolons",
        _ => "tabs",
    }
}

/// Returns the cells of a line without the spaces around them.
fn split(line: &[u8], delimiter: char) -> Vec<Vec<u8>> {
    let blanks: Vec<u8>;
    let (line, delimiter) = match u8::try_from(delimiter) {
        Ok(b' ') => {
            let cells = line.split(u8::is_ascii_whitespace).filter(|cell| !cell.is_empty());
            blanks = cells.collect::<Vec<_>>().join(&b'\t');
            (&blanks[..], b'\t')
        }
        Ok(delimiter) => (line, delimiter),
        Err(_) => (line, b','),
    };
    let mut builder = csv::ReaderBuilder::new();
    builder.has_headers(false).flexible(true).delimiter(delimiter);
    let first = builder.from_reader(line).into_byte_records().next();
    let Some(Ok(record)) = first else { return Vec::new() };
    record.iter().map(|cell| cell.trim_ascii().to_vec()).collect()
}

/// Returns whether a cell is a number or a date.
fn is_time(cell: &[u8]) -> bool {
    is_number(cell) || std::str::from_utf8(cell).is_ok_and(|text| date::written(text).is_some())
}

fn is_number(cell: &[u8]) -> bool {
    std::str::from_utf8(cell).is_ok_and(|text| text.parse::<f64>().is_ok())
}

fn is_number_or_blank(cell: &[u8]) -> bool {
    let text = std::str::from_utf8(cell).unwrap_or("x").replacen(',', ".", 1);
    text.is_empty() || text.parse::<f64>().is_ok()
}
