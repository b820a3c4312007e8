//! Tests that need a process of their own, under every runner.

use std::process::Command;

/// Set in the process of one test.
const VARIABLE: &str = "MISHANDLE_TEST_OWN_PROCESS";

/// Runs the body of the test with this name in a process of its own: it changes SQLite for its
/// whole process, or measures the memory of the process.
#[track_caller]
pub fn own_process(test: &str, body: impl FnOnce()) {
    if std::env::var_os(VARIABLE).is_some() {
        return body();
    }
    let mut child = Command::new(std::env::current_exe().unwrap());
    let output = child.args(["--exact", test, "--nocapture"]).env(VARIABLE, "1").output().unwrap();
    let [out, err] =
        [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes).into_owned());
    assert!(output.status.success() && out.contains("1 passed"), "{test}:\n{out}{err}");
    print!("{out}");
}
