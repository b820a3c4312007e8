use std::fs::{File, OpenOptions, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

use crate::regular_file::{flags, open_regular};

/// An exclusive lock on a lock file, held until this value is dropped.
///
/// The operating system releases the lock when a process is killed. The remaining file does not
/// block other processes.
#[derive(Debug)]
pub struct FileLock {
    path: PathBuf,
    _file: File,
}

impl FileLock {
    /// Acquires the lock at `path`; `None` if another process has it.
    ///
    /// The lock file is never truncated, and a symbolic link at `path` is not followed.
    ///
    /// # Errors
    /// `InvalidInput` if there is something else than a regular file, or if the file cannot be
    /// created or locked.
    pub fn try_acquire(path: &Path) -> io::Result<Option<FileLock>> {
        loop {
            let mut options = OpenOptions::new();
            options.write(true).create(true).truncate(false);
            let file = open_regular(&mut options, path, flags::NOFOLLOW)?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => return Ok(None),
                Err(TryLockError::Error(source)) => return Err(source),
            }
            // The previous owner may have removed the file after we opened it. Then the lock has no
            // effect.
            if is_at(&file, path) {
                return Ok(Some(FileLock { path: path.to_path_buf(), _file: file }));
            }
        }
    }
}

impl Drop for FileLock {
    fn drop(&mut self) {
        // We still hold the lock, so no other process uses the file. An error is harmless.
        let _ = std::fs::remove_file(&self.path);
    }
}

#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let identity = |found: &std::fs::Metadata| (found.dev(), found.ino());
    matches!((file.metadata(), path.symlink_metadata()), (Ok(a), Ok(b)) if identity(&a) == identity(&b))
}

#[cfg(not(unix))]
fn is_at(_: &File, _: &Path) -> bool {
    // On other systems an open file cannot be removed.
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lock_has_one_owner_until_it_is_dropped() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.lock");
        let first = FileLock::try_acquire(&path).unwrap().unwrap();
        assert!(FileLock::try_acquire(&path).unwrap().is_none());
        drop(first);
        assert!(!path.exists());
        // The file that a killed process leaves behind.
        std::fs::write(&path, "").unwrap();
        assert!(FileLock::try_acquire(&path).unwrap().is_some());
    }

    #[cfg(unix)]
    #[test]
    fn a_link_or_a_fifo_in_place_of_the_lock_file_is_an_error_and_its_target_is_unchanged() {
        use rustix::fs::{CWD, FileType, Mode, mknodat};
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("target"), "precious").unwrap();
        for (link, target) in [("a.lock", "target"), ("b.lock", "new")] {
            std::os::unix::fs::symlink(path(target), path(link)).unwrap();
            let error = FileLock::try_acquire(&path(link)).unwrap_err();
            assert_eq!(error.to_string(), "expected a regular file, found a symbolic link");
        }
        assert_eq!(std::fs::read(path("target")).unwrap(), b"precious");
        assert!(!path("new").exists());
        mknodat(CWD, path("c.lock"), FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
        assert!(FileLock::try_acquire(&path("c.lock")).is_err());
        // A hard link is a regular file: it is locked, and releasing the lock removes only this
        // name.
        std::fs::hard_link(path("target"), path("d.lock")).unwrap();
        drop(FileLock::try_acquire(&path("d.lock")).unwrap().unwrap());
        assert!(!path("d.lock").exists());
        assert_eq!(std::fs::read(path("target")).unwrap(), b"precious");
    }
}
