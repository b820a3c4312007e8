//! Run files of evidence: closed, and readable without writing.

use std::fs::File;
use std::io::{self, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use mishandle::files::open_for_reading;
use mishandle::store::{RunFile, RunWriter};

use crate::error::EvidenceError;

/// Returns whether SQLite reads a file by a log (WAL), for which even a reader creates files beside
/// it: bytes 18 and 19 of the header, <https://sqlite.org/fileformat2.html#file_format_version_numbers>.
///
/// # Errors
/// If the file cannot be read.
pub(crate) fn needs_log(path: &Path) -> io::Result<bool> {
    let mut versions = [0; 2];
    let mut file: File = open_for_reading(path)?;
    file.seek(SeekFrom::Start(18))?;
    match file.read_exact(&mut versions) {
        Ok(()) => Ok(versions.contains(&2)),
        Err(error) if error.kind() == ErrorKind::UnexpectedEof => Ok(false),
        Err(error) => Err(error),
    }
}

/// Copies a run that nobody writes, byte for byte. Of a run that needs a log, the copy needs none:
/// nothing is written beside the original.
///
/// # Errors
/// [`NotClosed`](EvidenceError::NotClosed), or if a file cannot be read or written.
pub(crate) fn copy(path: &Path, copy: &Path) -> Result<(), EvidenceError> {
    if beside(path, "-wal").exists() || beside(path, "-journal").exists() {
        return Err(EvidenceError::NotClosed { path: path.to_path_buf() });
    }
    let needs_log = needs_log(path).map_err(EvidenceError::file(path))?;
    if !needs_log {
        // Says what is wrong with the path that the user typed.
        RunFile::open_unchecked(path)?;
    }
    copy_file(path, copy)?;
    if needs_log {
        RunWriter::resume_unchecked(copy)?.close()?;
    }
    Ok(())
}

/// Copies a file. The error names the one that cannot be read or written.
pub(crate) fn copy_file(from: &Path, to: &Path) -> Result<(), EvidenceError> {
    let mut source = open_for_reading(from).map_err(EvidenceError::file(from))?;
    let mut copy = File::create(to).map_err(EvidenceError::file(to))?;
    let mut buffer = vec![0; 1 << 16];
    loop {
        match source.read(&mut buffer).map_err(EvidenceError::file(from))? {
            0 => return Ok(()),
            n => copy.write_all(&buffer[..n]).map_err(EvidenceError::file(to))?,
        }
    }
}

fn beside(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    PathBuf::from(name)
}
