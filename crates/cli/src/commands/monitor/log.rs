//! Reads recorded traces from CSV files.

use std::borrow::Cow;
use std::cell::Cell;
use std::io::{self, Read};
use std::rc::Rc;
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};
use csv::{ByteRecord, Reader, Terminator, Trim};
use mishandle::stl::{Formula, Recording, nearest};
use mishandle_text::{plural, visible};

use super::times::Times;

/// Column with the time of each sample in seconds, if no other is named.
const TIME: &str = "time";

/// Words in the names of columns with times, in the logs of other programs.
const TIME_WORDS: [&str; 8] = ["t", "ts", "sec", "secs", "second", "seconds", "elapsed", "clock"];

/// Largest number of characters of a cell in a message.
const SHOWN_CELL: usize = 40;

/// Largest size of a row in bytes. A row of 80,000 numbers with all their digits has 2 MB.
const MAX_ROW: usize = 16 << 20;

/// A CSV file whose header was read.
pub struct Log<R> {
    reader: Reader<RowLimit<R>>,
    row_bytes: Rc<Cell<usize>>,
    names: Vec<String>,
    /// The columns whose names are not UTF-8, of which `names` has an approximation.
    foreign: Vec<usize>,
}

/// Fails after [`MAX_ROW`] bytes of one row. The reader of CSV collects a whole row, and a hostile
/// file can consist of one.
///
/// Ends the last line with a line break if it has none, so that the reader has always consumed the
/// line break of a row.
struct RowLimit<R> {
    source: R,
    /// Number of bytes since the last complete row.
    row_bytes: Rc<Cell<usize>>,
    is_in_line: bool,
}

impl<R: Read> Read for RowLimit<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut count = self.source.read(buffer)?;
        if let (0, true, Some(first)) = (count, self.is_in_line, buffer.first_mut()) {
            (*first, count) = (b'\n', 1);
        }
        if let Some(last) = count.checked_sub(1) {
            self.is_in_line = buffer[last] != b'\n';
        }
        self.row_bytes.set(self.row_bytes.get() + count);
        if self.row_bytes.get() > MAX_ROW {
            let message = format!(
                "a row, or blank lines in succession, have more than {} MiB; is this a CSV file?",
                MAX_ROW >> 20
            );
            return Err(io::Error::new(io::ErrorKind::InvalidData, message));
        }
        Ok(count)
    }
}

/// The samples of a log for a formula.
pub struct Samples {
    /// The names of the columns that the formula reads.
    pub names: Arc<[String]>,
    pub recording: Recording,
    pub times: Option<Times>,
}

impl<R: Read> Log<R> {
    /// Reads the header: the names of the columns. Spaces around a name and a byte order mark are
    /// ignored. A column that nobody reads may have any name, also none or that of another one.
    pub fn open(source: R) -> Result<Log<R>> {
        let row_bytes = Rc::new(Cell::new(0));
        let source = RowLimit { source, row_bytes: row_bytes.clone(), is_in_line: false };
        // Errors about lines are our own: the reader counts records, and loses count at blank lines
        // and at `\r\n`.
        let mut builder = csv::ReaderBuilder::new();
        builder.trim(Trim::Headers).terminator(Terminator::Any(b'\n')).flexible(true);
        let mut reader = builder.from_reader(source);
        let (mut names, mut foreign) = (Vec::new(), Vec::new());
        for (column, name) in reader.byte_headers()?.iter().enumerate() {
            if std::str::from_utf8(name).is_err() {
                foreign.push(column);
            }
            names.push(String::from_utf8_lossy(name).trim().to_string());
        }
        row_bytes.set(0);
        check_separator(&names)?;
        ensure!(!names.is_empty(), "the file is empty; the first line must contain the signal names");
        Ok(Log { reader, row_bytes, names, foreign })
    }

    /// Returns the names of all columns.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Returns the column named `name`, if there is one.
    ///
    /// # Errors
    /// If there are two.
    fn column(&self, name: &str) -> Result<Option<usize>> {
        let mut found = (0..self.names.len()).filter(|column| self.names[*column] == name);
        let (first, second) = (found.next(), found.next());
        if let (Some(first), Some(second)) = (first, second) {
            bail!(
                "two columns are named `{}`: {} and {}; rename one in the header",
                visible(name),
                first + 1,
                second + 1
            );
        }
        Ok(first)
    }

    /// Returns the column with the times: the one with this name, or else `time` if there is one.
    fn time_column(&self, name: Option<&str>) -> Result<Option<usize>> {
        let Some(name) = name else { return self.column(TIME) };
        if let Some(column) = self.column(name.trim())? {
            return Ok(Some(column));
        }
        let similar = nearest(name, self.names.iter().map(String::as_str));
        let typed = similar.filter(|similar| visible(similar) == *similar);
        let hint = typed.map(|similar| format!("; did you mean `{similar}`?"));
        bail!("--time is `{}`, but no column has this name{}", visible(name), hint.unwrap_or_default())
    }

    /// Returns the name of a column that seems to have the times, if none is named `time`.
    pub fn likely_time(&self) -> Option<&str> {
        let is_time = |name: &&String| {
            let name = name.to_lowercase();
            let mut words = name.split(|c: char| !c.is_alphanumeric());
            name.contains("time") || name.contains("stamp") || words.any(|word| TIME_WORDS.contains(&word))
        };
        self.names.iter().find(is_time).map(String::as_str)
    }

    /// Checks that the log has the signals of the formula, each of them once.
    pub fn check_signals(&self, formula: &Formula) -> Result<()> {
        for signal in formula.signals() {
            if self.column(signal)?.is_none()
                && let Some(column) = self.foreign.first()
            {
                bail!(
                    "no column is named `{}`, and the name of column {} is not UTF-8 text; save the file as UTF-8",
                    visible(signal),
                    column + 1
                );
            }
        }
        // Errors about signals and definitions, with the names of all columns.
        Recording::new(formula, self.names.as_slice().into())?;
        Ok(())
    }

    /// Reads the samples of the signals of the formula, which the log must have, and the times from
    /// the column named `time`. Other columns may hold any text.
    pub fn samples(mut self, formula: &Formula, time: Option<&str>) -> Result<Samples> {
        let signals = formula.signals();
        let is_read = |name: &str| signals.contains(&name);
        let columns: Vec<usize> = (0..self.names.len()).filter(|i| is_read(&self.names[*i])).collect();
        let time = self.time_column(time)?;
        let names: Arc<[String]> = columns.iter().map(|column| self.names[*column].clone()).collect();
        let mut recording = Recording::new(formula, Arc::clone(&names))?;
        let mut times = time.map(|column| Times::new(&self.names[column]));
        let mut sample = vec![0.0; columns.len()];
        let mut record = ByteRecord::new();
        let mut next_line = self.reader.position().line();
        while self.reader.read_byte_record(&mut record)? {
            self.row_bytes.set(0);
            let line = self.line(&record);
            // The reader skips blank lines, but for those of a file whose lines end with `\r\n`.
            let is_blank = record.as_slice() == b"\r";
            self.check_blank(if is_blank { line + 1 } else { line }, next_line)?;
            next_line = self.reader.position().line();
            if is_blank {
                continue;
            }
            ensure!(
                record.len() == self.names.len(),
                "line {line} has {}, but the header has {}; every line must have one cell for each name",
                plural(record.len(), "cell"),
                plural(self.names.len(), "name")
            );
            for (value, column) in sample.iter_mut().zip(&columns) {
                *value = self.number(&record, *column, line)?;
            }
            if let (Some(times), Some(column)) = (&mut times, time) {
                let secs = self.number(&record, column, line)?;
                times.push(&cell(&record, column), secs, line)?;
            }
            recording.push(&sample);
        }
        ensure!(!recording.is_empty(), "the file has a header, but no samples");
        self.check_blank(self.reader.position().line(), next_line)?;
        Ok(Samples { names, recording, times })
    }

    /// Checks that no blank line of a log with one column is before `line`: it would be a sample.
    fn check_blank(&self, line: u64, next: u64) -> Result<()> {
        ensure!(
            self.names.len() > 1 || line <= next,
            "line {next} is blank, so `{}` lacks a number there; write one, or remove the line",
            visible(&self.names[0])
        );
        Ok(())
    }

    /// Returns the line on which the record begins, counted from 1. The reader has consumed it with
    /// its line break.
    fn line(&self, record: &ByteRecord) -> u64 {
        let within = record.as_slice().iter().filter(|byte| **byte == b'\n').count() as u64;
        self.reader.position().line().saturating_sub(1 + within)
    }

    fn number(&self, record: &ByteRecord, column: usize, line: u64) -> Result<f64> {
        let text = cell(record, column);
        text.parse().ok().with_context(|| {
            let name = visible(&self.names[column]);
            let mut shown = visible(&text.chars().take(SHOWN_CELL).collect::<String>());
            if text.chars().nth(SHOWN_CELL).is_some() {
                shown += "...";
            }
            format!("line {line}: `{name}` is `{shown}`; it must be a number such as 0.25")
        })
    }
}

fn cell(record: &ByteRecord, column: usize) -> Cow<'_, str> {
    String::from_utf8_lossy(record.get(column).unwrap_or_default().trim_ascii())
}

/// Recognizes a header that another character than a comma separates.
fn check_separator(names: &[String]) -> Result<()> {
    let [name] = names else { return Ok(()) };
    let other =
        [(';', "semicolons"), ('\t', "tabs")].into_iter().find(|(separator, _)| name.contains(*separator));
    let Some((_, separators)) = other else { return Ok(()) };
    bail!(
        "the columns are separated by {separators}; write commas between them, and a point in numbers (0.25)"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use mishandle::stl::{Clock, Monitor};

    fn read(text: &str, formula: &str) -> Result<Samples> {
        let formula = Formula::parse(formula).unwrap();
        let log = Log::open(text.as_bytes())?;
        log.check_signals(&formula)?;
        log.samples(&formula, None)
    }

    fn period(text: &str, formula: &str) -> Result<Option<f64>> {
        read(text, formula)?.times.map_or(Ok(None), |times| times.period(None))
    }

    /// Returns the values of a column.
    fn column(text: &str, name: &str) -> Vec<f64> {
        let Samples { names, recording, .. } = read(text, name).unwrap();
        let mut monitor = Monitor::new(&Formula::parse(name).unwrap(), &names, Clock::steps(1.0)).unwrap();
        monitor.recorded_robustness_signal(recording).unwrap().to_vec()
    }

    fn values(text: &str) -> Vec<f64> {
        column(text, "d")
    }

    #[track_caller]
    fn check(text: &str, message: &str) {
        let error = period(text, "d").unwrap_err();
        assert!(error.to_string().contains(message), "{text:?}: {error}");
    }

    #[test]
    fn line_ends_quotes_spaces_and_a_byte_order_mark_do_not_change_the_values() {
        for text in [
            "d\n1\n2.5\n",
            "d\n1\n2.5",
            "d\r\n1\r\n2.5\r\n",
            "\u{feff}d\n1\n2.5\n",
            "\"d\"\n\"1\"\n\"2.5\"\n",
            " d \n 1\n2.5 \n",
            "\nd\n1\n2.5\n",
            "d,\n\n1,\n\n2.5,\n\n",
            "e,d\n,1\ntext,2.5\n",
            "\"e\n,\",d\n\"a,\n\"\"b\"\"\",1\nc,2.5\n",
        ] {
            assert_eq!(values(text), [1.0, 2.5], "{text:?}");
        }
    }

    #[test]
    fn only_the_columns_of_the_formula_are_kept() {
        let samples = read("a,d,time,e\n1,2,0,4\n5,6,0.5,x\n", "d").unwrap();
        assert_eq!(samples.names[..], ["d".to_owned()]);
        assert_eq!(samples.times.unwrap().period(None).unwrap(), Some(0.5));
        assert_eq!(read("time,d,e\n0,2,1\n", "d > time").unwrap().names[..], ["time", "d"]);
        assert_eq!(column("time,d\n0,2\n0.5,6\n", "time"), [0.0, 0.5]);
    }

    #[test]
    fn a_row_without_end_is_an_error() {
        let d = Formula::parse("d").unwrap();
        let open =
            |source: &mut dyn Read| Log::open(source).and_then(|log| log.samples(&d, None)).err().unwrap();
        let zeros = open(&mut io::repeat(0)).to_string();
        assert!(zeros.contains("more than 16 MiB"), "{zeros}");
        // A quoted cell contains any number of lines.
        let quoted = open(&mut "d\n1\n\"".as_bytes().chain(io::repeat(b'\n'))).to_string();
        assert!(quoted.contains("more than 16 MiB"), "{quoted}");
        // The header and the first row together may be longer, and so may many rows.
        let wide = "a".repeat(9 << 20);
        assert_eq!(values(&format!("d,{wide}\n1,{wide}\n")), [1.0]);
        let long = format!("d\n{}", "1234567890.5\n".repeat(2_000_000));
        assert_eq!(values(&long).len(), 2_000_000);
    }

    #[test]
    fn times_that_are_not_finite_are_errors() {
        check("time,d\n0,1\nnan,2\n1,3\n", "line 3: `time` is NaN");
        check("time,d\n0,1\n1,2\ninf,3\n", "line 4: `time` is inf");
        check("time,d\n-inf,1\n", "line 2: `time` is -inf");
        check("time,d\nnan,1\n", "line 2: `time` is NaN");
        check("time,d\n-1.7e308,1\n1.7e308,2\n", "too far");
    }

    #[test]
    fn uneven_and_decreasing_times_are_errors() {
        check("time,d\n0,1\n0.1,1\n0.3,1\n", "steps from 0 to 0.1 in line 3");
        check("time,d\n0,1\n1,1\n1,1\n", "does not increase: it is 1 and then 1 in line 4");
        check("time,d\n2,1\n1,1\n0,1\n", "does not increase");
    }

    #[test]
    fn malformed_files_are_errors_with_their_line() {
        check("", "the file is empty");
        check("d\n", "no samples");
        check("d\n1\nx\n", "line 3: `d` is `x`");
        // A quoted cell may contain line ends.
        check("e,d\n\"a\nb\",1\nc,x\n", "line 4: `d` is `x`");
        check("d,e\n\n", "no samples");
        check("d,e\n1,2\n3\n", "line 3 has 1 cell, but the header has 2 names");
        check("d\n1,2\n", "line 2 has 2 cells, but the header has 1 name;");
    }

    #[test]
    fn lines_are_those_of_the_file_also_after_blank_lines_and_with_other_line_ends() {
        for text in [
            "d,\n\n\n1,\n\nx,\n",
            "d,\n\n\n1,\n\nx,",
            "\nd,\n\n1,\n\nx,\n",
            "d,\r\n\r\n\r\n1,\r\n\r\nx,\r\n",
            "d\n1\n2\n3\n4\nx",
        ] {
            check(text, "line 6: `d` is `x`; it must be a number");
        }
        check("d\n1\n \n2\n", "line 3: `d` is ``");
        check("d\n1\n\"\"\n2\n", "line 3: `d` is ``");
        check("time,d\n0,1\n\n\n\nnan,1\n", "line 6: `time` is NaN");
        check("time,d\r\n0,1\r\n\r\n\r\n\r\n1\r\n", "line 6 has 1 cell, but the header has 2 names");
    }

    #[test]
    fn other_separators_than_commas_are_named() {
        check("time;d\n0,1;2\n", "the columns are separated by semicolons; write commas");
        check("time\td\n0\t2\n", "the columns are separated by tabs; write commas");
    }

    #[test]
    fn a_column_that_nobody_reads_may_have_any_name() {
        for text in ["d,,e\n1,,3\n", ",d\n0,1\n", "d,e,e\n1,2,3\n", "x,d,x,,\n,1,,,\n", "time,d,\n0,1,\n"] {
            assert_eq!(values(text), [1.0], "{text:?}");
        }
        let d = Formula::parse("d").unwrap();
        let log = Log::open(&b"d,\xff\n1,2\n"[..]).unwrap();
        log.check_signals(&d).unwrap();
        assert_eq!(log.samples(&d, None).unwrap().recording.len(), 1);
        // A column without a name can be read, too.
        assert_eq!(column(",d\n7,1\n", "``"), [7.0]);
    }

    #[test]
    fn a_column_that_is_read_has_a_name_of_its_own() {
        check("d,e,d\n1,2,3\n", "two columns are named `d`: 1 and 3; rename one");
        check("time,d,time\n1,2,3\n", "two columns are named `time`: 1 and 3");
        let error = read("d,,\n1,2,3\n", "``").err().unwrap().to_string();
        assert!(error.contains("two columns are named ``: 2 and 3"), "{error}");
        let log = Log::open(&b"d,gr\xf6\xdfe\n1,2\n"[..]).unwrap();
        let error = log.check_signals(&Formula::parse("größe").unwrap()).unwrap_err().to_string();
        assert!(error.contains("the name of column 2 is not UTF-8 text; save the file as UTF-8"), "{error}");
    }

    #[test]
    fn a_blank_line_of_a_log_with_one_column_is_a_missing_sample() {
        for text in ["d\n\n1\n", "d\r\n\r\n1\r\n", "d\n\n\n1", "d\r\n\r\n"] {
            check(text, "line 2 is blank, so `d` lacks a number");
        }
        for text in ["d\n1\n\n2\n", "d\n1\n\n", "d\r\n1\r\n\r\n2", "d\r\n1\r\n\r\n", "d\n1\n\n\n2\n"] {
            check(text, "line 3 is blank, so `d` lacks a number there; write one, or remove the line");
        }
    }

    #[test]
    fn many_columns_are_read_in_linear_time() {
        let header: Vec<String> = (0..80_000).map(|i| format!("s{i}")).collect();
        let row = vec!["1.5"; 80_000].join(",");
        let text = format!("{}\n{row}\n{row}\n", header.join(","));
        let started = std::time::Instant::now();
        assert_eq!(column(&text, "s79999"), [1.5, 1.5]);
        // Comparing all pairs of names takes 3.2 billion comparisons.
        assert!(started.elapsed().as_secs() < 10, "{:?}", started.elapsed());
    }
}
