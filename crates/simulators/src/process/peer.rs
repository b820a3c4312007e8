//! One running program.

use std::io::{ErrorKind, Read, Write};
use std::ops::ControlFlow;
use std::process::{ChildStderr, ChildStdin, ChildStdout, Stdio};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use rustix::event::PollFlags;
use rustix::io::ioctl_fionbio;

use crate::process::Failure;
use crate::process::job::{Job, Program};
use crate::process::lines::{Lines, NoLine, ready};

/// Length of the end of the standard error that is kept, bytes.
const KEPT: usize = 2000;

/// Size of the largest output of a program that gets its whole input at once, bytes.
const LONGEST_OUTPUT: usize = 1 << 20;

/// Time that a program has to end by itself after its input is closed.
const GRACE: Duration = Duration::from_millis(200);

/// Longest time between two questions whether to go on waiting.
const PART: Duration = Duration::from_millis(100);

/// Result of a program that got its whole input at once.
#[derive(Clone, Debug)]
pub struct Output {
    /// Its exit code; `None` if a signal ended it.
    pub code: Option<i32>,
    /// All of its standard output.
    pub stdout: String,
    /// Last lines of its standard error.
    pub stderr: String,
}

/// A running program that answers line by line.
pub struct Peer {
    job: Job,
    /// Closed when the program is dropped.
    stdin: Option<ChildStdin>,
    stdout: Lines<ChildStdout>,
    stderr: Arc<Mutex<Vec<u8>>>,
    /// Disconnected when the standard error has been read to its end.
    stderr_end: Receiver<()>,
    has_failed: bool,
}

impl Peer {
    /// Starts a program in a process group of its own, so that Ctrl-C reaches it only through this
    /// process.
    ///
    /// # Errors
    /// If it cannot be started.
    pub fn start(program: &Program) -> Result<Peer, Failure> {
        let mut job = Job::start(program, [Stdio::piped(), Stdio::piped(), Stdio::piped()])?;
        let failed = |source| Failure::start(program, source);
        let pipes = (job.child.stdin.take(), job.child.stdout.take(), job.child.stderr.take());
        let (Some(stdin), Some(stdout), Some(pipe)) = pipes else {
            return Err(failed(std::io::Error::other("it has no pipes")));
        };
        // A question longer than the pipe must not wait forever for a program that does not read.
        ioctl_fionbio(&stdin, true).map_err(|error| failed(error.into()))?;
        let stderr = Arc::new(Mutex::new(Vec::new()));
        let kept = stderr.clone();
        let (reads, stderr_end) = channel();
        std::thread::spawn(move || {
            keep_end(pipe, &kept);
            drop::<Sender<()>>(reads);
        });
        let stdout = Lines::new(stdout);
        Ok(Peer { job, stdin: Some(stdin), stdout, stderr, stderr_end, has_failed: false })
    }

    /// Sends a line without its end, and returns the line that answers it.
    ///
    /// # Errors
    /// If the program ended, took too long or wrote more than one line. The program is ended then,
    /// and further questions fail.
    pub fn ask(&mut self, line: &str, limit: Duration) -> Result<String, Failure> {
        let answer = self.converse(line, limit);
        if answer.is_err() {
            self.has_failed = true;
            self.kill();
        }
        answer
    }

    fn converse(&mut self, line: &str, limit: Duration) -> Result<String, Failure> {
        if self.has_failed {
            return Err(Failure::Ended { stderr: self.stderr() });
        }
        if self.stdout.has_more() {
            // It would be taken for the answer to this question.
            let next = self.stdout.next(Instant::now());
            return Err(match next {
                Err(NoLine::Ended) => self.ended(),
                _ => self.malformed("an answer before the question"),
            });
        }
        let end = Instant::now() + limit;
        match self.stdin.as_mut().map(|stdin| write_line(stdin, line, end)) {
            Some(Ok(true)) => {}
            Some(Ok(false)) => return Err(self.timed_out(limit)),
            _ => return Err(self.ended()),
        }
        match self.stdout.next(end) {
            Ok(bytes) => self.text(bytes),
            Err(NoLine::Ended) => Err(self.ended()),
            Err(NoLine::TimedOut) => Err(self.timed_out(limit)),
            Err(NoLine::TooLong) => Err(self.malformed("a line of more than 256 MiB")),
        }
    }

    fn text(&self, bytes: Vec<u8>) -> Result<String, Failure> {
        String::from_utf8(bytes).map_err(|_| self.malformed("bytes that are not UTF-8 text"))
    }

    /// Sends bytes, closes the input of the program, and returns what it wrote until its end. A
    /// program that waits for a reader of its output before it has read its input takes too long.
    /// `watch` is asked during the wait, and can stop it.
    ///
    /// # Errors
    /// If the program took too long, or wrote more than 1 MiB or something else than text, or if
    /// `watch` stopped the wait. The program is ended then.
    pub fn finish(
        mut self,
        mut input: &[u8],
        limit: Duration,
        mut watch: impl FnMut() -> ControlFlow<()>,
    ) -> Result<Output, Failure> {
        let end = Instant::now() + limit;
        // Returns the end of the next part of the wait.
        let mut part = |peer: &Peer| match (watch(), Instant::now()) {
            (ControlFlow::Break(()), _) => Err(Failure::Interrupted),
            (_, now) if now < end => Ok(end.min(now + PART)),
            _ => Err(peer.timed_out(limit)),
        };
        loop {
            let until = part(&self)?;
            // A program that ends before it has read all says why in its output and its status.
            let written = self.stdin.as_mut().map(|stdin| write(stdin, &mut input, until));
            if !matches!(written, Some(Ok(false))) {
                break;
            }
        }
        self.stdin = None;
        let stdout = loop {
            let until = part(&self)?;
            match self.stdout.rest(LONGEST_OUTPUT, until) {
                Ok(bytes) => break self.text(bytes)?,
                Err(NoLine::TooLong) => return Err(self.malformed("more than 1 MiB")),
                Err(NoLine::TimedOut | NoLine::Ended) => {}
            }
        };
        while !self.job.wait(PART) {
            part(&self)?;
        }
        self.kill();
        let code = self.job.child.wait().ok().and_then(|status| status.code());
        let _ = self.stderr_end.recv_timeout(GRACE);
        Ok(Output { code, stdout, stderr: self.stderr() })
    }

    /// Returns whether the program has written something since its last answer.
    pub fn has_unread(&mut self) -> bool {
        self.stdout.has_more()
    }

    /// Closes the input of the program, and returns whether it ends by itself within a time limit.
    pub fn close(mut self, limit: Duration) -> bool {
        self.stdin = None;
        self.job.wait(limit)
    }

    fn timed_out(&self, limit: Duration) -> Failure {
        Failure::TimedOut { limit, stderr: self.stderr() }
    }

    fn malformed(&self, what: &str) -> Failure {
        Failure::Malformed { what: what.to_string(), stderr: self.stderr() }
    }

    /// Waits for the last words of the program.
    fn ended(&mut self) -> Failure {
        self.job.wait(GRACE);
        // A child of the program may keep the pipe open.
        let _ = self.stderr_end.recv_timeout(GRACE);
        Failure::Ended { stderr: self.stderr() }
    }

    /// Returns the end of what the program wrote to its standard error.
    pub fn stderr(&self) -> String {
        let bytes = self.stderr.lock().unwrap_or_else(PoisonError::into_inner);
        String::from_utf8_lossy(&bytes).into_owned()
    }

    /// Ends the program and its process group.
    fn kill(&mut self) {
        self.stdin = None;
        self.job.kill();
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        self.stdin = None;
        // A program that reads its input to the end may save something first.
        if !self.has_failed {
            self.job.wait(GRACE);
        }
        self.kill();
    }
}

/// Writes a line into a pipe that does not block, until `end`; returns whether all of it was
/// written.
fn write_line(pipe: &mut ChildStdin, line: &str, end: Instant) -> std::io::Result<bool> {
    Ok(write(pipe, &mut line.as_bytes(), end)? && write(pipe, &mut &b"\n"[..], end)?)
}

/// Writes bytes into a pipe that does not block, until `end`, and leaves those that it has not
/// written; returns whether all of them were written.
fn write(pipe: &mut ChildStdin, bytes: &mut &[u8], end: Instant) -> std::io::Result<bool> {
    while !bytes.is_empty() {
        match pipe.write(bytes) {
            Ok(0) => return Err(ErrorKind::WriteZero.into()),
            Ok(count) => *bytes = &bytes[count..],
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) if error.kind() == ErrorKind::WouldBlock => {
                if !ready(&*pipe, PollFlags::OUT, end)? {
                    return Ok(false);
                }
            }
            Err(error) => return Err(error),
        }
    }
    Ok(true)
}

/// Reads a pipe to its end, so that its writer never waits, and keeps the last bytes.
fn keep_end(mut pipe: ChildStderr, kept: &Mutex<Vec<u8>>) {
    let mut buffer = [0; 4096];
    while let Ok(count @ 1..) = pipe.read(&mut buffer) {
        let mut kept = kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.extend_from_slice(&buffer[..count]);
        let excess = kept.len().saturating_sub(KEPT);
        kept.drain(..excess);
    }
}
