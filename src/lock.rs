use std::fs::{File, OpenOptions, TryLockError};
use std::path::{Path, PathBuf};

use crate::MishandleError;

/// Keeps a second training away from the files of the first, for as long as it lives. The system lets go of it when a
/// process is killed; the file that is then left behind holds nobody up.
pub(crate) struct Lock {
    path: PathBuf,
    _file: File,
}

impl Lock {
    /// Takes the lock file at `path`, which guards `what`, the place that `flag` gives.
    pub(crate) fn take(path: PathBuf, what: &Path, flag: &'static str) -> Result<Lock, MishandleError> {
        loop {
            let failed = |source| MishandleError::File { path: path.clone(), source };
            let file =
                OpenOptions::new().write(true).create(true).truncate(false).open(&path).map_err(failed)?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    return Err(MishandleError::Busy { path: what.to_path_buf(), flag });
                }
                Err(TryLockError::Error(source)) => return Err(failed(source)),
            }
            // Its former owner may have removed it since it was opened: then the lock guards nothing.
            if is_at(&file, &path) {
                return Ok(Lock { path, _file: file });
            }
        }
    }
}

impl Drop for Lock {
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
        let take = || Lock::take(path.clone(), Path::new("a.safetensors"), "--out");
        let first = take().unwrap();
        let refused = take().err().unwrap().to_string();
        assert!(refused.contains("another training") && refused.contains("a.safetensors"), "{refused}");
        drop(first);
        assert!(!path.exists());
        // What a killed process leaves behind.
        std::fs::write(&path, "").unwrap();
        take().unwrap();
    }
}
