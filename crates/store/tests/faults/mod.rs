//! A disk and a memory that fail on command, and the life of a run to fail in.

pub mod disk;
pub mod failing;
pub mod life;
pub mod memory;
pub mod vfs;

/// Returns a new folder, in memory if possible: these tests write a lot and never sync.
pub fn folder() -> tempfile::TempDir {
    tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).unwrap()
}

/// Returns whether to run the long campaigns: `MISHANDLE_FAULTS=all`.
pub fn all() -> bool {
    std::env::var_os("MISHANDLE_FAULTS").is_some_and(|value| value == "all")
}
