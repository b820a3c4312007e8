use std::fs::{File, FileType, Metadata, OpenOptions};
use std::io::{self, Error, ErrorKind, Read};
use std::path::Path;

/// Reads a regular file of at most `limit` bytes; [`limits`](crate::limits) has the limits of this
/// program.
///
/// Symbolic links are followed. A FIFO, a device, a socket or a directory is an error, and opening
/// one never blocks. The size is checked before memory is allocated.
///
/// # Errors
/// `IsADirectory` or `InvalidInput` if the file is not a regular file, `FileTooLarge` if it is
/// larger than the limit, `OutOfMemory` if it does not fit into memory, or any other error of the
/// system.
///
/// # Example
/// ```
/// use mishandle_files::read_bounded;
/// # let folder = tempfile::tempdir()?;
/// let path = folder.path().join("plan.toml");
/// std::fs::write(&path, "seed = 1")?;
/// assert_eq!(read_bounded(&path, 8)?, b"seed = 1");
/// let error = read_bounded(&path, 7).unwrap_err();
/// assert_eq!(error.to_string(), "the file has 8 bytes; the limit is 7");
/// # Ok::<(), std::io::Error>(())
/// ```
pub fn read_bounded(path: &Path, limit: u64) -> io::Result<Vec<u8>> {
    let mut options = OpenOptions::new();
    let file = open_regular(options.read(true), path, flags::NONBLOCK)?;
    read_at_most(&file, file.metadata()?.len(), limit)
}

/// Reads a regular text file of at most `limit` bytes, as [`read_bounded`] does.
///
/// # Errors
/// `InvalidData` if the file is not UTF-8, or any error of [`read_bounded`].
pub fn read_text_bounded(path: &Path, limit: u64) -> io::Result<String> {
    String::from_utf8(read_bounded(path, limit)?)
        .map_err(|_| Error::new(ErrorKind::InvalidData, "the file is not UTF-8 text"))
}

/// Opens a regular file for reading, whatever its size. A symbolic link is an error, and opening
/// never blocks.
///
/// # Errors
/// `IsADirectory` or `InvalidInput` if the file is not a regular file, or any other error of the
/// system.
pub fn open_for_reading(path: &Path) -> io::Result<File> {
    let mut options = OpenOptions::new();
    open_regular(options.read(true), path, flags::NOFOLLOW)
}

/// Reads a file whose size was `length`. A file can grow while it is read, and files in /proc have
/// the size 0.
fn read_at_most(file: &File, length: u64, limit: u64) -> io::Result<Vec<u8>> {
    let too_large = |size: String| {
        Error::new(ErrorKind::FileTooLarge, format!("the file has {size} bytes; the limit is {limit}"))
    };
    if length > limit {
        return Err(too_large(length.to_string()));
    }
    let mut bytes = Vec::new();
    let capacity = usize::try_from(length).unwrap_or(usize::MAX);
    bytes.try_reserve_exact(capacity).map_err(|_| {
        Error::new(
            ErrorKind::OutOfMemory,
            format!("the file has {length} bytes, which do not fit into memory"),
        )
    })?;
    file.take(limit.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > limit { Err(too_large(format!("more than {limit}"))) } else { Ok(bytes) }
}

/// Opens a file, which must be a regular file, with additional flags of `open(2)`.
pub(crate) fn open_regular(options: &mut OpenOptions, path: &Path, flags: i32) -> io::Result<File> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::OpenOptionsExt;
        options.custom_flags(flags | flags::NONBLOCK | flags::NOCTTY);
    }
    let file = options.open(path).map_err(|error| match path.symlink_metadata() {
        // More specific than the error of the system, such as `Too many levels of symbolic links`.
        Ok(found) if flags & flags::NOFOLLOW != 0 && found.is_symlink() => not_regular(&found),
        // The error of the system for a socket is `No such device or address`.
        Ok(_) => {
            path.metadata().ok().filter(|found| !found.is_file()).map_or(error, |found| not_regular(&found))
        }
        Err(_) => error,
    })?;
    let found = file.metadata()?;
    if found.is_file() { Ok(file) } else { Err(not_regular(&found)) }
}

/// Returns the error for a file that is not a regular file.
pub(crate) fn not_regular(found: &Metadata) -> Error {
    let kind = if found.is_dir() { ErrorKind::IsADirectory } else { ErrorKind::InvalidInput };
    Error::new(kind, format!("expected a regular file, found {}", name(found.file_type())))
}

#[cfg(unix)]
fn name(kind: FileType) -> &'static str {
    use std::os::unix::fs::FileTypeExt;
    match kind {
        _ if kind.is_dir() => "a directory",
        _ if kind.is_symlink() => "a symbolic link",
        _ if kind.is_fifo() => "a FIFO",
        _ if kind.is_socket() => "a socket",
        _ => "a device",
    }
}

#[cfg(not(unix))]
fn name(kind: FileType) -> &'static str {
    if kind.is_dir() { "a directory" } else { "another kind of file" }
}

/// Flags of `open(2)`.
pub(crate) mod flags {
    #[cfg(unix)]
    use rustix::fs::OFlags;

    /// Opening a FIFO does not wait for another process.
    #[cfg(unix)]
    pub const NONBLOCK: i32 = OFlags::NONBLOCK.bits() as i32;
    /// Opening a terminal does not make it the controlling terminal.
    #[cfg(unix)]
    pub const NOCTTY: i32 = OFlags::NOCTTY.bits() as i32;
    /// Opening a symbolic link is an error.
    #[cfg(unix)]
    pub const NOFOLLOW: i32 = OFlags::NOFOLLOW.bits() as i32;

    #[cfg(not(unix))]
    pub const NONBLOCK: i32 = 0;
    #[cfg(not(unix))]
    pub const NOFOLLOW: i32 = 0;
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::io::Seek;

    use super::*;

    #[test]
    fn a_file_at_the_limit_is_read_and_a_larger_one_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        fs::write(&path, [7; 100]).unwrap();
        assert_eq!(read_bounded(&path, 100).unwrap(), [7; 100]);
        assert_eq!(read_bounded(&path, 99).unwrap_err().kind(), ErrorKind::FileTooLarge);
        fs::write(&path, [0xFF]).unwrap();
        assert_eq!(read_text_bounded(&path, 9).unwrap_err().to_string(), "the file is not UTF-8 text");
    }

    #[test]
    fn a_file_that_grows_while_it_is_read_is_cut_off_one_byte_after_the_limit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        fs::write(&path, [7; 100]).unwrap();
        let file = File::open(&path).unwrap();
        let error = read_at_most(&file, 10, 50).unwrap_err();
        assert_eq!(error.to_string(), "the file has more than 50 bytes; the limit is 50");
        assert_eq!((&file).stream_position().unwrap(), 51);
    }

    #[test]
    fn a_sparse_file_of_a_terabyte_is_refused_by_its_size() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        File::create(&path).unwrap().set_len(1 << 40).unwrap();
        let error = read_bounded(&path, crate::limits::CHECKPOINT).unwrap_err();
        assert_eq!(error.to_string(), "the file has 1099511627776 bytes; the limit is 68719476736");
    }

    #[cfg(unix)]
    #[test]
    fn only_regular_files_are_read_and_no_open_blocks() {
        use rustix::fs::{CWD, FileType, Mode, mknodat};
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        mknodat(CWD, path("fifo"), FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
        let _socket = std::os::unix::net::UnixListener::bind(path("socket")).unwrap();
        std::os::unix::fs::symlink("/dev/zero", path("link")).unwrap();
        let message = |path: &Path| read_bounded(path, 9).unwrap_err().to_string();
        assert_eq!(message(Path::new("/dev/zero")), "expected a regular file, found a device");
        assert_eq!(message(&path("link")), "expected a regular file, found a device");
        assert_eq!(message(&path("fifo")), "expected a regular file, found a FIFO");
        assert_eq!(message(folder.path()), "expected a regular file, found a directory");
        assert_eq!(message(&path("socket")), "expected a regular file, found a socket");
        assert_eq!(read_bounded(&path("none"), 9).unwrap_err().kind(), ErrorKind::NotFound);
    }
}
