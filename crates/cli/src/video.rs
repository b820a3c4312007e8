//! Videos, encoded by the program `ffmpeg` from raw frames.

use std::io::{ErrorKind, Read, Write};
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, Stdio};

use anyhow::{Context, Error, Result, bail};
use mishandle::files::AtomicFile;
use mishandle::world::Size;

const ENCODER: &str = "ffmpeg";

/// A video that is being encoded. Dropping it before [`finish`](Video::finish) removes the file.
pub struct Video {
    // Dropped in this order: the encoder ends before its file is removed.
    encoder: Encoder,
    file: AtomicFile,
}

/// The process of the encoder. Dropping it kills the process.
struct Encoder {
    process: Child,
}

impl Drop for Encoder {
    fn drop(&mut self) {
        // Errors are ignored: the process may have ended already, and its output is discarded.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Checks that the encoder is installed.
pub fn check_encoder() -> Result<()> {
    let version = Command::new(ENCODER).arg("-version").stdout(Stdio::null()).stderr(Stdio::null()).status();
    version.map(drop).map_err(cannot_run)
}

fn cannot_run(error: std::io::Error) -> Error {
    match error.kind() {
        ErrorKind::NotFound => Error::msg(
            "a video needs the program `ffmpeg`, which is not on PATH (on Debian and Ubuntu: apt install ffmpeg); a \
             filmstrip (--out FILE.png) does not need it",
        ),
        _ => Error::new(error).context("cannot run ffmpeg"),
    }
}

impl Video {
    /// Starts a video with `rate` frames per second.
    pub fn start(file: AtomicFile, size: Size, rate: f64) -> Result<Video> {
        let process = Command::new(ENCODER)
            .process_group(0) // so that Ctrl-C in the terminal does not reach the encoder
            .args(["-loglevel", "error", "-y", "-f", "rawvideo", "-pixel_format", "rgb24"])
            .args(["-video_size", &format!("{}x{}", size.width(), size.height())])
            .args(["-framerate", &rate.to_string(), "-i", "pipe:0"])
            .args(["-pix_fmt", "yuv420p", "-movflags", "+faststart", "-f", "mp4"])
            .arg(file.temporary_path())
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(cannot_run)?;
        Ok(Video { encoder: Encoder { process }, file })
    }

    /// Appends a frame of 8-bit RGB pixels.
    pub fn push_frame(&mut self, pixels: &[u8]) -> Result<()> {
        let written = self.encoder.process.stdin.as_mut().map_or(Ok(()), |pipe| pipe.write_all(pixels));
        match written {
            Err(error) if error.kind() == ErrorKind::BrokenPipe => self.close(),
            written => written.context("cannot write to ffmpeg"),
        }
    }

    /// Finishes the video.
    pub fn finish(mut self) -> Result<()> {
        self.close()?;
        self.file.persist().context("cannot write the video")
    }

    /// Waits for the encoder, and returns its messages as an error if it fails.
    fn close(&mut self) -> Result<()> {
        let encoder = &mut self.encoder.process;
        drop(encoder.stdin.take());
        let mut messages = String::new();
        if let Some(stderr) = &mut encoder.stderr {
            stderr.read_to_string(&mut messages)?;
        }
        let status = encoder.wait()?;
        if !status.success() {
            bail!("ffmpeg failed with {status}: {}", messages.trim().replace('\n', "; "));
        }
        Ok(())
    }
}
