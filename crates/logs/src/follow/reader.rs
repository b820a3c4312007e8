//! The thread that reads a file: it opens it, and sends its rows whenever it would wait for more.

use std::cell::RefCell;
use std::io::{self, Read};
use std::rc::Rc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use super::Following;
use super::tail::Tail;
use crate::cell::{Row, Sink};
use crate::error::{LogError, Result, content};
use crate::json_lines::JsonHead;
use crate::log::{Input, OpenLog, Source};
use crate::options::{Missing, Options};
use crate::place::Counted;
use crate::table::retried;

/// Largest number of rows that are sent at once.
const BATCH: usize = 4096;

/// Number of batches that wait until they are taken; then the thread waits, too.
const WAITING: usize = 4;

/// A message of a thread.
pub(super) enum Message {
    /// The file is open.
    Opened(Opened),
    Rows(Vec<Row>),
    /// The file has no more rows.
    Ended,
    /// The file cannot be read further.
    Failed(LogError),
}

/// The facts about a file before its first row.
pub(super) struct Opened {
    /// The names of all columns, as a formula reads them.
    pub(super) names: Vec<String>,
    /// The signals that the values of a row are those of; the names of columns without the topic if
    /// a column names the topics.
    pub(super) signals: Vec<String>,
    pub(super) counted: Counted,
    /// The column with the times.
    pub(super) time: Option<String>,
    /// The error of the first column whose name is not UTF-8, for a signal that no file has.
    pub(super) foreign: Option<usize>,
}

/// Starts the thread of a file, which reads `input` if it is given, and returns the channel of its
/// messages. The thread ends if the channel is dropped, and the program need not wait for it.
pub(super) fn start(
    source: Source,
    input: Option<Box<dyn Read + Send>>,
    signals: Vec<String>,
    options: Options,
    following: Following,
    is_first: bool,
    wake: SyncSender<()>,
) -> Receiver<Message> {
    let (sender, receiver) = sync_channel(WAITING);
    std::thread::spawn(move || {
        let batch = Rc::new(RefCell::new(Batch { rows: Vec::new(), sender, wake }));
        let read = read(&source, input, &signals, &options, following, is_first, &batch);
        let end = read.err().map_or(Message::Ended, Message::Failed);
        batch.borrow().send(end);
    });
    receiver
}

/// Rows that are sent together.
struct Batch {
    rows: Vec<Row>,
    sender: SyncSender<Message>,
    /// Wakes the receiver of all files, because a message waits.
    wake: SyncSender<()>,
}

impl Batch {
    /// Sends a message, and returns whether somebody takes it.
    fn send(&self, message: Message) -> bool {
        let is_taken = self.sender.send(message).is_ok();
        // A wake-up that waits is enough.
        let _ = self.wake.try_send(());
        is_taken
    }

    fn flush(&mut self) -> bool {
        if self.rows.is_empty() {
            return true;
        }
        let rows = std::mem::take(&mut self.rows);
        self.send(Message::Rows(rows))
    }
}

/// Sends the rows so far before it reads on, which can take long.
struct Handing {
    source: Box<dyn Read>,
    batch: Rc<RefCell<Batch>>,
}

impl Read for Handing {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if !self.batch.borrow_mut().flush() {
            return Err(io::Error::other("nobody takes the rows"));
        }
        retried(|| self.source.read(buffer))
    }
}

fn read(
    source: &Source,
    live: Option<Box<dyn Read + Send>>,
    signals: &[String],
    options: &Options,
    following: Following,
    is_first: bool,
    batch: &Rc<RefCell<Batch>>,
) -> Result<()> {
    let wrapped = |input: Input| -> Box<dyn Read> {
        let source: Box<dyn Read> = match input {
            Input::Stdin => match live {
                Some(live) => live,
                None => Box::new(io::stdin()),
            },
            Input::File(file) if file.metadata().is_ok_and(|found| found.is_file()) => {
                Box::new(Tail::new(file, source.path.clone(), following.idle))
            }
            Input::File(file) => Box::new(file),
        };
        Box::new(Handing { source, batch: batch.clone() })
    };
    let more = later_fields(source, signals, options);
    let mut log = OpenLog::open_live(source, options, &JsonHead { lines: 1, more: &more }, wrapped)?;
    let signals: Vec<&str> = signals.iter().map(String::as_str).collect();
    let mut sinks = match &options.topic_column {
        Some(column) => log.split_sinks(Some(&signals), column)?,
        None => {
            let mut requested = Vec::new();
            for signal in &signals {
                requested.extend(log.place_of(signal)?.map(|(_, column)| (column, *signal)));
            }
            log.sinks(0, &requested)?
        }
    };
    let counted = sinks.places.counted();
    let mut opened = Opened {
        names: log.names().to_vec(),
        signals: Vec::new(),
        counted,
        time: None,
        foreign: log.foreign(),
    };
    for (_, sink) in &sinks.columns {
        match sink {
            Sink::Values(values) if values.name.is_empty() => {}
            Sink::Values(values) => opened.signals.push(values.name.clone()),
            Sink::Times(times) => opened.time = Some(times.name().to_owned()),
            Sink::Nanoseconds(_) | Sink::Topics(_) => {}
        }
    }
    // Without signals, the rows of the first file count.
    let is_read = !opened.signals.is_empty() || (signals.is_empty() && is_first);
    if counted != Counted::Lines {
        return Err(content(
            "only CSV and JSON lines can be followed; files of this format are read when they are complete",
        ));
    }
    if !batch.borrow().send(Message::Opened(opened)) || !is_read {
        return Ok(());
    }
    let rows = batch.clone();
    sinks.each = Some(Box::new(move |row| {
        let mut batch = rows.borrow_mut();
        batch.rows.push(row);
        if batch.rows.len() < BATCH || batch.flush() { Ok(()) } else { Err(content("nobody takes the rows")) }
    }));
    let read = log.take(0).read(&mut sinks);
    // Also the rows before an error.
    batch.borrow_mut().flush();
    read
}

/// Returns the fields of JSON lines that the first line may lack: those of other topics, and those
/// that can be missing.
fn later_fields(source: &Source, signals: &[String], options: &Options) -> Vec<String> {
    let mut found = Vec::new();
    for signal in signals {
        match (&options.topic_column, &source.topic) {
            (Some(_), _) => {
                let slashes = signal.char_indices().filter(|(at, letter)| *at > 0 && *letter == '/');
                found.extend(slashes.map(|(at, _)| signal[at + 1..].to_owned()));
            }
            (None, _) if options.missing == Missing::Error => {}
            (None, Some(topic)) => {
                let rest = signal.strip_prefix(topic.as_str()).and_then(|rest| rest.strip_prefix('/'));
                found.extend(rest.map(str::to_owned));
            }
            (None, None) => found.push(signal.clone()),
        }
    }
    found
}
