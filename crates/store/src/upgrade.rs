//! Upgrades run files of older formats.

use std::path::Path;

use rusqlite::Connection;

use crate::Result;
use crate::error::{InFile, StoreError};
use crate::schema::APPLICATION_ID;

mod v1;

/// Converts the tables and rows of one version to those of the next.
pub(crate) type Step = fn(&Connection, &Path) -> Result<()>;

/// `STEPS[v - 1]` upgrades version v to v + 1. The result of a released step never changes. A fixture of version v,
/// with values stated by hand, tests that.
///
/// The last step writes with the code of the current version. The commit that adds the next version copies the code
/// that the step uses into the step's file.
pub(crate) const STEPS: &[Step] = &[v1::step];

/// Returns the format version of a run file. A version that `steps` cannot upgrade is an error.
pub(crate) fn version(connection: &Connection, path: &Path, steps: &[Step]) -> Result<i64> {
    let integer =
        |pragma| connection.pragma_query_value(None, pragma, |row| row.get::<_, i64>(0)).in_file(path);
    let application_id = integer("application_id")?;
    let found = integer("user_version")?;
    let supported = steps.len() as i64 + 1;
    if application_id != APPLICATION_ID {
        return Err(StoreError::of_another_program(path));
    }
    if found > supported {
        return Err(StoreError::NewerVersion { found, supported, path: path.into() });
    }
    if found < 1 {
        return Err(StoreError::damaged(path, format!("its format version is {found}; versions start at 1")));
    }
    Ok(found)
}

/// Upgrades a file of version `found` in the open transaction.
pub(crate) fn upgrade(connection: &Connection, path: &Path, found: i64, steps: &[Step]) -> Result<()> {
    for (step, version) in steps.iter().zip(1_i64..).filter(|&(_, version)| version >= found) {
        step(connection, path)?;
        connection.pragma_update(None, "user_version", version + 1).in_file(path)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{RunFile, RunWriter};

    /// Examples of future steps: version 3 adds a value, version 4 changes it.
    const FUTURE: &[Step] = &[
        v1::step,
        |connection, path| {
            let sql = "INSERT INTO header (key, value) VALUES ('note', 'from version 2')";
            connection.execute_batch(sql).in_file(path)
        },
        |connection, path| {
            let sql = "UPDATE header SET value = value || ', then 3' WHERE key = 'note'";
            connection.execute_batch(sql).in_file(path)
        },
    ];

    fn copy_of_version(version: u32) -> (tempfile::TempDir, std::path::PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.sqlite");
        std::fs::copy(format!("tests/fixtures/v{version}.sqlite"), &path).unwrap();
        (folder, path)
    }

    fn note(path: &Path) -> rusqlite::Result<String> {
        let select = "SELECT value FROM header WHERE key = 'note'";
        Connection::open(path)?.query_row(select, [], |row| row.get(0))
    }

    #[test]
    fn opening_an_older_file_applies_the_missing_steps() {
        for version in [1, 2] {
            let (_folder, path) = copy_of_version(version);
            let upgraded = RunFile::open_with(&path, FUTURE).unwrap();
            let (_other_folder, other_path) = copy_of_version(version);
            let digest = RunFile::open(&other_path).unwrap().content_digest().unwrap();
            assert_eq!(upgraded.content_digest().unwrap(), digest);
            drop(upgraded);
            assert_eq!(note(&path).unwrap(), "from version 2, then 3");
            // Opening it again applies no step: a second insertion would fail.
            RunFile::open_with(&path, FUTURE).unwrap();
            RunWriter::resume_with(&path, FUTURE).unwrap();
        }
    }

    #[test]
    fn steps_are_applied_only_once() {
        let (_folder, path) = copy_of_version(1);
        for count in 1..=FUTURE.len() {
            RunWriter::resume_with(&path, &FUTURE[..count]).unwrap().close().unwrap();
        }
        assert_eq!(note(&path).unwrap(), "from version 2, then 3");
    }

    #[test]
    fn a_failed_step_leaves_the_file_unchanged() {
        let failing: &[Step] =
            &[FUTURE[0], FUTURE[1], |_, path| Err(StoreError::damaged(path, "a step failed"))];
        for version in [1, 2] {
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
        RunWriter::resume_with(&path, FUTURE).unwrap().close().unwrap();
        let error = RunFile::open(&path).unwrap_err();
        assert!(matches!(error, StoreError::NewerVersion { found: 4, supported: 2, .. }), "{error}");
    }
}
