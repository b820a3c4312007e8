//! Films, made by the program `ffmpeg` from raw pictures.

use std::io::{ErrorKind, Read, Write};
use std::process::{Child, Command, Stdio};

use anyhow::{Context, Error, Result, bail};
use mishandle::world::Size;

use crate::new_file::NewFile;

/// A film in the making.
pub struct Video {
    encoder: Child,
    file: NewFile,
}

impl Video {
    /// Begins a film of so many pictures a second.
    pub fn begin(file: NewFile, size: Size, rate: f64) -> Result<Video> {
        let encoder = Command::new("ffmpeg")
            .args(["-loglevel", "error", "-y", "-f", "rawvideo", "-pixel_format", "rgb24"])
            .args(["-video_size", &format!("{}x{}", size.width(), size.height())])
            .args(["-framerate", &rate.to_string(), "-i", "pipe:0"])
            .args(["-pix_fmt", "yuv420p", "-movflags", "+faststart", "-f", "mp4"])
            .arg(file.part())
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|error| match error.kind() {
                ErrorKind::NotFound => Error::msg(
                    "a film takes the program `ffmpeg`, which is not on PATH (on Debian and Ubuntu: apt install \
                     ffmpeg); a filmstrip, --out FILE.png, does without",
                ),
                _ => Error::new(error).context("cannot run ffmpeg"),
            })?;
        Ok(Video { encoder, file })
    }

    /// Appends a picture.
    pub fn push(&mut self, pixels: &[u8]) -> Result<()> {
        let written = self.encoder.stdin.as_mut().map_or(Ok(()), |pipe| pipe.write_all(pixels));
        match written {
            Err(error) if error.kind() == ErrorKind::BrokenPipe => self.close(),
            written => written.context("cannot write to ffmpeg"),
        }
    }

    /// Ends the film.
    pub fn end(mut self) -> Result<()> {
        self.close()?;
        self.file.finish()
    }

    /// Waits for the encoder to end, which it should without complaint.
    fn close(&mut self) -> Result<()> {
        drop(self.encoder.stdin.take());
        let mut said = String::new();
        if let Some(stderr) = &mut self.encoder.stderr {
            stderr.read_to_string(&mut said)?;
        }
        let status = self.encoder.wait()?;
        if !status.success() {
            bail!("ffmpeg ended with {status}: {}", said.trim().replace('\n', "; "));
        }
        Ok(())
    }
}
