//! Tables: what the readers of all formats have in common.

use std::io;

use crate::cell::Sinks;
use crate::error::Result;
use crate::options::Unit;
use crate::place::Counted;

/// A file whose columns are known and whose rows were not read yet.
pub(crate) trait Table {
    /// Returns the names of the columns.
    fn names(&self) -> &[String];

    /// Returns what messages call the rows.
    fn counted(&self) -> Counted;

    /// Returns the column with the times and their unit, if the format states both.
    fn known_time(&self) -> Option<(usize, Unit)> {
        None
    }

    /// Returns a column whose name is not UTF-8, of which the name is an approximation.
    fn foreign(&self) -> Option<usize> {
        None
    }

    /// Returns the names of columns that are not read, and why.
    fn not_read(&self) -> &[(String, String)] {
        &[]
    }

    /// Reads the rows into these columns.
    fn read(self: Box<Self>, sinks: &mut Sinks) -> Result<()>;
}

/// Reads again if a signal has interrupted it.
pub(crate) fn retried(mut read: impl FnMut() -> io::Result<usize>) -> io::Result<usize> {
    loop {
        match read() {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            read => return read,
        }
    }
}
