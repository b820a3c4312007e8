//! Files that survive a crash: complete or absent, locked by one process, or growing by whole
//! records. Untrusted files: regular and of bounded size.
//!
//! - [`read_bounded`] and [`read_text_bounded`]: read a regular file up to one of the [`limits`].
//! - [`open_for_reading`]: a regular file of any size, not through a symbolic link.
//! - [`AtomicFile`] and [`write_atomically`]: a reader finds the old bytes or the new bytes, never
//!   a part of them.
//! - [`AtomicFolder`]: the same for a folder with its files.
//! - [`FileLock`]: one process at a time.
//! - [`GrowingFile`]: appends whole records, also after a full disk.
//! - [`is_same_file`]: two names of one file.
//! - [`refuse_link`] and [`refuse_links_in`]: symbolic links in untrusted folders.
//! - [`NewFolders`]: removes the folders it created if nothing was written into them.
//!
//! No file is written through a symbolic link: new files are created exclusively, replaced ones are
//! renamed over, locked and growing ones are opened without following links.

mod atomic_file;
mod atomic_folder;
mod file_lock;
mod growing_file;
pub mod limits;
mod links;
mod new_folders;
mod regular_file;
mod same_file;

pub use atomic_file::{AtomicFile, write_atomically};
pub use atomic_folder::AtomicFolder;
pub use file_lock::FileLock;
pub use growing_file::GrowingFile;
pub use links::{refuse_link, refuse_links_in};
pub use new_folders::NewFolders;
pub use regular_file::{open_for_reading, read_bounded, read_text_bounded};
pub use same_file::is_same_file;
