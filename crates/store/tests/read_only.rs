//! Read-only runs can be read, and the error of writing them names the cause.
//!
//! Root ignores permissions, so the checks run in a separate process as an ordinary user.

#![cfg(unix)]

use std::fs::{Permissions, copy, create_dir, metadata, set_permissions};
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::sample::{header, record};
use mishandle_store::{IfExists, RunFile, RunWriter, StoreError};

const FOLDER: &str = "MISHANDLE_STORE_TEST_FOLDER";
const ROOT: u32 = 0;
const NOBODY: u32 = 65_534;

fn allow(path: &Path, mode: u32) {
    set_permissions(path, Permissions::from_mode(mode)).unwrap();
}

/// The checks. Without the environment variable, as an ordinary test, it does nothing.
#[test]
fn as_an_ordinary_user() {
    let Some(folder) = std::env::var_os(FOLDER).map(PathBuf::from) else { return };
    let closed = folder.join("closed/run.sqlite");
    let killed = folder.join("killed/run.sqlite");
    let secret = folder.join("secret.sqlite");

    assert_eq!(RunFile::open(&closed).unwrap().last_simulation_number(1).unwrap(), 1);
    let error = RunWriter::resume(&closed).unwrap_err();
    assert!(matches!(error, StoreError::ReadOnly { .. }), "{error}");
    let error = RunWriter::create(folder.join("closed/new.sqlite"), &header(), IfExists::Refuse).unwrap_err();
    assert!(matches!(error, StoreError::ReadOnly { .. }), "{error}");
    let error = RunWriter::create(&closed, &header(), IfExists::Replace).unwrap_err();
    assert!(matches!(error, StoreError::ReadOnly { .. }), "{error}");

    let error = RunFile::open(&killed).unwrap_err();
    assert!(matches!(error, StoreError::NotClosed { .. }), "{error}");
    let error = RunFile::open(&secret).unwrap_err();
    assert!(matches!(error, StoreError::CannotOpen { .. }), "{error}");
    println!("all checked");
}

#[test]
fn runs_in_a_read_only_folder_are_readable_and_not_writable() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name);
    create_dir(place("closed")).unwrap();
    create_dir(place("killed")).unwrap();
    let mut writer = RunWriter::create(place("closed/run.sqlite"), &header(), IfExists::Refuse).unwrap();
    writer.start_trial(1, 0).unwrap();
    writer.record(&[record(1, 1)]).unwrap();
    // The files that a kill at this moment would leave.
    copy(place("closed/run.sqlite"), place("killed/run.sqlite")).unwrap();
    copy(place("closed/run.sqlite-wal"), place("killed/run.sqlite-wal")).unwrap();
    writer.close().unwrap();
    copy(place("closed/run.sqlite"), place("secret.sqlite")).unwrap();

    let program = place("program");
    copy(std::env::current_exe().unwrap(), &program).unwrap();
    allow(&program, 0o755);
    allow(folder.path(), 0o755);
    allow(&place("secret.sqlite"), 0o000);
    for file in ["closed/run.sqlite", "killed/run.sqlite", "killed/run.sqlite-wal"] {
        allow(&place(file), 0o444);
    }
    for name in ["closed", "killed"] {
        allow(&place(name), 0o555);
    }
    let mut checks = Command::new(&program);
    checks.args(["--exact", "read_only::as_an_ordinary_user", "--nocapture"]).env(FOLDER, folder.path());
    if metadata("/proc/self").map_or(ROOT + 1, |process| process.uid()) == ROOT {
        checks.uid(NOBODY).gid(NOBODY);
    }
    let output = checks.output().unwrap();
    for name in ["closed", "killed"] {
        allow(&place(name), 0o755); // so that they can be removed
    }
    let output_text = String::from_utf8_lossy(&output.stdout);
    assert!(output_text.contains("all checked"), "{output_text}{}", String::from_utf8_lossy(&output.stderr));
}
