use std::io;
use std::path::{Path, PathBuf};

/// Folders that were made for what is to be written. Those that are still empty in the end go with their owner.
#[derive(Debug, Default)]
pub struct NewFolders {
    /// Outer ones first.
    made: Vec<PathBuf>,
}

impl NewFolders {
    /// Makes a folder, with those that it is in, where it is not there yet.
    pub fn make(&mut self, path: &Path) -> io::Result<()> {
        let is_missing = |folder: &&Path| !folder.as_os_str().is_empty() && !folder.exists();
        let missing: Vec<&Path> = path.ancestors().take_while(is_missing).collect();
        self.made.extend(missing.into_iter().rev().map(Path::to_path_buf));
        std::fs::create_dir_all(path)
    }
}

impl Drop for NewFolders {
    fn drop(&mut self) {
        for folder in self.made.iter().rev() {
            // One that is not empty stays.
            let _ = std::fs::remove_dir(folder);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_made_and_is_empty_goes() {
        let home = tempfile::tempdir().unwrap();
        let [old, new, inner, other] =
            ["old", "old/new", "old/new/inner", "old/new/other"].map(|name| home.path().join(name));
        std::fs::create_dir(&old).unwrap();
        let make = |path: &Path| {
            let mut folders = NewFolders::default();
            folders.make(&old).unwrap();
            folders.make(path).unwrap();
            folders.make(&other).unwrap();
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
        // A file is in the way.
        assert!(NewFolders::default().make(&new.join("a/b")).is_err());
    }
}
