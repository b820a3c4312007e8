use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use tempfile::{Builder, TempDir};

/// A folder that appears at its path only when it is complete.
///
/// Its files are written to a temporary folder beside it, which [`persist`](Self::persist) renames.
/// If the value is dropped before, the temporary folder is removed. A process that is killed leaves
/// a folder `.mishandle-*.part` behind, which nothing reads.
#[derive(Debug)]
pub struct AtomicFolder {
    temporary: TempDir,
    path: PathBuf,
}

impl AtomicFolder {
    /// Creates a folder for `path`, which must not exist yet.
    ///
    /// # Errors
    /// `AlreadyExists` if it does, `NotFound` if the folder around it does not exist, or any other
    /// error of the system.
    pub fn create_new(path: &Path) -> io::Result<AtomicFolder> {
        if path.symlink_metadata().is_ok() {
            return Err(ErrorKind::AlreadyExists.into());
        }
        AtomicFolder::replace(path)
    }

    /// Creates a folder for `path`, where [`persist_over`](Self::persist_over) replaces another
    /// folder. The caller has checked that nothing in it is lost.
    ///
    /// # Errors
    /// `NotFound` if the folder around it does not exist, or any other error of the system.
    pub fn replace(path: &Path) -> io::Result<AtomicFolder> {
        let outer = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let mut builder = Builder::new();
        builder.prefix(".mishandle-").suffix(".part");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // The usual permissions of a new folder; the process's umask is subtracted.
            builder.permissions(std::fs::Permissions::from_mode(0o777));
        }
        // Keeps only the kind of the error: the temporary name would confuse the user.
        let temporary = builder.tempdir_in(outer).map_err(|error| io::Error::from(error.kind()))?;
        Ok(AtomicFolder { temporary, path: path.to_path_buf() })
    }

    /// Returns the temporary folder, to write files into it.
    pub fn path(&self) -> &Path {
        self.temporary.path()
    }

    /// Renames the folder to its path.
    ///
    /// # Errors
    /// Any error of the system, such as a folder with files at the path. The temporary folder is
    /// then removed.
    pub fn persist(self) -> io::Result<()> {
        std::fs::rename(self.temporary.path(), &self.path)?;
        // There is nothing to remove any more.
        let _ = self.temporary.keep();
        Ok(())
    }

    /// Renames the folder to its path, and removes the folder that was there. On Linux, the two
    /// change places in one step; elsewhere, a process that is killed in between leaves both under
    /// temporary names.
    ///
    /// # Errors
    /// Any error of the system.
    pub fn persist_over(self) -> io::Result<()> {
        if self.path.symlink_metadata().is_err() {
            return self.persist();
        }
        #[cfg(target_os = "linux")]
        {
            use rustix::fs::{CWD, RenameFlags, renameat_with};
            renameat_with(CWD, self.temporary.path(), CWD, &self.path, RenameFlags::EXCHANGE)?;
            // The temporary name is now that of the old folder.
            self.temporary.close()
        }
        #[cfg(not(target_os = "linux"))]
        {
            let outer = self.path.parent().filter(|folder| !folder.as_os_str().is_empty());
            let old = Builder::new()
                .prefix(".mishandle-")
                .suffix(".part")
                .tempdir_in(outer.unwrap_or(Path::new(".")))?;
            std::fs::rename(&self.path, old.path().join("old"))?;
            self.persist()
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn a_folder_appears_with_its_files_or_not_at_all() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("new");
        let dropped = AtomicFolder::create_new(&path).unwrap();
        fs::write(dropped.path().join("a"), "1").unwrap();
        assert!(!path.exists());
        drop(dropped);
        assert_eq!(fs::read_dir(home.path()).unwrap().count(), 0);
        let folder = AtomicFolder::create_new(&path).unwrap();
        fs::write(folder.path().join("a"), "1").unwrap();
        folder.persist().unwrap();
        assert_eq!(fs::read(path.join("a")).unwrap(), b"1");
        assert_eq!(fs::read_dir(home.path()).unwrap().count(), 1);
        assert_eq!(AtomicFolder::create_new(&path).unwrap_err().kind(), ErrorKind::AlreadyExists);
    }

    #[test]
    fn a_folder_takes_the_place_of_another_one() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("new");
        for content in ["1", "2"] {
            let folder = AtomicFolder::replace(&path).unwrap();
            fs::write(folder.path().join(content), content).unwrap();
            folder.persist_over().unwrap();
            let names: Vec<_> =
                fs::read_dir(&path).unwrap().map(|entry| entry.unwrap().file_name()).collect();
            assert_eq!(names, [content]);
            assert_eq!(fs::read_dir(home.path()).unwrap().count(), 1);
        }
    }

    #[test]
    fn a_folder_created_in_the_meantime_is_kept() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("new");
        let folder = AtomicFolder::create_new(&path).unwrap();
        fs::create_dir(&path).unwrap();
        fs::write(path.join("other"), "").unwrap();
        assert!(folder.persist().is_err());
        assert!(path.join("other").exists());
        assert_eq!(fs::read_dir(home.path()).unwrap().count(), 1);
    }
}
