//! Brings the files of earlier programs up to the format of this one.

use std::path::Path;

use rusqlite::Connection;

use crate::Result;
use crate::error::{InFile, StoreError};
use crate::schema::APPLICATION_ID;

/// Changes the tables and rows of one version into those of the next.
pub(crate) type Step = fn(&Connection) -> rusqlite::Result<()>;

/// `STEPS[v - 1]` leads from version v to v + 1. A step, once released, is never changed or removed; each comes
/// with a fixture of the version it starts from.
pub(crate) const STEPS: &[Step] = &[];

/// The format version of a run file, which is one that `steps` know how to read.
pub(crate) fn version(connection: &Connection, path: &Path, steps: &[Step]) -> Result<i64> {
    let integer =
        |pragma| connection.pragma_query_value(None, pragma, |row| row.get::<_, i64>(0)).in_file(path);
    let application_id = integer("application_id")?;
    let found = integer("user_version")?;
    let supported = steps.len() as i64 + 1;
    if application_id != APPLICATION_ID {
        let found = "a SQLite database of another program, or one whose making was broken off".into();
        return Err(StoreError::NotARun { found, path: path.into() });
    }
    if found > supported {
        return Err(StoreError::NewerVersion { found, supported, path: path.into() });
    }
    if found < 1 {
        return Err(StoreError::damaged(path, format!("its format version is {found}, they start at 1")));
    }
    Ok(found)
}

/// Takes the steps that a file of version `found` lacks, within the transaction that is open.
pub(crate) fn upgrade(connection: &Connection, path: &Path, found: i64, steps: &[Step]) -> Result<()> {
    for (step, version) in steps.iter().zip(1_i64..).filter(|&(_, version)| version >= found) {
        step(connection).in_file(path)?;
        connection.pragma_update(None, "user_version", version + 1).in_file(path)?;
    }
    Ok(())
}
