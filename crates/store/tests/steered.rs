//! The memory of a proposal of simulations.

use crate::sample::{header, record};
use mishandle_store::{IfExists, RunFile, RunWriter, Simulation, StoreError};
use rusqlite::Connection;
use tempfile::TempDir;

fn run(steered: &[(Simulation, Vec<f64>)]) -> (TempDir, std::path::PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    let mut writer = RunWriter::create(&path, &header(), IfExists::Refuse).unwrap();
    writer.start_trial(1, 11).unwrap();
    writer.record(&[record(1, 1)]).unwrap();
    writer.record_steered(steered).unwrap();
    writer.close().unwrap();
    (folder, path)
}

#[test]
fn a_memory_is_read_back_to_the_bit_and_changes_no_digest() {
    let numbers = [0.1, -0.0, f64::MIN_POSITIVE, f64::INFINITY];
    let (_folder, with) = run(&[(record(1, 2), numbers.to_vec())]);
    let file = RunFile::open(&with).unwrap();
    file.check().unwrap();
    let bits = |numbers: &[f64]| numbers.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&file.memory(1, 2).unwrap().unwrap()), bits(&numbers));
    assert_eq!(file.memory(1, 1).unwrap(), None);
    let (_other, without) = run(&[]);
    let other = RunFile::open(&without).unwrap();
    assert_eq!(other.memory(1, 2).unwrap(), None);
    let mut writer = RunWriter::resume(&without).unwrap();
    writer.record(&[record(1, 2)]).unwrap();
    writer.close().unwrap();
    let digest = |path| RunFile::open(path).unwrap().content_digest().unwrap();
    assert_eq!(digest(&with), digest(&without));
}

#[test]
fn a_changed_memory_is_damage() {
    let (_folder, path) = run(&[(record(1, 2), vec![1.0, 2.0])]);
    let changed = "UPDATE memory SET numbers = zeroblob(16)";
    Connection::open(&path).unwrap().execute(changed, []).unwrap();
    let error = RunFile::open(&path).and_then(|run| run.check()).expect_err("the memory is damaged");
    assert!(matches!(error, StoreError::Damaged { .. }), "{error}");
}
