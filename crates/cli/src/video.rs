//! Films, made by the program `ffmpeg` from raw pictures.

use std::io::{ErrorKind, Read, Write};
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, Stdio};

use anyhow::{Context, Error, Result, bail};
use mishandle::files::AtomicFile;
use mishandle::world::Size;

const ENCODER: &str = "ffmpeg";

/// A film in the making; dropped before its end, it is gone.
pub struct Video {
    // In this order: the encoder has ended before its file is taken away.
    encoder: Encoder,
    file: AtomicFile,
}

/// The encoder's process, which does not outlive this.
struct Encoder {
    process: Child,
}

impl Drop for Encoder {
    fn drop(&mut self) {
        // It may have ended already, and what it makes is wanted no more.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Fails if there is no encoder.
pub fn check_encoder() -> Result<()> {
    let version = Command::new(ENCODER).arg("-version").stdout(Stdio::null()).stderr(Stdio::null()).status();
    version.map(drop).map_err(cannot_run)
}

fn cannot_run(error: std::io::Error) -> Error {
    match error.kind() {
        ErrorKind::NotFound => Error::msg(
            "a film takes the program `ffmpeg`, which is not on PATH (on Debian and Ubuntu: apt install ffmpeg); a \
             filmstrip, --out FILE.png, does without",
        ),
        _ => Error::new(error).context("cannot run ffmpeg"),
    }
}

impl Video {
    /// Begins a film of so many pictures a second.
    pub fn begin(file: AtomicFile, size: Size, rate: f64) -> Result<Video> {
        let process = Command::new(ENCODER)
            .process_group(0) // a Ctrl-C typed in the terminal is for this program alone
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

    /// Appends a picture.
    pub fn push(&mut self, pixels: &[u8]) -> Result<()> {
        let written = self.encoder.process.stdin.as_mut().map_or(Ok(()), |pipe| pipe.write_all(pixels));
        match written {
            Err(error) if error.kind() == ErrorKind::BrokenPipe => self.close(),
            written => written.context("cannot write to ffmpeg"),
        }
    }

    /// Ends the film.
    pub fn end(mut self) -> Result<()> {
        self.close()?;
        self.file.persist().context("cannot write the film")
    }

    /// Waits for the encoder to end, which it should without complaint.
    fn close(&mut self) -> Result<()> {
        let encoder = &mut self.encoder.process;
        drop(encoder.stdin.take());
        let mut said = String::new();
        if let Some(stderr) = &mut encoder.stderr {
            stderr.read_to_string(&mut said)?;
        }
        let status = encoder.wait()?;
        if !status.success() {
            bail!("ffmpeg ended with {status}: {}", said.trim().replace('\n', "; "));
        }
        Ok(())
    }
}
