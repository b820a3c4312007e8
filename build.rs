//! Tells the program which commit, target and compiler it was built from: run records and controllers name them.

use std::process::Command;

/// What the program is built from. What else may have changed, a page or a figure, is none of its business.
const SOURCES: [&str; 5] = ["build.rs", "Cargo.toml", "Cargo.lock", "src", "crates"];

fn main() {
    // Whether anything is changed can be told only by looking whenever something is.
    for file in SOURCES {
        println!("cargo::rerun-if-changed={file}");
    }
    if let Some(folder) = output("git", &["rev-parse", "--git-dir"]) {
        println!("cargo::rerun-if-changed={folder}/HEAD");
        println!("cargo::rerun-if-changed={folder}/index");
    }
    let commit = output("git", &["rev-parse", "--short=12", "HEAD"]).unwrap_or_else(|| "unknown".to_string());
    let status = [&["status", "--porcelain", "--untracked-files=no", "--"], &SOURCES[..]].concat();
    let changed = output("git", &status).is_some_and(|s| !s.is_empty());
    println!("cargo::rustc-env=MISHANDLE_COMMIT={commit}{}", if changed { "-changed" } else { "" });
    let rustc = std::env::var("RUSTC").ok().and_then(|rustc| output(&rustc, &["--version"]));
    println!("cargo::rustc-env=MISHANDLE_RUSTC={}", rustc.unwrap_or_default());
    println!("cargo::rustc-env=MISHANDLE_TARGET={}", std::env::var("TARGET").unwrap_or_default());
}

fn output(program: &str, arguments: &[&str]) -> Option<String> {
    let output = Command::new(program).args(arguments).output().ok()?;
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_string())
}
