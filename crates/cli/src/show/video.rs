//! Videos, encoded by the program `ffmpeg` from raw frames.
//!
//! Whatever the encoder does, the video's name appears only if the encoder took all frames, ended
//! without an error and wrote a complete MP4 file. It writes to the temporary file by its
//! descriptor, so it cannot write to any other file.

mod film;
#[cfg(test)]
mod tests;

use std::io::{self, ErrorKind, Read, Write};
use std::ops::ControlFlow;
use std::os::unix::process::CommandExt;
use std::process::{Child, ChildStderr, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context, Error, Result, bail};
use mishandle::files::AtomicFile;
use mishandle_text::plural;
use rustix::process::{Pid, Signal, kill_process_group};

use crate::interrupt;

const ENCODER: &str = "ffmpeg";

/// The encoder is stopped if it makes no progress for this long.
const PATIENCE: Duration = Duration::from_secs(30);

/// Interval at which signals and the encoder are checked.
const POLL: Duration = Duration::from_millis(20);

/// Largest number of bytes of the encoder's messages that an error contains.
const MESSAGE_BYTES: usize = 2000;

/// A video that is being encoded. Dropping it before [`finish`](Video::finish) removes the file.
pub struct Video {
    // Dropped in this order: the encoder ends before its file is removed.
    encoder: Encoder,
    file: AtomicFile,
    frames: Sender<Vec<u8>>,
    /// The result of writing each frame.
    written: Receiver<io::Result<()>>,
    /// Number of frames that the encoder took.
    count: usize,
    patience: Duration,
}

/// The process of the encoder. Dropping it kills the process and its children.
struct Encoder {
    process: Child,
    /// The start of what the encoder wrote to its standard error.
    messages: Arc<Mutex<Vec<u8>>>,
    /// Reads the standard error, so that the encoder does not block on it.
    reader: JoinHandle<()>,
}

impl Drop for Encoder {
    fn drop(&mut self) {
        // Errors are ignored: the process may have ended already, and its output is discarded.
        if let (Ok(None), Some(group)) = (self.process.try_wait(), Pid::from_raw(self.process.id() as i32)) {
            let _ = kill_process_group(group, Signal::KILL);
        }
        let _ = self.process.wait();
    }
}

/// Checks that the encoder is installed.
pub fn check_encoder() -> Result<()> {
    check(ENCODER, PATIENCE)
}

fn check(program: &str, patience: Duration) -> Result<()> {
    let mut version = Command::new(program);
    version.arg("-version").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    let mut process = version.spawn().map_err(cannot_run)?;
    let start = Instant::now();
    while process.try_wait()?.is_none() {
        if start.elapsed() > patience {
            process.kill()?;
            process.wait()?;
            bail!("`{ENCODER} -version` did not end within {} s", patience.as_secs_f64());
        }
        std::thread::sleep(POLL);
    }
    Ok(())
}

fn cannot_run(error: io::Error) -> Error {
    match error.kind() {
        ErrorKind::NotFound => Error::msg(
            "a video needs the program `ffmpeg`, which is not on PATH (on Debian and Ubuntu: apt install ffmpeg); a \
             filmstrip (--out FILE.png) does not need it",
        ),
        _ => Error::new(error).context("cannot run ffmpeg"),
    }
}

impl Video {
    /// Starts a video of frames with this width and height and `rate` frames per second.
    pub fn start(file: AtomicFile, size: (usize, usize), rate: f64) -> Result<Video> {
        Video::start_with(ENCODER, PATIENCE, file, size, rate)
    }

    fn start_with(
        program: &str,
        patience: Duration,
        file: AtomicFile,
        size: (usize, usize),
        rate: f64,
    ) -> Result<Video> {
        let output = file.file().try_clone()?;
        let mut process = Command::new(program)
            .process_group(0) // so that Ctrl-C in the terminal does not reach the encoder
            .args(["-loglevel", "error", "-y", "-f", "rawvideo", "-pixel_format", "rgb24"])
            .args(["-video_size", &format!("{}x{}", size.0, size.1)])
            .args(["-framerate", &rate.to_string(), "-i", "pipe:0"])
            // The encoder opens its standard output by this name, and can seek in it.
            .args(["-pix_fmt", "yuv420p", "-movflags", "+faststart", "-f", "mp4", "/dev/fd/1"])
            .stdin(Stdio::piped())
            .stdout(output)
            .stderr(Stdio::piped())
            .spawn()
            .map_err(cannot_run)?;
        let messages = Arc::new(Mutex::new(Vec::new()));
        let stdin = process.stdin.take();
        let stderr = process.stderr.take();
        let kept = messages.clone();
        let reader = std::thread::spawn(move || drain(stderr, &kept));
        let (frames, queue) = channel();
        let (results, written) = channel();
        std::thread::spawn(move || write_frames(stdin, &queue, &results));
        Ok(Video {
            encoder: Encoder { process, messages, reader },
            file,
            frames,
            written,
            count: 0,
            patience,
        })
    }

    /// Appends a frame of 8-bit RGB pixels. Returns `Break` if a signal interrupts it.
    pub fn push_frame(&mut self, pixels: &[u8]) -> Result<ControlFlow<()>> {
        // Fails only if the thread has ended; then there is no result either.
        let _ = self.frames.send(pixels.to_vec());
        let start = Instant::now();
        loop {
            match self.written.recv_timeout(POLL) {
                Ok(Ok(())) => break,
                Ok(Err(error)) if error.kind() == ErrorKind::BrokenPipe => {
                    return self.report_early_end();
                }
                Ok(Err(error)) => return Err(Error::new(error).context("cannot write to ffmpeg")),
                Err(RecvTimeoutError::Disconnected) => return self.report_early_end(),
                Err(RecvTimeoutError::Timeout) => {}
            }
            if interrupt::control_flow().is_break() {
                return Ok(ControlFlow::Break(()));
            }
            if start.elapsed() > self.patience {
                let secs = self.patience.as_secs_f64();
                bail!("ffmpeg took no data for {secs} s and was stopped{}", self.encoder.messages());
            }
        }
        self.count += 1;
        Ok(ControlFlow::Continue(()))
    }

    /// Finishes the video. Returns `Break` if a signal interrupts it.
    pub fn finish(mut self) -> Result<ControlFlow<()>> {
        // Closes the input of the encoder.
        self.frames = channel().0;
        let Some(status) = self.wait()? else { return Ok(ControlFlow::Break(())) };
        if !status.success() {
            bail!("ffmpeg failed with {status}{}", self.encoder.messages());
        }
        if let Err(problem) = film::check(self.file.file())? {
            bail!("ffmpeg did not write a complete video: {problem}{}", self.encoder.messages());
        }
        self.file.persist().context("cannot write the video")?;
        Ok(ControlFlow::Continue(()))
    }

    /// Waits until the encoder ends; `None` if a signal interrupts it.
    fn wait(&mut self) -> Result<Option<ExitStatus>> {
        let mut progress = Instant::now();
        let mut length = 0;
        loop {
            if let Some(status) = self.encoder.process.try_wait()? {
                return Ok(Some(status));
            }
            if interrupt::control_flow().is_break() {
                return Ok(None);
            }
            // Encoding the frames in its queue can take long; the file then grows.
            let found = self.file.file().metadata()?.len();
            if found != length {
                (progress, length) = (Instant::now(), found);
            }
            if progress.elapsed() > self.patience {
                let secs = self.patience.as_secs_f64();
                bail!("ffmpeg did not end for {secs} s and was stopped{}", self.encoder.messages());
            }
            std::thread::sleep(POLL);
        }
    }

    /// Returns the error of an encoder that closes its input before the last frame.
    fn report_early_end(&mut self) -> Result<ControlFlow<()>> {
        let Some(status) = self.wait()? else { return Ok(ControlFlow::Break(())) };
        let count = self.count;
        let messages = self.encoder.messages();
        if status.success() {
            bail!("ffmpeg ended after {}, before the last{messages}", plural(count, "frame"));
        }
        bail!("ffmpeg failed with {status}{messages}");
    }
}

impl Encoder {
    /// Returns the messages of the encoder in one line, after a colon; empty without messages.
    fn messages(&self) -> String {
        // A child of the encoder can keep the pipe open after the encoder ends.
        let start = Instant::now();
        while !self.reader.is_finished() && start.elapsed() < Duration::from_secs(1) {
            std::thread::sleep(POLL);
        }
        let messages = self.messages.lock().unwrap_or_else(PoisonError::into_inner);
        let text = String::from_utf8_lossy(&messages);
        let lines: Vec<&str> = text.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
        if lines.is_empty() { String::new() } else { format!(": {}", lines.join("; ")) }
    }
}

/// Writes the frames of the queue to the encoder until the queue ends, and reports the result of
/// each.
fn write_frames(stdin: Option<ChildStdin>, queue: &Receiver<Vec<u8>>, results: &Sender<io::Result<()>>) {
    let Some(mut stdin) = stdin else { return };
    for frame in queue {
        let written = stdin.write_all(&frame);
        let failed = written.is_err();
        if results.send(written).is_err() || failed {
            return;
        }
    }
}

/// Reads everything that the encoder writes to its standard error and keeps the start.
fn drain(stderr: Option<ChildStderr>, kept: &Mutex<Vec<u8>>) {
    let Some(mut stderr) = stderr else { return };
    let mut buffer = [0; 8192];
    loop {
        match stderr.read(&mut buffer) {
            Ok(0) => return,
            Ok(count) => {
                let mut kept = kept.lock().unwrap_or_else(PoisonError::into_inner);
                let room = MESSAGE_BYTES - kept.len();
                kept.extend_from_slice(&buffer[..count.min(room)]);
            }
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(_) => return,
        }
    }
}
