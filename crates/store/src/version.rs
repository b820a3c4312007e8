//! The format version of a run file.

use std::path::Path;

use rusqlite::Connection;

use crate::Result;
use crate::error::{InFile, StoreError};

/// The format version of run files that this program reads and writes.
pub const FORMAT_VERSION: i64 = 5;

/// Application ID of run files: `MHdl` in ASCII.
pub(crate) const APPLICATION_ID: i64 = 0x4d48_646c;

/// Checks that the file is a run file of this version.
pub(crate) fn check(connection: &Connection, path: &Path) -> Result<()> {
    let integer =
        |pragma| connection.pragma_query_value(None, pragma, |row| row.get::<_, i64>(0)).in_file(path);
    let application_id = integer("application_id")?;
    let found = integer("user_version")?;
    if application_id != APPLICATION_ID {
        let objects: i64 =
            connection.query_row("SELECT count(*) FROM sqlite_schema", [], |row| row.get(0)).in_file(path)?;
        // A run gets its ID and its tables in one transaction. If that was interrupted, SQLite
        // makes the file empty again. It also takes a file of one byte for an empty database.
        let is_one_byte = std::fs::metadata(path).is_ok_and(|found| found.len() == 1);
        return Err(if !is_one_byte && (application_id, found, objects) == (0, 0, 0) {
            StoreError::Unfinished { path: path.into() }
        } else {
            StoreError::of_another_program(path)
        });
    }
    match found {
        FORMAT_VERSION => Ok(()),
        ..1 => Err(StoreError::damaged(path, format!("its format version is {found}; versions start at 1"))),
        1..FORMAT_VERSION => Err(StoreError::OlderVersion { found, path: path.into() }),
        _ => Err(StoreError::NewerVersion { found, path: path.into() }),
    }
}
