//! Lines from a pipe, with a time limit.

use std::io::{BufRead, ErrorKind, Read};
use std::os::fd::AsFd;
use std::time::Instant;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;

/// Length of the longest line, bytes.
pub const LONGEST: usize = 256 << 20;

/// Reads lines of a pipe.
pub(crate) struct Lines<R> {
    pipe: R,
    /// Bytes that were read and not returned yet.
    bytes: Vec<u8>,
    /// Number of bytes of `bytes` without the end of a line.
    searched: usize,
}

/// Why there is no line.
pub(crate) enum NoLine {
    Ended,
    TimedOut,
    TooLong,
}

impl<R: Read + AsFd> Lines<R> {
    pub(crate) fn new(pipe: R) -> Lines<R> {
        Lines { pipe, bytes: Vec::new(), searched: 0 }
    }

    /// Returns whether bytes after the last line have arrived.
    pub(crate) fn has_more(&mut self) -> bool {
        !self.bytes.is_empty() || matches!(ready(&self.pipe, PollFlags::IN, Instant::now()), Ok(true))
    }

    /// Waits for the next line until `end`, and returns it without its end.
    pub(crate) fn next(&mut self, end: Instant) -> Result<Vec<u8>, NoLine> {
        loop {
            // As fast as `memchr`, which the library keeps to itself: an answer can be long.
            let found = (&self.bytes[self.searched..]).skip_until(b'\n').unwrap_or_default();
            if found > 0 && self.bytes[self.searched + found - 1] == b'\n' {
                let rest = self.bytes.split_off(self.searched + found);
                let mut line = std::mem::replace(&mut self.bytes, rest);
                self.searched = 0;
                line.pop();
                return Ok(line);
            }
            self.searched = self.bytes.len();
            self.read(LONGEST, end)?;
        }
    }

    /// Waits for the end of the pipe until `end`, and returns all bytes, of which there may be
    /// `most`.
    pub(crate) fn rest(&mut self, most: usize, end: Instant) -> Result<Vec<u8>, NoLine> {
        loop {
            match self.read(most, end) {
                Ok(()) => {}
                Err(NoLine::Ended) => return Ok(std::mem::take(&mut self.bytes)),
                Err(error) => return Err(error),
            }
        }
    }

    /// Waits for more bytes until `end`, unless there are more than `most`.
    fn read(&mut self, most: usize, end: Instant) -> Result<(), NoLine> {
        let mut buffer = [0; 1 << 16];
        if self.bytes.len() > most {
            return Err(NoLine::TooLong);
        }
        if !ready(&self.pipe, PollFlags::IN, end).map_err(|_| NoLine::Ended)? {
            return Err(NoLine::TimedOut);
        }
        match self.pipe.read(&mut buffer) {
            Ok(0) => return Err(NoLine::Ended),
            Ok(count) => self.bytes.extend_from_slice(&buffer[..count]),
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(_) => return Err(NoLine::Ended),
        }
        Ok(())
    }
}

/// Waits until a pipe has bytes or room, or is closed; returns whether that came before `end`.
pub(crate) fn ready(pipe: &impl AsFd, flags: PollFlags, end: Instant) -> Result<bool, Errno> {
    loop {
        let left = end.saturating_duration_since(Instant::now());
        let timeout = Timespec {
            tv_sec: left.as_secs().try_into().unwrap_or(i64::MAX),
            tv_nsec: left.subsec_nanos().into(),
        };
        match poll(&mut [PollFd::new(pipe, flags)], Some(&timeout)) {
            Ok(count) => return Ok(count > 0),
            Err(Errno::INTR) => {}
            Err(error) => return Err(error),
        }
    }
}
