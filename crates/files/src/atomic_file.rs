use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

use tempfile::{Builder, NamedTempFile};

/// A file that appears at its path only when it is complete.
///
/// The bytes go to a temporary file in the same folder. [`persist`](Self::persist) syncs it to the disk and renames
/// it. If the value is dropped before, the temporary file is removed. A process that is killed leaves a file
/// `.mishandle-*.part` behind, which nothing reads.
///
/// # Example
/// ```
/// use std::io::Write;
/// use mishandle_files::AtomicFile;
/// # let folder = tempfile::tempdir()?;
/// let path = folder.path().join("picture.png");
/// let mut file = AtomicFile::create_new(&path)?;
/// file.write_all(b"first half, ")?;
/// assert!(!path.exists());
/// file.write_all(b"second half")?;
/// file.persist()?;
/// assert_eq!(std::fs::read(&path)?, b"first half, second half");
/// assert!(AtomicFile::create_new(&path).is_err());
/// # Ok::<(), std::io::Error>(())
/// ```
#[derive(Debug)]
pub struct AtomicFile {
    temporary: NamedTempFile,
    path: PathBuf,
    replaces: bool,
}

impl AtomicFile {
    /// Creates a file for `path`, which must not exist yet.
    ///
    /// # Errors
    /// `AlreadyExists` if it does, `NotFound` if its folder does not exist, or any other error of the system.
    pub fn create_new(path: &Path) -> io::Result<AtomicFile> {
        if path.symlink_metadata().is_ok() {
            return Err(ErrorKind::AlreadyExists.into());
        }
        AtomicFile::create(path, false)
    }

    /// Creates a file for `path`, which replaces an existing file.
    ///
    /// # Errors
    /// `NotFound` if its folder does not exist, or any other error of the system.
    pub fn replace(path: &Path) -> io::Result<AtomicFile> {
        AtomicFile::create(path, true)
    }

    fn create(path: &Path, replaces: bool) -> io::Result<AtomicFile> {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let mut builder = Builder::new();
        builder.prefix(".mishandle-").suffix(".part");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // The usual permissions of a new file; the process's umask is subtracted.
            builder.permissions(std::fs::Permissions::from_mode(0o666));
        }
        // Keeps only the kind of the error: the temporary name would confuse the user.
        let temporary = builder.tempfile_in(folder).map_err(|error| io::Error::from(error.kind()))?;
        Ok(AtomicFile { temporary, path: path.to_path_buf(), replaces })
    }

    /// Returns the path of the temporary file, for a program that writes it by its name.
    pub fn temporary_path(&self) -> &Path {
        self.temporary.path()
    }

    /// Syncs the file to the disk and renames it to its path.
    ///
    /// # Errors
    /// Any error of the system. The temporary file is then removed, and an old file at the path is unchanged.
    pub fn persist(self) -> io::Result<()> {
        self.temporary.as_file().sync_all()?;
        let persisted = match self.replaces {
            true => self.temporary.persist(&self.path),
            false => self.temporary.persist_noclobber(&self.path),
        };
        persisted.map(drop).map_err(|error| error.error)
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.temporary.as_file_mut().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.temporary.as_file_mut().flush()
    }
}

/// Writes a file, replacing an existing one: a reader finds the old bytes or the new ones, even after a crash.
///
/// # Errors
/// Any error of the system. An old file is then unchanged, and no temporary file is left.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = AtomicFile::replace(path)?;
    file.write_all(bytes)?;
    file.persist()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn entries(folder: &Path) -> usize {
        fs::read_dir(folder).unwrap().count()
    }

    #[test]
    fn an_existing_file_is_replaced_and_no_temporary_file_is_left() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bin");
        write_atomically(&path, b"old").unwrap();
        write_atomically(&path, b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(entries(folder.path()), 1);
    }

    #[test]
    fn a_dropped_file_leaves_no_temporary_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bin");
        let mut file = AtomicFile::create_new(&path).unwrap();
        file.write_all(b"half").unwrap();
        drop(file);
        assert_eq!(entries(folder.path()), 0);
    }

    #[test]
    fn a_file_created_in_the_meantime_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bin");
        let file = AtomicFile::create_new(&path).unwrap();
        fs::write(&path, "another").unwrap();
        assert_eq!(file.persist().unwrap_err().kind(), ErrorKind::AlreadyExists);
        assert_eq!(fs::read(&path).unwrap(), b"another");
        assert_eq!(entries(folder.path()), 1);
    }

    #[test]
    fn a_folder_at_the_path_is_an_error_and_leaves_no_temporary_file() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("a.bin")).unwrap();
        assert!(write_atomically(&folder.path().join("a.bin"), b"new").is_err());
        assert_eq!(entries(folder.path()), 1);
        let missing = write_atomically(&folder.path().join("b/a"), b"").unwrap_err();
        assert_eq!(missing.kind(), ErrorKind::NotFound);
    }

    #[cfg(unix)]
    #[test]
    fn a_new_file_has_the_permissions_of_the_umask() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let [ours, plain] = ["ours", "plain"].map(|name| folder.path().join(name));
        write_atomically(&ours, b"").unwrap();
        fs::write(&plain, b"").unwrap();
        let mode = |path: &Path| path.metadata().unwrap().permissions().mode();
        assert_eq!(mode(&ours), mode(&plain));
    }
}
