//! Logs that are still written: their samples as they come.
//!
//! A thread for each file reads it with the reader of whole logs and hands out rows (`reader.rs`;
//! `tail.rs` waits at the end of a file). [`Follow`] merges them: `topic.rs` puts the rows of a
//! topic in order and fills in missing values, `even.rs` checks times against the period, and
//! `grid.rs` resamples. [`Watch`] (`watch.rs`) gives the samples to online monitors.
//!
//! Rows come late, and those of several topics in any order. A sample is taken when no row can come
//! that changes it: every topic has a later row or has ended. With a *lateness*, it is also taken
//! when a row of any topic is later by more than the lateness, in the time of the log. A row that
//! comes after that is an error. So the samples do not depend on when their rows arrive.

mod even;
mod grid;
mod reader;
mod tail;
mod topic;
mod watch;

use std::io::Read;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TryRecvError, sync_channel};
use std::time::Duration;

use even::Steps;
use grid::{Grid, Track};
use mishandle_results::{Choice, Key, Remedy};
use mishandle_stl::Formula;
use mishandle_text::{number_text, visible};
use reader::{Message, Opened};
use topic::Topic;
pub use watch::{Answer, Violated, Watch, Watched};

use crate::cell::Row;
use crate::error::{
    LogError, Result, content, drop_missing, name_time, resample, resample_to_period, state_period, undecided,
};
use crate::log::{Source, full_name, not_utf8};
use crate::options::{Duplicates, Options, Sampling};

/// Attoseconds per second.
const ATTO: f64 = 1e18;

/// Number of rows of a topic that wait for others before no more of them are read.
const AHEAD: usize = 1 << 14;

/// Largest number of rows that wait.
const MAX_WAITING: usize = 1 << 22;

/// The choices that only logs have that are still written.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Following {
    /// Seconds of the log by which a row can come later than those of other topics, or with
    /// [`Options::sort`] than those of its own; `None`: a sample waits for all topics.
    pub lateness: Option<f64>,
    /// How long a file must not have grown to be complete; `None`: it never is. A pipe is complete
    /// when it is closed.
    pub idle: Option<Duration>,
}

/// The answer of [`Follow::next`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// A sample.
    Sample,
    /// No sample within the time.
    Waiting,
    /// All files have ended.
    End,
}

/// A file that a thread reads.
struct File {
    source: Source,
    receiver: Receiver<Message>,
    opened: Option<Opened>,
    has_ended: bool,
    /// Rows that were read, and are added one at a time.
    rows: std::vec::IntoIter<Row>,
    /// The topics of its rows, with the columns of their values.
    topics: Vec<(Option<String>, usize, Vec<usize>)>,
}

/// A log that is still written.
pub struct Follow {
    options: Options,
    lateness: Option<f64>,
    formulas: Vec<Formula>,
    /// The signals of the formulas.
    signals: Vec<String>,
    files: Vec<File>,
    wake: Receiver<()>,
    /// Keeps the channel open.
    _waker: SyncSender<()>,
    topics: Vec<Topic>,
    is_checked: bool,
    /// The formulas whose signals the log lacks, by their positions.
    unreadable: Vec<(usize, LogError)>,
    /// Whether the topics have one origin.
    has_origin: bool,
    steps: Steps,
    grid: Option<Grid>,
    sample: Vec<f64>,
    time: Option<f64>,
    start: f64,
    taken: u64,
}

impl Follow {
    /// Starts to read the files. The signals are those of the formulas.
    ///
    /// # Errors
    /// If the choices exclude each other, or cannot be made before the log ends.
    pub fn open(
        sources: &[Source],
        formulas: &[Formula],
        options: &Options,
        following: Following,
    ) -> Result<Follow> {
        let inputs = sources.iter().map(|source| (source.clone(), None)).collect();
        Follow::of(inputs, formulas, options, following)
    }

    /// Starts to read CSV, or JSON lines if the options say so, from pipes: each with its topic.
    ///
    /// # Errors
    /// As for [`Follow::open`].
    pub fn open_pipes(
        pipes: Vec<(Option<String>, Box<dyn Read + Send>)>,
        formulas: &[Formula],
        options: &Options,
        following: Following,
    ) -> Result<Follow> {
        let source = |topic| Source { topic, path: "-".into() };
        let inputs = pipes.into_iter().map(|(topic, pipe)| (source(topic), Some(pipe))).collect();
        Follow::of(inputs, formulas, options, following)
    }

    fn of(
        inputs: Vec<(Source, Option<Box<dyn Read + Send>>)>,
        formulas: &[Formula],
        options: &Options,
        following: Following,
    ) -> Result<Follow> {
        options.check()?;
        check(formulas, options, following)?;
        if options.topic_column.is_some() && inputs.len() != 1 {
            return Err(undecided(
                [Remedy::Unset(Key::LOG_TOPICS)],
                "a column names the topics of one file only",
            ));
        }
        let mut signals: Vec<String> =
            formulas.iter().flat_map(Formula::signals).map(str::to_owned).collect();
        signals.sort_unstable();
        signals.dedup();
        let (waker, wake) = sync_channel(1);
        let start = |(index, (source, input)): (usize, (Source, Option<Box<dyn Read + Send>>))| File {
            source: source.clone(),
            receiver: reader::start(
                source,
                input,
                signals.clone(),
                options.clone(),
                following,
                index == 0,
                waker.clone(),
            ),
            opened: None,
            has_ended: false,
            rows: Vec::new().into_iter(),
            topics: Vec::new(),
        };
        let grid = match (options.sampling, options.period) {
            (Sampling::Resampled(interpolation), Some(period)) => Some(Grid {
                period,
                interpolation,
                tolerance: options.tolerance,
                has_waiting: options.sort || options.duplicates == Duplicates::Last,
                tracks: signals.iter().map(|_| Track::default()).collect(),
                start: None,
                taken: 0,
            }),
            _ => None,
        };
        Ok(Follow {
            options: options.clone(),
            lateness: following.lateness,
            formulas: formulas.to_vec(),
            files: inputs.into_iter().enumerate().map(start).collect(),
            wake,
            _waker: waker,
            topics: Vec::new(),
            is_checked: false,
            unreadable: Vec::new(),
            has_origin: false,
            steps: Steps::default(),
            grid,
            sample: vec![0.0; signals.len()],
            time: None,
            start: 0.0,
            taken: 0,
            signals,
        })
    }

    /// Waits until the names of the columns are known, and returns whether they are. Returns also
    /// the formulas whose signals the log lacks, by their positions, each once.
    ///
    /// # Errors
    /// If a file is not what its format requires, or has the signals of no formula.
    pub fn open_files(&mut self, wait: Duration) -> Result<(bool, Vec<(usize, LogError)>)> {
        while !self.is_checked {
            if !self.receive()?
                && let Err(RecvTimeoutError::Timeout) = self.wake.recv_timeout(wait)
            {
                return Ok((false, Vec::new()));
            }
        }
        Ok((true, std::mem::take(&mut self.unreadable)))
    }

    /// Returns the signals of a sample, in the order of their values. Those that the log lacks are
    /// among them until its files are open.
    pub fn signals(&self) -> &[String] {
        &self.signals
    }

    /// Returns the values of the sample.
    pub fn sample(&self) -> &[f64] {
        &self.sample
    }

    /// Returns the time of the sample in seconds; `None` if the log has no times and no period.
    pub fn time(&self) -> Option<f64> {
        self.time
    }

    /// Returns the instant of 0 s in nanoseconds, if times are differences from it.
    pub fn origin_ns(&self) -> Option<i128> {
        self.origin().map(|origin| origin.div_euclid(10_i128.pow(9)))
    }

    /// Returns the number of values that were missing.
    pub fn missing(&self) -> usize {
        self.topics.iter().map(|topic| topic.missing).sum()
    }

    fn origin(&self) -> Option<i128> {
        self.topics.iter().filter_map(|topic| topic.origin).min()
    }

    /// Returns the next sample, for which it waits this long.
    ///
    /// # Errors
    /// If a file is not what its format requires, a choice is missing, or a row comes too late.
    pub fn next(&mut self, wait: Duration) -> Result<Next> {
        loop {
            if self.advance()? {
                return Ok(Next::Sample);
            }
            if self.add_row()? {
                continue;
            }
            if self.files.iter().all(|file| file.has_ended) {
                self.check_end()?;
                return Ok(Next::End);
            }
            if !self.receive()?
                && let Err(RecvTimeoutError::Timeout) = self.wake.recv_timeout(wait)
            {
                return Ok(Next::Waiting);
            }
        }
    }

    /// Takes a message of each file, and returns whether there was one.
    fn receive(&mut self) -> Result<bool> {
        let mut has_message = false;
        for index in 0..self.files.len() {
            if self.files[index].has_ended || !self.is_wanted(index) {
                continue;
            }
            let message = match self.files[index].receiver.try_recv() {
                Ok(message) => message,
                Err(TryRecvError::Empty) => continue,
                Err(TryRecvError::Disconnected) => {
                    return Err(content("the thread that reads the log has failed"));
                }
            };
            has_message = true;
            match message {
                Message::Opened(opened) => self.files[index].opened = Some(opened),
                Message::Rows(rows) => self.files[index].rows = rows.into_iter(),
                Message::Ended => self.end(index)?,
                Message::Failed(error) => return Err(self.named(index, error)),
            }
            if !self.is_checked && self.files.iter().all(|file| file.opened.is_some()) {
                self.check_signals()?;
                self.is_checked = true;
            }
        }
        Ok(has_message)
    }

    /// Returns whether rows of a file are read: not if those of another one are behind.
    fn is_wanted(&self, index: usize) -> bool {
        let file = &self.files[index];
        if file.opened.is_some() && !self.is_checked {
            // The signals of its rows are known when all files are open.
            return false;
        }
        if self.lateness.is_some() || file.topics.is_empty() {
            return true;
        }
        let clock = |file: &File| {
            let clocks = file.topics.iter().map(|(_, topic, _)| self.topics[*topic].clock(&self.options));
            clocks.fold(f64::INFINITY, f64::min)
        };
        let is_behind =
            |other: &File| !other.has_ended && (other.topics.is_empty() || clock(other) < clock(file));
        let waiting =
            file.topics.iter().map(|(_, topic, _)| self.topics[*topic].waiting()).max().unwrap_or(0);
        waiting.max(self.grid.as_ref().map_or(0, Grid::waiting)) < AHEAD || !self.files.iter().any(is_behind)
    }

    /// Adds the name of a file to its error if there are several.
    fn named(&self, index: usize, error: LogError) -> LogError {
        let path = self.files[index].source.path.display();
        match error {
            LogError::Content(message) if self.files.len() > 1 => content(format!("{path}: {message}")),
            LogError::Undecided { fact, remedies } if self.files.len() > 1 => {
                LogError::Undecided { fact: format!("{path}: {fact}"), remedies }
            }
            LogError::Io(error) if self.files.len() > 1 => {
                std::io::Error::new(error.kind(), format!("{path}: {error}")).into()
            }
            error => error,
        }
    }

    /// Checks that the files have the signals of the formulas, each of them once.
    fn check_signals(&mut self) -> Result<()> {
        if self.options.topic_column.is_some() {
            return Ok(());
        }
        let opened: Vec<&Opened> = self.files.iter().filter_map(|file| file.opened.as_ref()).collect();
        for signal in &self.signals {
            let files = opened.iter().filter(|opened| opened.signals.contains(signal)).count();
            if files > 1 {
                return Err(content(format!("two files have the signal `{}`", visible(signal))));
            }
            if let (0, Some(column)) = (files, opened.iter().find_map(|opened| opened.foreign)) {
                return Err(not_utf8(signal, column));
            }
        }
        let names: Vec<String> = opened.iter().flat_map(|opened| opened.names.clone()).collect();
        for (index, formula) in self.formulas.iter().enumerate() {
            if let Err(error) = formula.check_names(&names) {
                self.unreadable.push((index, error.into()));
            }
        }
        if self.unreadable.len() == self.formulas.len()
            && let Some((_, error)) = self.unreadable.drain(..).next()
        {
            return Err(error);
        }
        self.signals.retain(|signal| opened.iter().any(|opened| opened.signals.contains(signal)));
        self.sample.truncate(self.signals.len());
        if let Some(grid) = &mut self.grid {
            grid.tracks.truncate(self.signals.len());
        }
        let mut topics = Vec::new();
        for (index, file) in self.files.iter_mut().enumerate() {
            let Some(opened) = &file.opened else { continue };
            if opened.signals.is_empty() && (index > 0 || !self.signals.is_empty()) {
                continue;
            }
            let position = |name: &String| self.signals.iter().position(|signal| signal == name);
            let signals = opened.signals.iter().filter_map(position).collect();
            let columns = (0..opened.signals.len()).collect();
            file.topics.push((None, topics.len(), columns));
            topics.push(Topic::new(signals, opened.signals.clone(), opened.counted, opened.time.clone()));
        }
        self.topics = topics;
        for topic in &self.topics {
            check_time(topic, &self.options)?;
        }
        Ok(())
    }

    /// Adds a row that was read, and returns whether there was one. Rows are added one at a time,
    /// so that the samples before a row do not depend on how many rows arrive at once.
    fn add_row(&mut self) -> Result<bool> {
        for index in 0..self.files.len() {
            if let Some(row) = self.files[index].rows.next() {
                self.add(index, row).map_err(|error| self.named(index, error))?;
                return Ok(true);
            }
        }
        Ok(false)
    }

    fn add(&mut self, index: usize, mut row: Row) -> Result<()> {
        let Some(at) = self.topic_of(index, row.topic.as_deref())? else { return Ok(()) };
        let (_, topic, columns) = &self.files[index].topics[at];
        if self.options.topic_column.is_some() {
            row.values = columns.iter().map(|column| row.values[*column]).collect();
        }
        self.topics[*topic].add(row, &self.options, self.lateness)?;
        let waiting = self.topics.iter().map(Topic::waiting).max().unwrap_or(0);
        if waiting.max(self.grid.as_ref().map_or(0, Grid::waiting)) > MAX_WAITING {
            return Err(content(format!("more than {MAX_WAITING} rows wait for a value of another signal")));
        }
        Ok(())
    }

    /// Returns the topic of a row of a file, which is new if a column names it; `None` if no
    /// formula reads it.
    fn topic_of(&mut self, index: usize, name: Option<&str>) -> Result<Option<usize>> {
        let file = &mut self.files[index];
        if let Some(found) = file.topics.iter().position(|(known, ..)| known.as_deref() == name) {
            return Ok(Some(found));
        }
        let (Some(name), Some(opened)) = (name, &file.opened) else { return Ok(None) };
        let mut signals = Vec::new();
        let mut names = Vec::new();
        let mut columns = Vec::new();
        for (column, own) in opened.signals.iter().enumerate() {
            let full = full_name(Some(name), own);
            if let Some(signal) = self.signals.iter().position(|signal| *signal == full) {
                signals.push(signal);
                names.push(full);
                columns.push(column);
            }
        }
        if signals.is_empty() {
            return Ok(None);
        }
        let topic = Topic::new(signals, names, opened.counted, opened.time.clone());
        check_time(&topic, &self.options)?;
        file.topics.push((Some(name.to_owned()), self.topics.len(), columns));
        self.topics.push(topic);
        Ok(Some(file.topics.len() - 1))
    }

    fn end(&mut self, index: usize) -> Result<()> {
        self.files[index].has_ended = true;
        for (_, topic, _) in &self.files[index].topics {
            self.topics[*topic].end(&self.options)?;
        }
        Ok(())
    }

    /// Makes the next sample, and returns whether there is one.
    fn advance(&mut self) -> Result<bool> {
        if !self.has_origin && !self.find_origin() {
            return Ok(false);
        }
        if let Some(lateness) = self.lateness {
            let times = self.topics.iter().map(|topic| topic.latest + topic.shift);
            let before = times.fold(f64::NEG_INFINITY, f64::max) - lateness;
            for topic in self.topics.iter_mut().filter(|topic| !topic.has_ended) {
                topic.order(before - topic.shift, &self.options)?;
            }
        }
        if self.grid.is_some() { self.advance_grid() } else { self.advance_even() }
    }

    /// Finds the common origin of all topics, as soon as each of them has a row.
    fn find_origin(&mut self) -> bool {
        let has_signals = |signal: usize| self.topics.iter().any(|topic| topic.signals.contains(&signal));
        let has_rows =
            |topic: &Topic| topic.waiting() > 0 || topic.time.is_some() && topic.latest > f64::NEG_INFINITY;
        let is_known = self.is_checked
            && !self.topics.is_empty()
            && (0..self.signals.len()).all(has_signals)
            && self.topics.iter().all(has_rows);
        if is_known {
            if let Some(origin) = self.origin() {
                for topic in &mut self.topics {
                    topic.shift = (topic.origin.unwrap_or(0) - origin) as f64 / ATTO;
                }
            }
            self.has_origin = true;
        }
        is_known
    }

    fn advance_grid(&mut self) -> Result<bool> {
        let Some(grid) = &mut self.grid else { return Ok(false) };
        for topic in &mut self.topics {
            grid.take_rows(topic)?;
        }
        let clocks = self.topics.iter().map(|topic| topic.clock(&self.options));
        let mut clock = clocks.fold(f64::INFINITY, f64::min);
        if let Some(lateness) = self.lateness {
            let times = self.topics.iter().map(|topic| topic.latest + topic.shift);
            clock = clock.max((times.fold(f64::NEG_INFINITY, f64::max) - lateness).next_down());
        }
        let Some(time) = grid.next(&self.topics, clock, &mut self.sample)? else {
            return Ok(false);
        };
        (self.time, self.taken) = (Some(time), self.taken + 1);
        self.start = grid.start.unwrap_or(0.0);
        Ok(true)
    }

    /// Takes a row of each topic as a sample.
    fn advance_even(&mut self) -> Result<bool> {
        if self.topics.iter().any(|topic| topic.ready.is_empty()) {
            return Ok(false);
        }
        let mut first = None;
        for index in 0..self.topics.len() {
            let topic = &mut self.topics[index];
            let Some(row) = topic.ready.pop_front() else { return Ok(false) };
            let secs = row.secs + topic.shift;
            if first.is_some_and(|first| first != secs) || (first.is_some() && topic.time.is_none()) {
                return Err(self.different_times());
            }
            if let Some(column) = row.values.iter().position(|value| value.is_nan()) {
                return Err(undecided(
                    [drop_missing()],
                    format!(
                        "{}: `{}` has no earlier value to hold",
                        topic.counted.text(row.number),
                        visible(&topic.names[column])
                    ),
                ));
            }
            if let (None, Some(period), Some(column)) = (first, self.options.period, &topic.time) {
                let before = self.steps.last();
                if !self.steps.add(secs, topic.rounding, period) {
                    return Err(undecided(
                        [resample()],
                        format!(
                            "samples must be evenly spaced; column `{column}` steps from {} to {} in {}, and the period is {}",
                            number_text(before),
                            number_text(secs),
                            topic.counted.text(row.number),
                            number_text(period)
                        ),
                    ));
                }
            }
            first = Some(secs);
            for (signal, value) in topic.signals.iter().zip(&row.values) {
                self.sample[*signal] = *value;
            }
        }
        let has_times = self.topics.iter().any(|topic| topic.time.is_some());
        let secs = first.filter(|_| has_times);
        if self.taken == 0 {
            self.start = secs.unwrap_or(0.0);
        }
        self.time = match self.options.period {
            Some(period) => Some(self.start + self.taken as f64 * period),
            None => secs,
        };
        self.taken += 1;
        Ok(true)
    }

    fn different_times(&self) -> LogError {
        undecided([resample_to_period()], "the topics of the formula have different times")
    }

    /// Checks what only the end shows.
    fn check_end(&self) -> Result<()> {
        let has = |signal: usize| self.topics.iter().any(|topic| topic.signals.contains(&signal));
        if let (true, Some(signal)) = (self.is_checked, (0..self.signals.len()).find(|signal| !has(*signal)))
        {
            return Err(content(format!("no row has the signal `{}`", visible(&self.signals[signal]))));
        }
        for topic in &self.topics {
            if topic.is_empty() {
                return Err(content("the file has a header, but no samples"));
            }
            topic.check_values()?;
        }
        if let Some(grid) = &self.grid {
            grid.check_end(&self.topics)?;
        } else if self.topics.iter().any(|topic| !topic.ready.is_empty()) {
            return Err(self.different_times());
        }
        match self.taken {
            0 => Err(content("no row of the log remains")),
            _ => Ok(()),
        }
    }
}

/// Checks the choices.
fn check(formulas: &[Formula], options: &Options, following: Following) -> Result<()> {
    if let Sampling::Dense(_) = options.sampling {
        return Err(undecided([resample_to_period()], "a log that is still written has no dense time"));
    }
    let has_lateness = following.lateness.is_some();
    if options.sort && !has_lateness {
        return Err(undecided(
            [Remedy::set(Key::LATENESS, Choice::SECONDS)],
            "sorting a log that is still written needs the lateness: how much too late a row can come",
        ));
    }
    if has_lateness && !options.sort && options.sampling == Sampling::Even {
        return Err(undecided(
            [resample(), Remedy::set(Key::LOG_SORT, Choice::On)],
            "the lateness needs resampling or sorting",
        ));
    }
    if options.period.is_none() && formulas.iter().any(|formula| formula.needs_period(false)) {
        return Err(needs_period());
    }
    Ok(())
}

/// Returns the error for a bound that is a time, without a period.
fn needs_period() -> LogError {
    undecided(
        [state_period()],
        "a bound of the formula is a time, and the steps of a log are known when it has ended",
    )
}

fn check_time(topic: &Topic, options: &Options) -> Result<()> {
    if topic.time.is_some() || options.sampling == Sampling::Even && !options.sort {
        return Ok(());
    }
    Err(undecided([name_time()], "resampling and sorting need the times of the samples"))
}
