use std::fs::{File, Metadata, Permissions};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

use tempfile::{Builder, NamedTempFile};

use crate::regular_file::not_regular;

/// A file that appears at its path only when it is complete.
///
/// The bytes go to a temporary file in the same folder. [`persist`](Self::persist) syncs it to the
/// disk and renames it. If the value is dropped before, the temporary file is removed. A process
/// that is killed leaves a file `.mishandle-*.part` behind, which nothing reads.
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
    /// Whether an existing file is replaced.
    replaces: bool,
    /// The permissions of the replaced file.
    permissions: Option<Permissions>,
}

impl AtomicFile {
    /// Creates a file for `path`, which must not exist yet.
    ///
    /// # Errors
    /// `AlreadyExists` if it does, `NotFound` if its folder does not exist, or any other error of
    /// the system.
    pub fn create_new(path: &Path) -> io::Result<AtomicFile> {
        if path.symlink_metadata().is_ok() {
            return Err(ErrorKind::AlreadyExists.into());
        }
        AtomicFile::create(path, None)
    }

    /// Creates a file for `path`, which replaces an existing file.
    ///
    /// The new file has the permissions of the old one, and belongs to the user of the process. A
    /// symbolic link is replaced by the file; its target is unchanged.
    ///
    /// # Errors
    /// `NotFound` if its folder does not exist, `IsADirectory` or `InvalidInput` if there is a
    /// directory, a FIFO, a socket or a device, or any other error of the system.
    pub fn replace(path: &Path) -> io::Result<AtomicFile> {
        let old = match path.symlink_metadata() {
            Ok(old) if !old.is_file() && !old.is_symlink() => return Err(not_regular(&old)),
            found => found.ok().filter(Metadata::is_file),
        };
        AtomicFile::create(path, Some(old))
    }

    /// `replaced` is `None` for a file that must not exist, otherwise the metadata of the file at
    /// the path, if there is one.
    fn create(path: &Path, replaced: Option<Option<Metadata>>) -> io::Result<AtomicFile> {
        let replaces = replaced.is_some();
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let mut builder = Builder::new();
        builder.prefix(".mishandle-").suffix(".part");
        let mut permissions = replaced.flatten().map(|old| old.permissions());
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // Without the bits that run a program as its owner.
            permissions = permissions.map(|old| Permissions::from_mode(old.mode() & 0o777));
            // The usual permissions of a new file; the process's umask is subtracted. A replaced
            // private file is private from the start, but this process can write it.
            let mode = permissions.as_ref().map_or(0o666, |old| old.mode() | 0o600);
            builder.permissions(Permissions::from_mode(mode));
        }
        // Keeps only the kind of the error: the temporary name would confuse the user.
        let temporary = builder.tempfile_in(folder).map_err(|error| io::Error::from(error.kind()))?;
        Ok(AtomicFile { temporary, path: path.to_path_buf(), replaces, permissions })
    }

    /// Returns the temporary file, for a program that writes it as its standard output.
    pub fn file(&self) -> &File {
        self.temporary.as_file()
    }

    /// Syncs the file to the disk and renames it to its path.
    ///
    /// # Errors
    /// Any error of the system. The temporary file is then removed, and an old file at the path is
    /// unchanged.
    pub fn persist(self) -> io::Result<()> {
        if let Some(permissions) = self.permissions {
            self.temporary.as_file().set_permissions(permissions)?;
        }
        self.temporary.as_file().sync_all()?;
        let persisted = if self.replaces {
            self.temporary.persist(&self.path)
        } else {
            self.temporary.persist_noclobber(&self.path)
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

/// Writes a file, replacing an existing one: a reader finds the old bytes or the new ones, even
/// after a crash.
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
    fn a_replaced_file_keeps_its_permissions_and_a_link_is_replaced_instead_of_its_target() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let folder = tempfile::tempdir().unwrap();
        let [private, target, link] = ["private", "target", "link"].map(|name| folder.path().join(name));
        fs::write(&private, "old").unwrap();
        fs::set_permissions(&private, PermissionsExt::from_mode(0o4600)).unwrap();
        write_atomically(&private, b"new").unwrap();
        assert_eq!(private.metadata().unwrap().permissions().mode() & 0o7777, 0o600);
        fs::write(&target, "precious").unwrap();
        symlink(&target, &link).unwrap();
        write_atomically(&link, b"new").unwrap();
        assert!(link.symlink_metadata().unwrap().is_file());
        assert_eq!(
            (fs::read(&link).unwrap(), fs::read(&target).unwrap()),
            (b"new".into(), b"precious".into())
        );
    }

    #[cfg(unix)]
    #[test]
    fn a_device_is_not_replaced() {
        let error = AtomicFile::replace(Path::new("/dev/null")).unwrap_err();
        assert_eq!(error.to_string(), "expected a regular file, found a device");
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
