//! A file that grows: its end is not the end of the log.

use std::fs::{File, Metadata};
use std::io::{self, Read};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Time between two looks at the end of the file.
const PAUSE: Duration = Duration::from_millis(20);

/// Reads a file, and waits at its end for more.
pub(super) struct Tail {
    pub(super) file: File,
    pub(super) path: PathBuf,
    /// Number of bytes that were read.
    pub(super) read: u64,
    /// How long the file must not have grown to be complete; `None`: it never is.
    pub(super) idle: Option<Duration>,
}

impl Tail {
    /// Checks that the name still has the file, with at least the bytes that were read.
    fn check(&self) -> io::Result<()> {
        let file = self.file.metadata()?;
        if file.len() < self.read {
            return Err(io::Error::other("the file became shorter while it was followed"));
        }
        match self.path.metadata() {
            Ok(named) if is_same(&named, &file) => Ok(()),
            Ok(_) => Err(io::Error::other("another file took the name of the file that is followed")),
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                Err(io::Error::other("the file was removed or renamed while it was followed"))
            }
            Err(error) => Err(error),
        }
    }
}

#[cfg(unix)]
fn is_same(a: &Metadata, b: &Metadata) -> bool {
    use std::os::unix::fs::MetadataExt;
    (a.dev(), a.ino()) == (b.dev(), b.ino())
}

#[cfg(not(unix))]
fn is_same(a: &Metadata, b: &Metadata) -> bool {
    a.created().ok() == b.created().ok()
}

impl Read for Tail {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let start = Instant::now();
        loop {
            let count = self.file.read(buffer)?;
            if count > 0 || buffer.is_empty() {
                self.read += count as u64;
                return Ok(count);
            }
            self.check()?;
            if self.idle.is_some_and(|idle| start.elapsed() >= idle) {
                return Ok(0);
            }
            std::thread::sleep(PAUSE);
        }
    }
}
