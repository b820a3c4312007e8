//! Reads recorded traces from CSV files.

use std::cell::Cell;
use std::collections::HashMap;
use std::io::{self, Read};
use std::rc::Rc;
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};
use csv::{ByteRecord, Reader, Terminator, Trim};
use mishandle::stl::{Formula, Recording};
use mishandle_text::plural;

/// Column with the time of each sample, in seconds.
const TIME: &str = "time";

/// Largest deviation of a sampling interval from the period, as a fraction of the period.
const JITTER: f64 = 1e-3;

/// Largest size of a row in bytes. A row of 80,000 numbers with all their digits has 2 MB.
const MAX_ROW: usize = 16 << 20;

/// A CSV file whose header was read.
pub struct Log<R> {
    reader: Reader<RowLimit<R>>,
    row_bytes: Rc<Cell<usize>>,
    names: Vec<String>,
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
    times: Option<Times>,
}

impl<R: Read> Log<R> {
    /// Reads the header: the names of the columns. Spaces around a name and a byte order mark are
    /// ignored.
    pub fn open(source: R) -> Result<Log<R>> {
        let row_bytes = Rc::new(Cell::new(0));
        let source = RowLimit { source, row_bytes: row_bytes.clone(), is_in_line: false };
        // Errors about lines are our own: the reader counts records, and loses count at blank lines
        // and at `\r\n`.
        let mut builder = csv::ReaderBuilder::new();
        builder.trim(Trim::Headers).terminator(Terminator::Any(b'\n')).flexible(true);
        let mut reader = builder.from_reader(source);
        let mut names = Vec::new();
        for (index, name) in reader.byte_headers()?.iter().enumerate() {
            let name = std::str::from_utf8(name).ok().with_context(|| {
                format!("the name of column {} is not UTF-8 text; save the file as UTF-8", index + 1)
            })?;
            names.push(name.trim().to_string());
        }
        row_bytes.set(0);
        check_separator(&names)?;
        ensure!(!names.is_empty(), "the file is empty; the first line must contain the signal names");
        let mut columns = HashMap::with_capacity(names.len());
        for (column, name) in names.iter().enumerate() {
            ensure!(!name.is_empty(), "column {} has no name in the header", column + 1);
            if let Some(first) = columns.insert(name.as_str(), column) {
                bail!(
                    "two columns are named `{name}`: {} and {}; rename one in the header",
                    first + 1,
                    column + 1
                );
            }
        }
        Ok(Log { reader, row_bytes, names })
    }

    /// Returns the names of all columns.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Reads the samples of the signals of the formula and the times. Other columns may hold any
    /// text.
    pub fn samples(mut self, formula: &Formula) -> Result<Samples> {
        let signals = formula.signals();
        let is_read = |name: &str| signals.contains(&name);
        let columns: Vec<usize> = (0..self.names.len()).filter(|i| is_read(&self.names[*i])).collect();
        let time = self.names.iter().position(|name| name == TIME);
        let names: Arc<[String]> = columns.iter().map(|column| self.names[*column].clone()).collect();
        let mut recording = Recording::new(formula, Arc::clone(&names))?;
        let mut times = None;
        let mut sample = vec![0.0; columns.len()];
        let mut record = ByteRecord::new();
        while self.reader.read_byte_record(&mut record)? {
            self.row_bytes.set(0);
            // A blank line of a file whose lines end with `\r\n`; the reader skips the others.
            if record.as_slice() == b"\r" {
                continue;
            }
            let line = self.line(&record);
            ensure!(
                record.len() == self.names.len(),
                "line {line} has {}, but the header has {}; every line must have one cell for each name",
                plural(record.len(), "cell"),
                plural(self.names.len(), "name")
            );
            for (value, column) in sample.iter_mut().zip(&columns) {
                *value = self.number(&record, *column, line)?;
            }
            if let Some(column) = time {
                Times::add(&mut times, self.number(&record, column, line)?, line)?;
            }
            recording.push(&sample);
        }
        ensure!(!recording.is_empty(), "the file has a header, but no samples");
        Ok(Samples { names, recording, times })
    }

    /// Returns the line on which the record begins, counted from 1. The reader has consumed it with
    /// its line break.
    fn line(&self, record: &ByteRecord) -> u64 {
        let within = record.as_slice().iter().filter(|byte| **byte == b'\n').count() as u64;
        self.reader.position().line().saturating_sub(1 + within)
    }

    fn number(&self, record: &ByteRecord, column: usize, line: u64) -> Result<f64> {
        let cell = record.get(column).unwrap_or_default().trim_ascii();
        std::str::from_utf8(cell).ok().and_then(|text| text.parse().ok()).with_context(|| {
            let (name, cell) = (&self.names[column], String::from_utf8_lossy(cell));
            format!("line {line}: `{name}` is `{cell}`; it must be a number such as 0.25")
        })
    }
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

/// The range of the column `time` and its shortest and longest step.
struct Times {
    first: f64,
    last: f64,
    steps: usize,
    shortest: Step,
    longest: Step,
}

/// Two consecutive times, and the line of the second one.
#[derive(Clone, Copy)]
struct Step {
    from: f64,
    to: f64,
    line: u64,
}

impl Step {
    fn length(self) -> f64 {
        self.to - self.from
    }
}

impl Times {
    fn add(times: &mut Option<Times>, time: f64, line: u64) -> Result<()> {
        ensure!(
            time.is_finite(),
            "line {line}: `{TIME}` is {time}; every time must be a finite number of seconds"
        );
        let Some(times) = times else {
            let none = Step { from: time, to: time, line };
            *times = Some(Times { first: time, last: time, steps: 0, shortest: none, longest: none });
            return Ok(());
        };
        let step = Step { from: times.last, to: time, line };
        if times.steps == 0 || step.length() < times.shortest.length() {
            times.shortest = step;
        }
        if times.steps == 0 || step.length() > times.longest.length() {
            times.longest = step;
        }
        times.last = time;
        times.steps += 1;
        Ok(())
    }

    /// Returns the mean step.
    fn period(&self) -> Result<f64> {
        let Step { from, to, line } = self.shortest;
        ensure!(
            self.shortest.length() > 0.0,
            "column `{TIME}` does not increase: it is {from} and then {to} in line {line}"
        );
        let period = (self.last - self.first) / self.steps as f64;
        ensure!(period.is_finite(), "column `{TIME}` extends from {} to {}, too far", self.first, self.last);
        let is_uneven = |step: &Step| (step.length() / period - 1.0).abs() > JITTER;
        if let Some(Step { from, to, line }) = [self.shortest, self.longest].into_iter().find(is_uneven) {
            bail!(
                "samples must be evenly spaced; column `{TIME}` steps from {from} to {to} in line {line}, its mean step \
                 is {period}"
            );
        }
        Ok(period)
    }
}

impl Samples {
    /// Returns whether the log has the column `time`.
    pub fn has_times(&self) -> bool {
        self.times.is_some()
    }

    /// Returns the sampling period in seconds: `flag`, or else the mean step of the column `time`,
    /// or else 1.
    pub fn period(&self, flag: Option<f64>) -> Result<f64> {
        let Some(times) = self.times.as_ref().filter(|times| times.steps > 0) else {
            return Ok(flag.unwrap_or(1.0));
        };
        let found = times.period()?;
        if let Some(period) = flag {
            ensure!(
                (period / found - 1.0).abs() <= JITTER,
                "--period is {period} s, but the mean step of column `{TIME}` is {found} s; leave out --period"
            );
            return Ok(period);
        }
        // Rounded times, such as 0.03333 for 1/30, give an inexact period. A nearly integer
        // sampling rate is meant exactly.
        let rate = (1.0 / found).round();
        Ok(if (found * rate - 1.0).abs() < 1e-4 { 1.0 / rate } else { found })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mishandle::stl::{Clock, Monitor};

    fn read(text: &str, formula: &str) -> Result<Samples> {
        Log::open(text.as_bytes())?.samples(&Formula::parse(formula).unwrap())
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
        let error = read(text, "d").and_then(|samples| samples.period(None)).unwrap_err();
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
            "d\n\n1\n\n2.5\n\n",
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
        assert_eq!(samples.period(None).unwrap(), 0.5);
        assert_eq!(read("time,d,e\n0,2,1\n", "d > time").unwrap().names[..], ["time", "d"]);
        assert_eq!(column("time,d\n0,2\n0.5,6\n", "time"), [0.0, 0.5]);
    }

    #[test]
    fn a_row_without_end_is_an_error() {
        let d = Formula::parse("d").unwrap();
        let open = |source: &mut dyn Read| Log::open(source).and_then(|log| log.samples(&d)).err().unwrap();
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
        check("d,,e\n1,2,3\n", "column 2 has no name");
        check("d,e,d\n1,2,3\n", "two columns are named `d`: 1 and 3");
        check("d\n1\nx\n", "line 3: `d` is `x`");
        // A quoted cell may contain line ends.
        check("e,d\n\"a\nb\",1\nc,x\n", "line 4: `d` is `x`");
        check("d\n\n", "no samples");
        check("d,e\n1,2\n3\n", "line 3 has 1 cell, but the header has 2 names");
        check("d\n1,2\n", "line 2 has 2 cells, but the header has 1 name;");
    }

    #[test]
    fn lines_are_those_of_the_file_also_after_blank_lines_and_with_other_line_ends() {
        for text in [
            "d\n\n\n1\n\nx\n",
            "d\n\n\n1\n\nx",
            "\nd\n\n1\n\nx\n",
            "d\r\n\r\n\r\n1\r\n\r\nx\r\n",
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
    fn a_name_that_is_not_utf_8_is_an_error() {
        let error = Log::open(&b"d,\xff\n1,2\n"[..]).err().unwrap().to_string();
        assert!(error.contains("the name of column 2 is not UTF-8 text"), "{error}");
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
