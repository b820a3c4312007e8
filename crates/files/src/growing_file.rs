use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use crate::regular_file::{flags, open_regular};

/// A file to which complete records are appended.
///
/// A full disk never leaves a partial record: a record that could not be written is kept in memory
/// and written before the next one.
#[derive(Debug)]
pub struct GrowingFile {
    path: PathBuf,
    file: File,
    /// The length of the complete records in bytes. The next write removes anything after them.
    length: u64,
    /// Records that are not written yet.
    pending: Vec<u8>,
    /// Whether this value created the file.
    is_new: bool,
}

impl GrowingFile {
    /// Creates a file, which must not exist yet, and writes its first record.
    ///
    /// # Errors
    /// `AlreadyExists` if the file exists, or any other error of the operating system. If the first
    /// record cannot be written, the file is removed.
    pub fn create(path: PathBuf, first: &[u8]) -> io::Result<GrowingFile> {
        let file = File::create_new(&path)?;
        let mut created = GrowingFile { path, file, length: 0, pending: Vec::new(), is_new: true };
        match created.append(first) {
            Ok(()) => Ok(created),
            Err(error) => {
                created.discard();
                Err(error)
            }
        }
    }

    /// Opens an existing file and continues after its first `length` bytes. A symbolic link is not
    /// followed.
    ///
    /// # Errors
    /// `InvalidInput` if the file is not a regular file, or any other error of the operating
    /// system.
    pub fn open(path: PathBuf, length: u64) -> io::Result<GrowingFile> {
        let file = open_regular(File::options().write(true), &path, flags::NOFOLLOW)?;
        Ok(GrowingFile { path, file, length, pending: Vec::new(), is_new: false })
    }

    /// Removes the file if this value created it.
    pub fn discard(self) {
        if self.is_new {
            // The caller reports the error that led here, not this one.
            let _ = std::fs::remove_file(&self.path);
        }
    }

    /// Returns the path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Appends a record.
    ///
    /// # Errors
    /// Any error of the operating system. The record is then kept and written with the next one.
    pub fn append(&mut self, record: &[u8]) -> io::Result<()> {
        self.pending.extend_from_slice(record);
        self.write()
    }

    /// Writes all records, removes anything after them and syncs the file to the disk.
    ///
    /// # Errors
    /// Any error of the operating system.
    pub fn finish(&mut self) -> io::Result<()> {
        self.write()?;
        self.file.sync_data()
    }

    fn write(&mut self) -> io::Result<()> {
        self.file.set_len(self.length)?;
        self.file.seek(SeekFrom::Start(self.length))?;
        self.file.write_all(&self.pending).inspect_err(|_| {
            // Removes the partial record at once, so that no reader sees it. The next write would
            // remove it, too.
            let _ = self.file.set_len(self.length);
        })?;
        self.length += self.pending.len() as u64;
        self.pending.clear();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_after_the_opened_length_are_removed_by_the_next_write() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let mut file = GrowingFile::create(path.clone(), b"one ").unwrap();
        file.append(b"two ").unwrap();
        assert!(GrowingFile::create(path.clone(), b"one ").is_err());
        drop(file);
        let mut file = GrowingFile::open(path.clone(), 4).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"one two ");
        file.append(b"3 ").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"one 3 ");
        drop(file);
        GrowingFile::open(path.clone(), 4).unwrap().finish().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"one ");
    }

    #[cfg(unix)]
    #[test]
    fn nothing_is_written_through_a_symbolic_link() {
        let folder = tempfile::tempdir().unwrap();
        let [target, link, dangling] = ["target", "link", "dangling"].map(|name| folder.path().join(name));
        std::fs::write(&target, "precious").unwrap();
        std::os::unix::fs::symlink(&target, &link).unwrap();
        std::os::unix::fs::symlink(folder.path().join("new"), &dangling).unwrap();
        let error = GrowingFile::open(link, 0).unwrap_err();
        assert_eq!(error.to_string(), "expected a regular file, found a symbolic link");
        assert_eq!(GrowingFile::create(dangling, b"a").unwrap_err().kind(), io::ErrorKind::AlreadyExists);
        assert_eq!(std::fs::read(&target).unwrap(), b"precious");
        assert!(!folder.path().join("new").exists());
    }

    #[test]
    fn records_that_could_not_be_written_are_written_later() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let mut file = GrowingFile::create(path.clone(), b"one ").unwrap();
        // Writing to a file opened for reading fails.
        let writable = std::mem::replace(&mut file.file, File::open(&path).unwrap());
        assert!(file.append(b"two ").is_err());
        assert!(file.append(b"three ").is_err());
        assert_eq!(std::fs::read(&path).unwrap(), b"one ");
        file.file = writable;
        file.append(b"four ").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"one two three four ");
    }

    #[test]
    fn discarding_removes_only_a_file_created_by_this_value() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        GrowingFile::create(path.clone(), b"one ").unwrap().discard();
        assert!(!path.exists());
        drop(GrowingFile::create(path.clone(), b"one ").unwrap());
        GrowingFile::open(path.clone(), 4).unwrap().discard();
        assert_eq!(std::fs::read(&path).unwrap(), b"one ");
    }
}
