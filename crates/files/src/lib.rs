//! Files that survive a crash: complete or absent, locked by one process, or growing by whole records.
//!
//! - [`AtomicFile`] and [`write_atomically`]: a reader finds the old bytes or the new bytes, never a part of them.
//! - [`FileLock`]: one process at a time.
//! - [`GrowingFile`]: appends whole records, also after a full disk.
//! - [`NewFolders`]: removes the folders it created if nothing was written into them.

mod atomic_file;
mod file_lock;
mod growing_file;
mod new_folders;

pub use atomic_file::{AtomicFile, write_atomically};
pub use file_lock::FileLock;
pub use growing_file::GrowingFile;
pub use new_folders::NewFolders;
