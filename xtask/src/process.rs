//! Runs other programs, and says what was run when one fails.

use std::ffi::OsStr;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, ensure};

/// Settings that would replace ours: the flags of `.cargo/config.toml` pin the instruction set and let programs find
/// MuJoCo's library from where they lie in `target`.
const OVERRIDES: [&str; 4] = ["RUSTFLAGS", "CARGO_ENCODED_RUSTFLAGS", "RUSTDOCFLAGS", "CARGO_TARGET_DIR"];

/// `cargo` with these arguments, the same cargo that started us, in the repository's root.
pub fn cargo(root: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.args(arguments).current_dir(root);
    for name in OVERRIDES {
        command.env_remove(name);
    }
    command
}

/// Runs a program, its output let through; any exit code but those in `accepted` is an error.
///
/// # Errors
/// The program cannot be started, or ends otherwise than it should; the message holds the command.
pub fn run(command: &mut Command, accepted: &[i32]) -> Result<()> {
    let typed = as_typed(command);
    let status = command.status().with_context(|| format!("cannot run `{typed}`"))?;
    ensure!(status.code().is_some_and(|code| accepted.contains(&code)), "`{typed}` ended with {status}");
    Ok(())
}

/// What a program wrote to its standard output.
///
/// # Errors
/// As for [`run`], with exit code 0 alone accepted.
pub fn output(command: &mut Command) -> Result<String> {
    let typed = as_typed(command);
    let output = command.output().with_context(|| format!("cannot run `{typed}`"))?;
    let said = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "`{typed}` ended with {}: {}", output.status, said.trim());
    Ok(String::from_utf8(output.stdout)?)
}

/// A command as one would type it: the program without its folder, then the arguments.
pub fn as_typed(command: &Command) -> String {
    let program = Path::new(command.get_program()).file_name().unwrap_or(command.get_program());
    let words: Vec<_> =
        std::iter::once(program).chain(command.get_args()).map(OsStr::to_string_lossy).collect();
    words.join(" ")
}
