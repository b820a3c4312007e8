//! Brings the files of earlier programs up to the format of this one.

use std::path::Path;

use rusqlite::Connection;

use crate::Result;
use crate::error::{InFile, StoreError};
use crate::schema::APPLICATION_ID;

/// Changes the tables and rows of one version into those of the next.
pub(crate) type Step = fn(&Connection) -> rusqlite::Result<()>;

/// `STEPS[v - 1]` leads from version v to v + 1. A step, once released, is never changed or removed; each
/// comes with a fixture of the version it starts from.
pub(crate) const STEPS: &[Step] = &[];

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
        step(connection).in_file(path)?;
        connection.pragma_update(None, "user_version", version + 1).in_file(path)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{RunFile, RunWriter};

    /// What steps might look like: a new column, then its value for the rows that are there.
    const FUTURE: &[Step] = &[
        |connection| connection.execute_batch("ALTER TABLE trial ADD COLUMN note TEXT"),
        |connection| connection.execute_batch("UPDATE trial SET note = 'from version ' || 1"),
    ];

    fn copy_of_version_1() -> (tempfile::TempDir, std::path::PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.sqlite");
        std::fs::copy("tests/fixtures/v1.sqlite", &path).unwrap();
        (folder, path)
    }

    fn notes(path: &Path) -> rusqlite::Result<Vec<String>> {
        let connection = Connection::open(path)?;
        let mut select = connection.prepare("SELECT note FROM trial")?;
        select.query_map([], |row| row.get(0))?.collect()
    }

    #[test]
    fn opening_an_older_file_takes_the_steps_it_lacks() {
        let (_folder, path) = copy_of_version_1();
        let digest = RunFile::open(&path).unwrap().content_digest().unwrap();
        let upgraded = RunFile::open_with(&path, FUTURE).unwrap();
        assert_eq!(upgraded.content_digest().unwrap(), digest);
        drop(upgraded);
        assert_eq!(notes(&path).unwrap(), ["from version 1"; 4]);
        // A second time there is nothing left to do: the first step would fail.
        RunFile::open_with(&path, FUTURE).unwrap();
        RunWriter::resume_with(&path, FUTURE).unwrap();
    }

    #[test]
    fn steps_already_taken_are_left_out() {
        let (_folder, path) = copy_of_version_1();
        RunWriter::resume_with(&path, &FUTURE[..1]).unwrap().close().unwrap();
        RunWriter::resume_with(&path, FUTURE).unwrap().close().unwrap();
        assert_eq!(notes(&path).unwrap(), ["from version 1"; 4]);
    }

    #[test]
    fn a_step_that_fails_leaves_the_file_as_it_was() {
        let (_folder, path) = copy_of_version_1();
        let failing: [Step; 2] =
            [FUTURE[0], |connection| connection.execute_batch("UPDATE nothing SET x = 1")];
        assert!(RunFile::open_with(&path, &failing).is_err());
        assert!(notes(&path).is_err(), "the first step's column is still there");
        RunFile::open(&path).unwrap().check().unwrap();
    }

    #[test]
    fn the_program_from_before_the_upgrade_refuses_the_file() {
        let (_folder, path) = copy_of_version_1();
        RunWriter::resume_with(&path, FUTURE).unwrap().close().unwrap();
        let error = RunFile::open(&path).unwrap_err();
        assert!(matches!(error, StoreError::NewerVersion { found: 3, supported: 1, .. }), "{error}");
    }
}
