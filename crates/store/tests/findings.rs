//! Answers of further simulations about recorded ones.

use crate::sample::{header, record};
use mishandle_store::{Finding, IfExists, RunFile, RunWriter, StoreError};
use rusqlite::Connection;
use tempfile::TempDir;

fn finding(number: u32, kind: &str, value: &str) -> Finding {
    Finding { trial: 1, number, kind: kind.to_string(), value: value.to_string() }
}

fn run(findings: &[Finding]) -> (TempDir, std::path::PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    let mut writer = RunWriter::create(&path, &header(), IfExists::Refuse).unwrap();
    writer.start_trial(1, 11).unwrap();
    writer.record(&[record(1, 1), record(1, 2)]).unwrap();
    writer.record_findings(findings).unwrap();
    writer.close().unwrap();
    (folder, path)
}

#[test]
fn a_finding_replaces_that_of_its_kind_and_changes_no_digest() {
    let (_folder, path) = run(&[finding(1, "a", "{}"), finding(1, "b", "[1]"), finding(1, "a", "[2]")]);
    let file = RunFile::open(&path).unwrap();
    file.check().unwrap();
    assert_eq!(file.finding(1, 1, "a").unwrap().as_deref(), Some("[2]"));
    assert_eq!(file.finding(1, 1, "b").unwrap().as_deref(), Some("[1]"));
    assert_eq!(file.finding(1, 2, "a").unwrap(), None);
    let (_other, without) = run(&[]);
    let other = RunFile::open(&without).unwrap();
    assert_eq!(other.finding(1, 1, "a").unwrap(), None);
    assert_eq!(file.content_digest().unwrap(), other.content_digest().unwrap());
}

#[test]
fn a_finding_of_no_simulation_is_refused() {
    let (_folder, path) = run(&[]);
    let mut writer = RunWriter::resume(&path).unwrap();
    writer.record_findings(&[finding(1, "a", "{}"), finding(3, "a", "{}")]).unwrap_err();
    writer.close().unwrap();
    assert_eq!(RunFile::open(&path).unwrap().finding(1, 1, "a").unwrap(), None);
}

#[test]
fn a_changed_finding_is_damage() {
    let (_folder, path) = run(&[finding(1, "a", "{}")]);
    Connection::open(&path).unwrap().execute("UPDATE finding SET value = '[]'", []).unwrap();
    let error = RunFile::open(&path).and_then(|run| run.check()).expect_err("the finding is damaged");
    assert!(matches!(error, StoreError::Damaged { .. }), "{error}");
}
