use std::io;
use std::path::{Path, PathBuf};

/// Folders created for output files. Folders that are still empty are removed when this value is
/// dropped.
#[derive(Debug, Default)]
pub struct NewFolders {
    /// Outer ones first.
    created: Vec<PathBuf>,
}

impl NewFolders {
    /// Creates a folder and its missing parents.
    ///
    /// # Errors
    /// Any error of the operating system.
    pub fn create(&mut self, path: &Path) -> io::Result<()> {
        let is_missing = |folder: &&Path| !folder.as_os_str().is_empty() && !folder.exists();
        let missing: Vec<&Path> = path.ancestors().take_while(is_missing).collect();
        self.created.extend(missing.into_iter().rev().map(Path::to_path_buf));
        std::fs::create_dir_all(path)
    }
}

impl Drop for NewFolders {
    fn drop(&mut self) {
        for folder in self.created.iter().rev() {
            // Fails for a folder that is not empty, which stays.
            let _ = std::fs::remove_dir(folder);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn created_folders_are_removed_if_they_are_empty() {
        let home = tempfile::tempdir().unwrap();
        let [old, new, inner, other] =
            ["old", "old/new", "old/new/inner", "old/new/other"].map(|name| home.path().join(name));
        std::fs::create_dir(&old).unwrap();
        let make = |path: &Path| {
            let mut folders = NewFolders::default();
            folders.create(&old).unwrap();
            folders.create(path).unwrap();
            folders.create(&other).unwrap();
            folders
        };
        let folders = make(&inner);
        assert!(inner.is_dir() && other.is_dir());
        drop(folders);
        assert!(old.is_dir() && !new.exists());
        let folders = make(&inner);
        std::fs::write(new.join("a"), "").unwrap();
        drop(folders);
        assert!(new.join("a").exists() && !inner.exists());
        // A file has the name of the folder.
        assert!(NewFolders::default().create(&new.join("a/b")).is_err());
    }
}
