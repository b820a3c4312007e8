//! A file that is damaged, not a run, read-only or missing gives one clear error, never wrong
//! values.

use std::path::{Path, PathBuf};

use crate::sample::{header, record, traced_record};
use mishandle_store::{IfExists, Result, RunFile, RunWriter, StoreError};
use tempfile::TempDir;

fn small_run() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    let mut writer = RunWriter::create(&path, &header(), IfExists::Refuse).unwrap();
    for trial in 1..=3 {
        writer.start_trial(trial, 1 << trial).unwrap();
        let records: Vec<_> = (1..=40).map(|number| record(trial, number)).collect();
        writer.record(&records).unwrap();
        writer.record(&[traced_record(trial, 41)]).unwrap();
    }
    writer.close().unwrap();
    (folder, path)
}

/// Returns everything that a reader can read.
fn content(path: &Path) -> Result<String> {
    let run = RunFile::open(path)?;
    run.check()?;
    let mut content = format!("{:?} {:x} ", run.header(), run.content_digest()?);
    for (trial, number) in run.stored_traces()? {
        content += &format!("{:?} ", run.simulation(trial, number)?);
    }
    Ok(content)
}

/// Reproducible random numbers (xorshift).
fn noise(seed: u64) -> impl Iterator<Item = u64> {
    std::iter::successors(Some(seed), |&x| {
        let x = x ^ x << 13;
        let x = x ^ x >> 7;
        Some(x ^ x << 17)
    })
    .skip(8)
}

#[test]
fn changed_bytes_are_detected_or_have_no_effect() {
    let (_folder, path) = small_run();
    let bytes = std::fs::read(&path).unwrap();
    let expected = content(&path).unwrap();
    let mut detected = 0;
    let places = noise(1).zip(noise(2)).take(600);
    for (place, change) in
        places.map(|(place, change)| (place as usize % bytes.len(), 1 + (change % 255) as u8))
    {
        let mut damaged = bytes.clone();
        damaged[place] ^= change;
        std::fs::write(&path, &damaged).unwrap();
        match content(&path) {
            Err(_) => detected += 1,
            Ok(read) => assert!(read == expected, "byte {place} changed by {change:#x}"),
        }
    }
    assert!(detected > 100, "only {detected} of 600 changes were detected");
}

#[test]
fn a_truncated_file_is_an_error() {
    let (_folder, path) = small_run();
    let bytes = std::fs::read(&path).unwrap();
    for length in
        [1, 15, 16, 100, 512, 4095, 4096, 8192, bytes.len() / 2, bytes.len() - 4096, bytes.len() - 1]
    {
        std::fs::write(&path, &bytes[..length]).unwrap();
        let error = content(&path).unwrap_err();
        let expected = matches!(error, StoreError::Damaged { .. } | StoreError::NotARun { .. });
        assert!(expected, "cut to {length} bytes: {error}");
    }
}

#[test]
fn overwritten_pages_are_an_error() {
    let (_folder, path) = small_run();
    let bytes = std::fs::read(&path).unwrap();
    for page in 0..bytes.len() / 4096 {
        let mut damaged = bytes.clone();
        let random = noise(page as u64 + 1).flat_map(u64::to_le_bytes);
        damaged[page * 4096..(page + 1) * 4096]
            .iter_mut()
            .zip(random)
            .for_each(|(byte, random)| *byte = random);
        std::fs::write(&path, &damaged).unwrap();
        let outcome = RunFile::open(&path).and_then(|run| run.check());
        let expected = matches!(outcome, Err(StoreError::Damaged { .. } | StoreError::NotARun { .. }));
        assert!(expected, "page {page}: {outcome:?}");
    }
}

#[track_caller]
fn check_message(outcome: Result<impl Sized>, message: &str, path: &Path) {
    let Err(error) = outcome else { panic!("expected: {message}") };
    assert_eq!(error.to_string(), format!("{message}: {}", path.display()));
}

#[test]
fn a_file_that_is_not_a_run_is_reported_and_left_unchanged() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file");
    let not_a_run = "not a run file: expected a SQLite database made by mishandle, found";
    let other = "a SQLite database of another program";
    let empty = "the run file is empty: the program that created it was stopped before the first simulation, or it was \
                 copied without the file ending in `-wal` beside it; start the run again, which replaces the file";

    check_message(RunFile::open(folder.path()), &format!("{not_a_run} a folder or a device"), folder.path());
    std::fs::write(&path, "").unwrap();
    check_message(RunFile::open(&path), empty, &path);
    check_message(RunWriter::resume(&path), empty, &path);

    std::fs::write(&path, "trial,simulation\n1,1\n".repeat(400)).unwrap();
    check_message(RunFile::open(&path), &format!("{not_a_run} a file of another kind"), &path);
    check_message(RunWriter::resume(&path), &format!("{not_a_run} a file of another kind"), &path);
    let replaced = RunWriter::create(&path, &header(), IfExists::Replace);
    check_message(replaced, &format!("{not_a_run} a file of another kind"), &path);
    assert!(std::fs::read_to_string(&path).unwrap().starts_with("trial"));

    std::fs::remove_file(&path).unwrap();
    rusqlite::Connection::open(&path).unwrap().execute_batch("CREATE TABLE t (x)").unwrap();
    check_message(RunFile::open(&path), &format!("{not_a_run} {other}"), &path);
    check_message(RunWriter::resume(&path), &format!("{not_a_run} {other}"), &path);
    check_message(
        RunWriter::create(&path, &header(), IfExists::Replace),
        &format!("{not_a_run} {other}"),
        &path,
    );
}

#[test]
fn an_empty_file_can_be_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run");
    for content in ["x", "my notes"] {
        std::fs::write(&path, content).unwrap();
        let error = RunWriter::create(&path, &header(), IfExists::Refuse).unwrap_err();
        assert!(matches!(error, StoreError::Exists { .. }), "{error}");
        assert_eq!(std::fs::read_to_string(&path).unwrap(), content);
    }
    for existing in [IfExists::Refuse, IfExists::Replace] {
        std::fs::write(&path, "").unwrap();
        let mut writer = RunWriter::create(&path, &header(), existing).unwrap();
        writer.start_trial(1, 1).unwrap();
        writer.close().unwrap();
        assert_eq!(RunFile::open(&path).unwrap().trials().unwrap().len(), 1);
    }
}

#[test]
fn a_run_whose_creation_was_interrupted_is_reported_and_can_be_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run");
    // The first step of creating a run. The tables are created afterwards, in one transaction.
    rusqlite::Connection::open(&path).unwrap().pragma_update(None, "journal_mode", "WAL").unwrap();
    assert!(matches!(RunFile::open(&path), Err(StoreError::Unfinished { .. })));
    assert!(matches!(RunWriter::resume(&path), Err(StoreError::Unfinished { .. })));
    RunWriter::create(&path, &header(), IfExists::Refuse).unwrap();
}

#[test]
fn a_creation_that_left_a_rollback_journal_is_reported_as_unfinished_at_the_first_try() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run");
    let journal = folder.path().join("run-journal");
    // A transaction that SQLite begins to write before its end, in a file that was empty.
    let connection = rusqlite::Connection::open(folder.path().join("original")).unwrap();
    let sql = "PRAGMA cache_size = 1; BEGIN; CREATE TABLE t (x); INSERT INTO t VALUES (zeroblob(100000))";
    connection.execute_batch(sql).unwrap();
    let leave = || {
        std::fs::copy(folder.path().join("original"), &path).unwrap();
        std::fs::copy(folder.path().join("original-journal"), &journal).unwrap();
        assert!(path.metadata().unwrap().len() > 0 && journal.metadata().unwrap().len() > 0);
    };
    leave();
    let resumed = RunWriter::resume(&path).unwrap_err();
    assert!(matches!(resumed, StoreError::Unfinished { .. }), "{resumed}");
    leave();
    let opened = RunFile::open(&path).unwrap_err();
    assert!(matches!(opened, StoreError::Unfinished { .. }), "{opened}");
    leave();
    RunWriter::create(&path, &header(), IfExists::Refuse).unwrap().close().unwrap();
    RunFile::open(&path).unwrap();
}

#[test]
fn a_copy_without_its_log_is_an_error_and_a_closed_run_is_a_single_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    let copy = folder.path().join("copy.sqlite");
    let mut writer = RunWriter::create(&path, &header(), IfExists::Refuse).unwrap();
    writer.start_trial(1, 1).unwrap();
    writer.record(&[record(1, 1)]).unwrap();
    std::fs::copy(&path, &copy).unwrap();
    let error = RunFile::open(&copy).err().unwrap().to_string();
    assert!(error.contains("copied without the file ending in `-wal`"), "{error}");
    writer.close().unwrap();
    std::fs::copy(&path, &copy).unwrap();
    assert_eq!(RunFile::open(&copy).unwrap().counts().unwrap().simulations, 1);
}

#[test]
fn a_locked_run_is_an_error_that_names_the_file() {
    let (_folder, path) = small_run();
    let other = rusqlite::Connection::open(&path).unwrap();
    other.execute_batch("BEGIN EXCLUSIVE").unwrap();
    let message = "another process is writing this run; wait until it ends, or stop it";
    check_message(RunFile::open(&path), message, &path);
    check_message(RunWriter::resume(&path), message, &path);
    other.execute_batch("ROLLBACK").unwrap();
    RunWriter::resume(&path).unwrap();
}

#[test]
fn a_newer_format_is_an_error_that_names_both_versions() {
    let (_folder, path) = small_run();
    rusqlite::Connection::open(&path).unwrap().pragma_update(None, "user_version", 9).unwrap();
    let message = "the run file has format version 9, this program reads version 5; use a newer program";
    check_message(RunFile::open(&path), message, &path);
    check_message(RunWriter::resume(&path), message, &path);
    RunWriter::create(&path, &header(), IfExists::Replace).unwrap();
}

#[test]
fn an_older_format_is_an_error_that_names_both_versions() {
    for version in 1..5 {
        let (_folder, path) = small_run();
        rusqlite::Connection::open(&path).unwrap().pragma_update(None, "user_version", version).unwrap();
        let before = std::fs::read(&path).unwrap();
        let message = format!(
            "the run file has format version {version}, this program reads version 5; run its plan again, or use the \
             program that wrote the file"
        );
        check_message(RunFile::open(&path), &message, &path);
        check_message(RunWriter::resume(&path), &message, &path);
        assert!(std::fs::read(&path).unwrap() == before, "the file has changed");
        RunWriter::create(&path, &header(), IfExists::Replace).unwrap();
    }
}

#[test]
fn a_missing_file_or_folder_is_an_error_that_names_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("nowhere/run.sqlite");
    check_message(RunFile::open(&path), "cannot open a run: the file does not exist", &path);
    let created = RunWriter::create(&path, &header(), IfExists::Refuse);
    check_message(created, "cannot open a run: the folder does not exist", &path);
}
