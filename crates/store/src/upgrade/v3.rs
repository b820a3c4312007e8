//! Version 3: without the outcomes of another physics engine.

use std::path::Path;

use rusqlite::Connection;

use crate::error::InFile;
use crate::{Result, header_table, schema};

/// Adds the table that version 3 lacks. Opening the file checks all tables afterwards.
pub(super) fn step(connection: &Connection, path: &Path) -> Result<()> {
    let header = header_table::read(connection, path)?;
    schema::create(connection, &header).in_file(path)
}
