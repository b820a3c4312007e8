//! Files that are either as they were or complete.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::Path;

/// Writes a file so that whoever reads it finds the old bytes or the new ones, never a part, even after a crash.
///
/// The bytes go to a file beside it, whose name ends in `.partial`, and from the disk that takes the old one's place. The
/// partial file has one name only, so that one that a killed process left is written over: of two processes that write
/// the same file, one has to wait.
///
/// # Errors
/// Whatever the system says. The old file is then as it was, and the partial one is gone.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut name = path.file_name().map_or_else(OsString::new, OsString::from);
    name.push(".partial");
    let partial = path.with_file_name(name);
    let written = write_to_disk(&partial, bytes).and_then(|()| fs::rename(&partial, path));
    if written.is_err() {
        // The first error is the one to tell; that the rest could not be removed adds nothing to it.
        let _ = fs::remove_file(&partial);
    }
    written
}

fn write_to_disk(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = File::create(path)?;
    file.write_all(bytes)?;
    file.sync_all()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_old_file_is_replaced_and_nothing_else_is_left() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bin");
        write_atomically(&path, b"old").unwrap();
        write_atomically(&path, b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn what_a_killed_process_left_is_written_over() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("a.bin.partial"), b"longer than the new bytes").unwrap();
        write_atomically(&folder.path().join("a.bin"), b"new").unwrap();
        assert_eq!(fs::read(folder.path().join("a.bin")).unwrap(), b"new");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_folder_in_the_way_is_an_error_that_leaves_no_partial_file() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("a.bin")).unwrap();
        assert!(write_atomically(&folder.path().join("a.bin"), b"new").is_err());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
