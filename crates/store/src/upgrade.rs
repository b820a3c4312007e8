//! Brings the files of earlier programs up to the format of this one.

use std::path::Path;

use rusqlite::Connection;

use crate::Result;
use crate::error::{InFile, StoreError};
use crate::schema::APPLICATION_ID;

mod v1;

/// Changes the tables and rows of one version into those of the next.
pub(crate) type Step = fn(&Connection, &Path) -> Result<()>;

/// `STEPS[v - 1]` leads from version v to v + 1. The result of a released step never changes; a fixture of the
/// version it starts from, with values stated by hand, tests that.
///
/// The last step writes with the code of the current version. The commit that adds the next version moves what the
/// step needs of that code into the step's file.
pub(crate) const STEPS: &[Step] = &[v1::step];

/// The format version of a run file, which is one that `steps` know how to read.
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
        return Err(StoreError::damaged(path, format!("its format version is {found}, they start at 1")));
    }
    Ok(found)
}

/// Takes the steps that a file of version `found` lacks, within the transaction that is open.
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

    /// What the steps from version 2 on might look like: a new value, then a change of it.
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
    fn opening_an_older_file_takes_the_steps_it_lacks() {
        for version in [1, 2] {
            let (_folder, path) = copy_of_version(version);
            let upgraded = RunFile::open_with(&path, FUTURE).unwrap();
            let (_other_folder, other_path) = copy_of_version(version);
            let digest = RunFile::open(&other_path).unwrap().content_digest().unwrap();
            assert_eq!(upgraded.content_digest().unwrap(), digest);
            drop(upgraded);
            assert_eq!(note(&path).unwrap(), "from version 2, then 3");
            // A second time there is nothing left to do: the insertion would fail.
            RunFile::open_with(&path, FUTURE).unwrap();
            RunWriter::resume_with(&path, FUTURE).unwrap();
        }
    }

    #[test]
    fn steps_already_taken_are_left_out() {
        let (_folder, path) = copy_of_version(1);
        for count in 1..=FUTURE.len() {
            RunWriter::resume_with(&path, &FUTURE[..count]).unwrap().close().unwrap();
        }
        assert_eq!(note(&path).unwrap(), "from version 2, then 3");
    }

    #[test]
    fn a_step_that_fails_leaves_the_file_as_it_was() {
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
    fn the_program_from_before_the_upgrade_refuses_the_file() {
        let (_folder, path) = copy_of_version(2);
        RunWriter::resume_with(&path, FUTURE).unwrap().close().unwrap();
        let error = RunFile::open(&path).unwrap_err();
        assert!(matches!(error, StoreError::NewerVersion { found: 4, supported: 2, .. }), "{error}");
    }
}
