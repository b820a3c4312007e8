//! Upgrades run files of older formats.

use std::path::Path;

use rusqlite::Connection;

use crate::Result;
use crate::error::{InFile, StoreError};
use crate::schema::APPLICATION_ID;

mod v1;
mod v2;
mod v3;

/// Converts the tables and rows of one version to those of the current version.
pub(crate) type Step = fn(&Connection, &Path) -> Result<()>;

/// `STEPS[v - 1]` upgrades version v to the current version. A fixture of version v, with values stated by hand, tests it.
///
/// A step reads with its own copy of what has changed since its version, and writes with the code of the current version.
pub(crate) const STEPS: &[Step] = &[v1::step, v2::step, v3::step];

/// Returns the format version of a run file. A version that `steps` cannot upgrade is an error.
pub(crate) fn version(connection: &Connection, path: &Path, steps: &[Step]) -> Result<i64> {
    let integer =
        |pragma| connection.pragma_query_value(None, pragma, |row| row.get::<_, i64>(0)).in_file(path);
    let application_id = integer("application_id")?;
    let found = integer("user_version")?;
    let supported = steps.len() as i64 + 1;
    if application_id != APPLICATION_ID {
        let objects: i64 =
            connection.query_row("SELECT count(*) FROM sqlite_schema", [], |row| row.get(0)).in_file(path)?;
        // A run gets its ID and its tables in one transaction. If that was interrupted, SQLite makes the file empty again.
        // It also takes a file of one byte for an empty database.
        let is_one_byte = std::fs::metadata(path).is_ok_and(|found| found.len() == 1);
        return Err(if !is_one_byte && (application_id, found, objects) == (0, 0, 0) {
            StoreError::Unfinished { path: path.into() }
        } else {
            StoreError::of_another_program(path)
        });
    }
    if found > supported {
        return Err(StoreError::NewerVersion { found, supported, path: path.into() });
    }
    if found < 1 {
        return Err(StoreError::damaged(path, format!("its format version is {found}; versions start at 1")));
    }
    Ok(found)
}

/// Upgrades a file of version `found` in the open transaction, and returns whether it had to be upgraded.
pub(crate) fn upgrade(connection: &Connection, path: &Path, found: i64, steps: &[Step]) -> Result<bool> {
    let Some(step) = usize::try_from(found - 1).ok().and_then(|index| steps.get(index)) else {
        return Ok(false);
    };
    step(connection, path)?;
    connection.pragma_update(None, "user_version", steps.len() as i64 + 1).in_file(path)?;
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{RunFile, RunWriter};

    /// The steps of a future version 5, whose header contains another value.
    const FUTURE: &[Step] = &[
        |connection, path| v1::step(connection, path).and_then(|()| add_note(connection, path, 1)),
        |connection, path| v2::step(connection, path).and_then(|()| add_note(connection, path, 2)),
        |connection, path| v3::step(connection, path).and_then(|()| add_note(connection, path, 3)),
        |connection, path| add_note(connection, path, 4),
    ];

    fn add_note(connection: &Connection, path: &Path, version: u32) -> Result<()> {
        let mut header = crate::header_table::read(connection, path)?;
        header.build.program_version += &format!(" from version {version}");
        for table in ["header", "version", "component", "formula", "signal", "axis", "verdict"] {
            connection.execute(&format!("DELETE FROM {table}"), []).in_file(path)?;
        }
        crate::header_table::write(connection, &header).in_file(path)
    }

    fn copy_of_version(version: u32) -> (tempfile::TempDir, std::path::PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.sqlite");
        std::fs::copy(format!("tests/fixtures/v{version}.sqlite"), &path).unwrap();
        (folder, path)
    }

    fn note(path: &Path) -> rusqlite::Result<String> {
        let select = "SELECT value FROM header WHERE key = 'program_version'";
        Connection::open(path)?.query_row(select, [], |row| row.get(0))
    }

    #[test]
    fn opening_an_older_file_applies_the_step_of_its_version_once() {
        for version in [1, 2, 3, 4] {
            let (_folder, path) = copy_of_version(version);
            let upgraded = RunFile::open_with(&path, FUTURE).unwrap();
            let (_other_folder, other_path) = copy_of_version(version);
            let digest = RunFile::open(&other_path).unwrap().content_digest().unwrap();
            assert_eq!(upgraded.content_digest().unwrap(), digest);
            drop(upgraded);
            let noted = note(&path).unwrap();
            assert!(noted.ends_with(&format!(" from version {version}")), "{noted}");
            // Opening it again applies no step.
            RunFile::open_with(&path, FUTURE).unwrap();
            RunWriter::resume_with(&path, FUTURE, false).unwrap();
            assert_eq!(note(&path).unwrap(), noted);
        }
    }

    #[test]
    fn a_failed_step_leaves_the_file_unchanged() {
        let failing: &[Step] = &[
            |connection, path| v1::step(connection, path).and_then(|()| fail(path)),
            |connection, path| v2::step(connection, path).and_then(|()| fail(path)),
            |connection, path| v3::step(connection, path).and_then(|()| fail(path)),
            |_, path| fail(path),
        ];
        fn fail(path: &Path) -> Result<()> {
            Err(StoreError::damaged(path, "a step failed"))
        }
        for version in [1, 2, 3, 4] {
            let (_folder, path) = copy_of_version(version);
            let before = std::fs::read(&path).unwrap();
            assert!(RunFile::open_with(&path, failing).is_err());
            let connection = Connection::open(&path).unwrap();
            let found = connection.pragma_query_value(None, "user_version", |row| row.get::<_, u32>(0));
            assert_eq!(found.unwrap(), version);
            drop(connection);
            assert!(std::fs::read(&path).unwrap() == before, "the file has changed");
            RunFile::open(&path).unwrap().check().unwrap();
        }
    }

    #[test]
    fn an_older_program_rejects_an_upgraded_file() {
        let (_folder, path) = copy_of_version(2);
        RunWriter::resume_with(&path, FUTURE, false).unwrap().close().unwrap();
        let error = RunFile::open(&path).unwrap_err();
        assert!(matches!(error, StoreError::NewerVersion { found: 5, supported: 4, .. }), "{error}");
    }
}
