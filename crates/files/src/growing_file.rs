use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// A file that grows by whole records.
///
/// A full disk leaves no part of a record behind: what could not be written is kept, and tried again before the next.
#[derive(Debug)]
pub struct GrowingFile {
    path: PathBuf,
    file: File,
    /// Bytes of the records that are there; whatever the file has behind them goes with the next write.
    length: u64,
    /// Records that are not there yet.
    pending: Vec<u8>,
    /// Whether it was begun here.
    is_new: bool,
}

impl GrowingFile {
    /// Begins a file that must not be there yet. If its first record cannot be written, nothing is left of it.
    pub fn create(path: PathBuf, first: &[u8]) -> io::Result<GrowingFile> {
        let file = File::create_new(&path)?;
        let mut begun = GrowingFile { path, file, length: 0, pending: Vec::new(), is_new: true };
        match begun.append(first) {
            Ok(()) => Ok(begun),
            Err(error) => {
                begun.discard();
                Err(error)
            }
        }
    }

    /// Goes on behind the first `length` bytes of a file.
    pub fn open(path: PathBuf, length: u64) -> io::Result<GrowingFile> {
        let file = File::options().write(true).open(&path)?;
        Ok(GrowingFile { path, file, length, pending: Vec::new(), is_new: false })
    }

    /// Takes the file away again, if it was begun here.
    pub fn discard(self) {
        if self.is_new {
            // The failure that led here is the one to tell.
            let _ = std::fs::remove_file(&self.path);
        }
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes a record behind the others.
    pub fn append(&mut self, record: &[u8]) -> io::Result<()> {
        self.pending.extend_from_slice(record);
        self.write()
    }

    /// Has all that was written reach the disk, and nothing stand behind it.
    pub fn finish(&mut self) -> io::Result<()> {
        self.write()?;
        self.file.sync_data()
    }

    fn write(&mut self) -> io::Result<()> {
        self.file.set_len(self.length)?;
        self.file.seek(SeekFrom::Start(self.length))?;
        self.file.write_all(&self.pending).inspect_err(|_| {
            // What is left of a record there, the next write takes away; whoever reads before should not see it.
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
    fn what_stands_behind_the_kept_bytes_goes_with_the_next_record() {
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

    #[test]
    fn what_could_not_be_written_is_tried_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let mut file = GrowingFile::create(path.clone(), b"one ").unwrap();
        // A file opened for reading takes nothing.
        let writable = std::mem::replace(&mut file.file, File::open(&path).unwrap());
        assert!(file.append(b"two ").is_err());
        assert!(file.append(b"three ").is_err());
        assert_eq!(std::fs::read(&path).unwrap(), b"one ");
        file.file = writable;
        file.append(b"four ").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"one two three four ");
    }

    #[test]
    fn only_a_file_that_was_begun_here_is_taken_away() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        GrowingFile::create(path.clone(), b"one ").unwrap().discard();
        assert!(!path.exists());
        drop(GrowingFile::create(path.clone(), b"one ").unwrap());
        GrowingFile::open(path.clone(), 4).unwrap().discard();
        assert_eq!(std::fs::read(&path).unwrap(), b"one ");
    }
}
