//! A file that grows: its end is not the end of the log.

use std::fs::{File, Metadata};
use std::io::{self, Read, Seek, SeekFrom};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Time between two looks at the end of the file.
const PAUSE: Duration = Duration::from_millis(20);

/// Largest number of bytes that are compared, at the start of the file and before the place of
/// reading.
const COMPARED: usize = 1 << 12;

/// Reads a file, and waits at its end for more.
pub(super) struct Tail {
    file: File,
    path: PathBuf,
    /// How long the file must not have grown to be complete; `None`: it never is.
    idle: Option<Duration>,
    /// Number of bytes that were read.
    read: u64,
    /// The first of them, and the last.
    first: Vec<u8>,
    last: Vec<u8>,
}

impl Tail {
    pub(super) fn new(file: File, path: PathBuf, idle: Option<Duration>) -> Tail {
        Tail { file, path, idle, read: 0, first: Vec::new(), last: Vec::new() }
    }

    /// Checks that the file has the bytes that were read: it can be written again from its start.
    fn check_content(&mut self) -> io::Result<()> {
        let starts = [(0, &self.first), (self.read - self.last.len() as u64, &self.last)];
        for (start, known) in starts {
            let mut found = vec![0; known.len()];
            self.file.seek(SeekFrom::Start(start))?;
            let is_same = match self.file.read_exact(&mut found) {
                Ok(()) => found == *known,
                Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => false,
                Err(error) => return Err(error),
            };
            if !is_same {
                let message =
                    "the file was rewritten while it was followed: the bytes that were read have changed";
                return Err(io::Error::other(message));
            }
        }
        self.file.seek(SeekFrom::Start(self.read)).map(drop)
    }

    fn remember(&mut self, bytes: &[u8]) {
        let missing = COMPARED.saturating_sub(self.first.len()).min(bytes.len());
        self.first.extend(&bytes[..missing]);
        self.last.extend(&bytes[bytes.len().saturating_sub(COMPARED)..]);
        self.last.drain(..self.last.len().saturating_sub(COMPARED));
        self.read += bytes.len() as u64;
    }

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
            if count == 0 && !buffer.is_empty() {
                self.check()?;
            }
            // After the read: these bytes are of the file whose first bytes are known.
            self.check_content()?;
            if count > 0 || buffer.is_empty() {
                self.remember(&buffer[..count]);
                self.file.seek(SeekFrom::Start(self.read))?;
                return Ok(count);
            }
            if self.idle.is_some_and(|idle| start.elapsed() >= idle) {
                return Ok(0);
            }
            std::thread::sleep(PAUSE);
        }
    }
}
