//! `cargo xtask deny`: checks advisories, licenses, duplicates and sources of all dependencies with
//! cargo-deny.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};

use crate::process::{cargo, output, run};

/// The manifests whose dependencies are checked, from the root. `fuzz` has a lock file of its own.
const MANIFESTS: [&str; 2] = ["Cargo.toml", "fuzz/Cargo.toml"];

const INSTALL: &str = "cargo install cargo-deny --locked";

/// Checks all dependencies. With `--fetch`, downloads the RustSec advisory database first.
///
/// # Errors
/// If cargo-deny is not installed, or finds a problem.
pub fn deny(root: &Path, arguments: &[String]) -> Result<()> {
    let fetches = match arguments {
        [] => false,
        [flag] if flag == "--fetch" => true,
        [other, ..] => bail!("unknown argument `{other}`; expected --fetch or nothing"),
    };
    ensure!(is_installed(root), "cargo-deny is not installed; install it with `{INSTALL}`");
    if fetches {
        run(&mut cargo(root, &["deny", "fetch", "db"]), &[0])?;
    }
    check(root)
}

/// The step of `cargo xtask test`. Prints what it skips.
///
/// # Errors
/// If a lock file is out of date, or cargo-deny finds a problem.
pub fn check_if_installed(root: &Path) -> Result<()> {
    for manifest in MANIFESTS {
        output(&mut cargo(
            root,
            &["metadata", "--locked", "--format-version=1", "--manifest-path", manifest],
        ))?;
    }
    if is_installed(root) {
        return check(root);
    }
    eprintln!("SKIPPED: advisories, licenses, duplicates and sources, because cargo-deny is not installed");
    eprintln!("install it with `{INSTALL}`");
    Ok(())
}

fn is_installed(root: &Path) -> bool {
    cargo(root, &["deny", "--version"]).output().is_ok_and(|output| output.status.success())
}

fn check(root: &Path) -> Result<()> {
    let snapshot = snapshot(&advisory_databases()?)?;
    let mut checks = vec!["licenses", "bans", "sources"];
    match &snapshot {
        Some(snapshot) => {
            eprintln!("advisories of {snapshot}");
            checks.push("advisories");
        }
        None => eprintln!(
            "SKIPPED: advisories, because this machine has no snapshot of the RustSec database; download it with \
             `cargo xtask deny --fetch`"
        ),
    }
    for manifest in MANIFESTS {
        // Offline: the result depends on the files of this machine only.
        let arguments = ["deny", "--offline", "--config", "deny.toml", "--manifest-path", manifest, "check"];
        // deny.toml covers both manifests, so one of them does not need each rule.
        let unused_rules = ["--allow", "license-exception-not-encountered", "--allow", "unmatched-skip"];
        run(cargo(root, &arguments).args(unused_rules).args(&checks), &[0])?;
    }
    Ok(())
}

/// Returns the folder in which cargo-deny stores advisory databases.
fn advisory_databases() -> Result<PathBuf> {
    let home = std::env::var_os("CARGO_HOME").map(PathBuf::from);
    let home = home.or_else(|| Some(PathBuf::from(std::env::var_os("HOME")?).join(".cargo")));
    Ok(home.context("neither CARGO_HOME nor HOME is set")?.join("advisory-dbs"))
}

/// Returns date and commit of the advisory database; `None` if it was never downloaded.
fn snapshot(folder: &Path) -> Result<Option<String>> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Ok(None) };
    for entry in entries {
        let database = entry?.path();
        if database.join(".git").exists() {
            let log = ["log", "-1", "--format=%cs, commit %H"];
            return output(Command::new("git").arg("-C").arg(&database).args(log))
                .map(|text| Some(text.trim().to_owned()));
        }
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unknown_argument_is_an_error() {
        let error = deny(Path::new("."), &["--all".to_owned()]).unwrap_err().to_string();
        assert_eq!(error, "unknown argument `--all`; expected --fetch or nothing");
    }

    #[test]
    fn a_missing_snapshot_is_no_error() {
        assert_eq!(snapshot(Path::new("target/no-such-folder")).unwrap(), None);
    }
}
