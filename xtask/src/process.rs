//! Runs other programs. An error message contains the command.

use std::ffi::OsStr;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, ensure};

/// Environment variables that would override `.cargo/config.toml`, which pins the instruction set
/// and the path of MuJoCo's library.
const OVERRIDES: [&str; 4] = ["RUSTFLAGS", "CARGO_ENCODED_RUSTFLAGS", "RUSTDOCFLAGS", "CARGO_TARGET_DIR"];

/// Returns `cargo` with these arguments in the repository's root: the same cargo that started
/// xtask.
pub fn cargo(root: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.args(arguments).current_dir(root);
    for name in OVERRIDES {
        command.env_remove(name);
    }
    command
}

/// Makes cargo, also one that the command starts, compile the crates of this repository with
/// Clippy's compiler, which checks the lints and writes the same programs as rustc: nothing is
/// compiled once for the lints and again for the tests.
pub fn linted(command: &mut Command) -> &mut Command {
    command.env("RUSTC_WORKSPACE_WRAPPER", "clippy-driver").env("CLIPPY_ARGS", "-Dwarnings__CLIPPY_HACKERY__")
}

/// Runs a program with its output passed through. Exit codes that are not in `accepted` are errors.
///
/// # Errors
/// If the program cannot be started or returns another exit code.
pub fn run(command: &mut Command, accepted: &[i32]) -> Result<()> {
    let typed = as_typed(command);
    let status = command.status().with_context(|| format!("cannot run `{typed}`"))?;
    ensure!(status.code().is_some_and(|code| accepted.contains(&code)), "`{typed}` ended with {status}");
    Ok(())
}

/// Returns the standard output of a program.
///
/// # Errors
/// As [`run`], with exit code 0 alone accepted.
pub fn output(command: &mut Command) -> Result<String> {
    let typed = as_typed(command);
    let output = command.output().with_context(|| format!("cannot run `{typed}`"))?;
    let stderr = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "`{typed}` ended with {}: {}", output.status, stderr.trim());
    Ok(String::from_utf8(output.stdout)?)
}

/// Returns a command as a user would type it: the program without its folder, then the arguments.
pub fn as_typed(command: &Command) -> String {
    let program = Path::new(command.get_program()).file_name().unwrap_or(command.get_program());
    let words: Vec<_> =
        std::iter::once(program).chain(command.get_args()).map(OsStr::to_string_lossy).collect();
    words.join(" ")
}
