//! From the rows of a log to the samples of a formula: order, missing values, even samples,
//! resampling and dense time.

pub(crate) mod align;
pub(crate) mod clock;
mod runs;

use std::sync::Arc;

use mishandle_results::{Choice, Key, Remedy};
use mishandle_stl::{DenseSignal, Trace};
use mishandle_text::{number_text, visible};

use crate::error::{Result, content, dense, drop_missing, hold_or_drop, keep_one, resample, undecided};
use crate::log::{Column, Log, Topic};
use crate::options::{Duplicates, Missing, Options, Sampling};
use crate::times::{FAR, Times};
pub use runs::{Run, restarts};

/// The samples of a log.
#[derive(Clone, Debug)]
pub struct Samples {
    /// The signals.
    pub signals: Signals,
    /// The number of values that were missing, of the columns that were read.
    pub missing: usize,
    /// The instant of 0 s in nanoseconds, in the scale of the file; `None` if times are those of
    /// the file.
    pub origin_ns: Option<i128>,
    /// The column that seems to have the times, if none was read as such.
    pub likely_time: Option<String>,
    /// The run of the clock, if it starts again in the log.
    pub run: Option<Run>,
}

/// The signals of a log over time.
#[derive(Clone, Debug)]
pub enum Signals {
    /// Samples at even times.
    Even {
        /// The signals.
        trace: Trace,
        /// The time between two samples in seconds, if it is known.
        period: Option<f64>,
        /// The time of the first sample in seconds; 0 if the log has no times.
        start: f64,
        /// Whether the log has times.
        has_times: bool,
    },
    /// Functions of time, which all begin and end at the same time.
    Dense(Vec<DenseSignal>),
}

impl Log {
    /// Turns the rows into samples, as the options say.
    ///
    /// # Errors
    /// If the options leave open what the samples are; the error has the remedies that decide. If
    /// the clock starts again: [`Log::samples_of_runs`] has the samples of each run.
    pub fn samples(self, options: &Options) -> Result<Samples> {
        one_run(self.samples_of_runs(options)?)
    }

    /// Turns the rows of each run into samples: a log is one run, unless its clock starts again.
    ///
    /// # Errors
    /// If the options leave open what the samples are.
    pub fn samples_of_runs(self, options: &Options) -> Result<Vec<Samples>> {
        options.check()?;
        let of_run = |(log, run): (Log, Option<Run>)| match run {
            None => log.samples_of_run(options),
            Some(run) => match log.samples_of_run(options) {
                Ok(samples) => Ok(Samples { run: Some(run), ..samples }),
                Err(error) => Err(error.within(&run.named(""))),
            },
        };
        self.runs()?.into_iter().map(of_run).collect()
    }

    fn samples_of_run(mut self, options: &Options) -> Result<Samples> {
        let columns = self.topics.iter().flat_map(|topic| &topic.columns);
        let missing = columns.map(|column| column.values.iter().filter(|value| value.is_nan()).count()).sum();
        for topic in &mut self.topics {
            topic.check_missing(options)?;
            if options.sampling == Sampling::Even && options.missing == Missing::Drop {
                topic.drop_rows();
            }
            topic.order(options)?;
            for column in &topic.columns {
                if column.values.iter().all(|value| value.is_nan()) && !topic.places.is_empty() {
                    return Err(content(format!("`{}` has no number in any row", visible(&column.name))));
                }
            }
            if options.missing == Missing::Hold {
                topic.columns.iter_mut().for_each(hold);
            }
        }
        let origin_ns = self.common_origin();
        self.check_clocks()?;
        let likely_time = self.likely_time.take();
        let signals = match options.sampling {
            Sampling::Even => self.even(options)?,
            Sampling::Resampled(interpolation) => align::resampled(self, interpolation, options)?,
            Sampling::Dense(interpolation) => Signals::Dense(align::dense(self, interpolation, options)?),
        };
        Ok(Samples { signals, missing, origin_ns, likely_time, run: None })
    }

    /// Shifts the times of all topics to one origin, that of the earliest, and returns it in
    /// nanoseconds.
    fn common_origin(&mut self) -> Option<i128> {
        let origins = self.topics.iter().filter_map(|topic| topic.times.as_ref()?.origin());
        let origin = origins.min()?;
        for times in self.topics.iter_mut().filter_map(|topic| topic.times.as_mut()) {
            times.shift_to(origin);
        }
        Some(origin.div_euclid(10_i128.pow(9)))
    }

    /// Checks that no topic ends months before another one starts: their times then do not count
    /// from the same instant, such as dates and seconds since the start.
    fn check_clocks(&self) -> Result<()> {
        for (early, late) in self.topics.iter().flat_map(|a| self.topics.iter().map(move |b| (a, b))) {
            let end = |topic: &Topic| Some(*topic.times.as_ref()?.secs().last()?);
            let start = |topic: &Topic| Some(*topic.times.as_ref()?.secs().first()?);
            if let (Some(end), Some(start)) = (end(early), start(late))
                && start - end > FAR
            {
                return Err(content(format!(
                    "the topic {} ends {} s before the topic {} starts: their times do not count from the same instant",
                    early.shown(),
                    number_text(start - end),
                    late.shown()
                )));
            }
        }
        Ok(())
    }

    /// Returns even samples: those of one topic, or of several with the same times.
    fn even(mut self, options: &Options) -> Result<Signals> {
        let rest = self.topics.split_off(1.min(self.topics.len()));
        let Some(mut first) = self.topics.pop() else {
            return Err(content("the log has no topic"));
        };
        for topic in &rest {
            let same = match (&first.times, &topic.times) {
                (Some(first), Some(other)) => first.secs() == other.secs(),
                _ => false,
            };
            if !same {
                return Err(undecided(
                    [resample(), dense()],
                    format!("the topics {} and {} have different times", first.shown(), topic.shown()),
                ));
            }
        }
        first.columns.extend(rest.into_iter().flat_map(|topic| topic.columns));
        if let Some(column) =
            first.columns.iter().find(|column| column.values.first().is_some_and(|v| v.is_nan()))
        {
            return Err(undecided(
                [drop_missing()],
                format!("{}: `{}` has no earlier value to hold", first.places.text(0), visible(&column.name)),
            ));
        }
        let period = match &first.times {
            Some(times) => times.period(options.period)?,
            None => options.period,
        };
        let start = first.times.as_ref().and_then(|times| times.secs().first().copied());
        let rows = first.places.len();
        Ok(Signals::Even {
            trace: trace(first.columns, rows)?,
            period,
            start: start.unwrap_or(0.0),
            has_times: first.times.is_some(),
        })
    }
}

/// Returns the samples of a log that is one run.
pub(crate) fn one_run(mut runs: Vec<Samples>) -> Result<Samples> {
    if let Some(run) = runs.get(1).and_then(|samples| samples.run.as_ref()) {
        return Err(content(format!(
            "the times start again in {}: the log is {}; cut it there into one log for each run",
            run.rows[0],
            mishandle_text::plural(run.of as u64, "run")
        )));
    }
    runs.pop().ok_or_else(|| content("the log has no topic"))
}

/// Returns a trace of these columns.
fn trace(columns: Vec<Column>, rows: usize) -> Result<Trace> {
    if rows == 0 {
        return Err(content("no row of the log remains"));
    }
    let names: Arc<[String]> = columns.iter().map(|column| column.name.clone()).collect();
    if names.is_empty() {
        // A formula without signals has a value at each sample all the same.
        let mut trace = Trace::new(names);
        (0..rows).for_each(|_| trace.push(&[]));
        return Ok(trace);
    }
    Ok(Trace::from_columns(names, columns.into_iter().map(|column| column.values).collect()))
}

/// Puts the last value in place of each missing one after it.
fn hold(column: &mut Column) {
    let mut last = f64::NAN;
    for value in &mut column.values {
        if value.is_nan() {
            *value = last;
        }
        last = *value;
    }
}

impl Topic {
    fn shown(&self) -> String {
        format!("`{}`", visible(self.name.as_deref().unwrap_or("")))
    }

    /// Checks that no value is missing, unless the options allow it. Readers check it where they
    /// know that each row must have a value.
    fn check_missing(&self, options: &Options) -> Result<()> {
        if options.missing != Missing::Error {
            return Ok(());
        }
        for column in &self.columns {
            if let Some(row) = column.values.iter().position(|value| value.is_nan()) {
                return Err(undecided(
                    [hold_or_drop()],
                    format!("{}: `{}` has no number", self.places.text(row), visible(&column.name)),
                ));
            }
        }
        Ok(())
    }

    /// Leaves out rows that lack a value or a time.
    fn drop_rows(&mut self) {
        let is_whole = |row: &usize| {
            self.columns.iter().all(|column| !column.values[*row].is_nan())
                && self.times.as_ref().is_none_or(|times| !times.secs()[*row].is_nan())
        };
        let kept: Vec<usize> = (0..self.places.len()).filter(is_whole).collect();
        if kept.len() < self.places.len() {
            self.keep(&kept);
        }
    }

    fn keep(&mut self, rows: &[usize]) {
        *self = self.with_rows(rows);
    }

    /// Returns the topic with these rows, in their order.
    fn with_rows(&self, rows: &[usize]) -> Topic {
        let of_rows = |column: &Column| Column {
            name: column.name.clone(),
            values: rows.iter().map(|row| column.values[*row]).collect(),
        };
        Topic {
            name: self.name.clone(),
            times: self.times.as_ref().map(|times| times.of(rows)),
            columns: self.columns.iter().map(of_rows).collect(),
            places: self.places.of(rows),
        }
    }

    /// Makes the times increase, or returns an error.
    fn order(&mut self, options: &Options) -> Result<()> {
        let Some(times) = &self.times else { return Ok(()) };
        if times.secs().iter().any(|secs| secs.is_nan()) {
            let kept: Vec<usize> =
                (0..times.secs().len()).filter(|row| !times.secs()[*row].is_nan()).collect();
            self.keep(&kept);
        }
        let Some(times) = &self.times else { return Ok(()) };
        if times.secs().windows(2).all(|pair| pair[0] < pair[1]) {
            return Ok(());
        }
        if let Some(row) = times.secs().windows(2).position(|pair| pair[0] > pair[1]) {
            if !options.sort {
                let sort = Remedy::set(Key::LOG_SORT, Choice::On).when("its rows are in the wrong order");
                let fact = not_increasing(times, row);
                return Err(undecided(
                    [sort],
                    format!("{fact}; if its clock starts again there, cut the log into two"),
                ));
            }
            let mut rows: Vec<usize> = (0..times.secs().len()).collect();
            rows.sort_by(|a, b| times.secs()[*a].total_cmp(&times.secs()[*b]));
            self.keep(&rows);
        }
        let Some(times) = &self.times else { return Ok(()) };
        let Some(row) = times.secs().windows(2).position(|pair| pair[0] >= pair[1]) else {
            return Ok(());
        };
        let is_same = |row: usize| row + 1 < times.secs().len() && times.secs()[row] >= times.secs()[row + 1];
        let rows = 0..times.secs().len();
        let kept: Vec<usize> = match options.duplicates {
            Duplicates::Error => return Err(undecided([keep_one()], not_increasing(times, row))),
            Duplicates::First => rows.filter(|row| *row == 0 || !is_same(row - 1)).collect(),
            Duplicates::Last => rows.filter(|row| !is_same(*row)).collect(),
        };
        self.keep(&kept);
        Ok(())
    }
}

fn not_increasing(times: &Times, row: usize) -> String {
    format!(
        "column `{}` does not increase: it is {} and then {} in {}",
        times.column(),
        times.text(row),
        times.text(row + 1),
        times.places.text(row + 1)
    )
}

/// Describes a duration in seconds.
fn secs_text(secs: f64) -> String {
    format!("{} s", number_text(secs))
}
