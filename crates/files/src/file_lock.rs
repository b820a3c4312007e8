use std::fs::{File, OpenOptions, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

/// A lock file that keeps a second process away for as long as this lives.
///
/// The system releases the lock when a process is killed; the file that is then left behind locks nobody out.
#[derive(Debug)]
pub struct FileLock {
    path: PathBuf,
    _file: File,
}

impl FileLock {
    /// Takes the lock file at `path`; `None` if somebody else has it.
    ///
    /// # Errors
    /// If the file cannot be created or locked.
    pub fn take(path: &Path) -> io::Result<Option<FileLock>> {
        loop {
            let file = OpenOptions::new().write(true).create(true).truncate(false).open(path)?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => return Ok(None),
                Err(TryLockError::Error(source)) => return Err(source),
            }
            // Its former owner may have removed it since it was opened: then the lock guards nothing.
            if is_at(&file, path) {
                return Ok(Some(FileLock { path: path.to_path_buf(), _file: file }));
            }
        }
    }
}

impl Drop for FileLock {
    fn drop(&mut self) {
        // Still locked, so nobody else has it; a file left behind is no harm.
        let _ = std::fs::remove_file(&self.path);
    }
}

#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let place = |found: &std::fs::Metadata| (found.dev(), found.ino());
    matches!((file.metadata(), path.metadata()), (Ok(a), Ok(b)) if place(&a) == place(&b))
}

#[cfg(not(unix))]
fn is_at(_: &File, _: &Path) -> bool {
    // A file that is open cannot be removed there.
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_two_owners_one_is_refused_until_the_other_is_gone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.lock");
        let first = FileLock::take(&path).unwrap().unwrap();
        assert!(FileLock::take(&path).unwrap().is_none());
        drop(first);
        assert!(!path.exists());
        // What a killed process leaves behind.
        std::fs::write(&path, "").unwrap();
        assert!(FileLock::take(&path).unwrap().is_some());
    }
}
