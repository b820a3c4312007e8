//! `cargo xtask sanitize`: runs the tests of the crates that contain `unsafe` code or C with
//! AddressSanitizer.

use std::path::Path;
use std::process::Command;

use anyhow::{Result, ensure};

use crate::process::run;

/// `store` contains SQLite, which is instrumented, and faults that its tests inject. `world` calls
/// MuJoCo, which is not: errors in it are found if they are in memory of the heap that a function
/// of the C library touches.
const PACKAGES: [&str; 2] = ["mishandle-store", "mishandle-world"];

const TARGET: &str = "x86_64-unknown-linux-gnu";

/// Fails, because the sanitizer keeps freed memory.
const SKIPPED: &str = "a_run_needs_less_memory_than_its_file_size";

const ENVIRONMENT: [(&str, &str); 3] = [
    // These flags replace those of .cargo/config.toml.
    ("RUSTFLAGS", "-Zsanitizer=address -Ctarget-cpu=x86-64-v3"),
    ("CFLAGS_x86_64_unknown_linux_gnu", "-fsanitize=address"),
    // The runtime is LLVM's. It takes each static variable that GCC instruments for a second
    // definition of itself.
    ("ASAN_OPTIONS", "detect_odr_violation=0"),
];

/// Runs the tests, all of them although one fails.
///
/// # Errors
/// If there is no nightly toolchain, or a test fails, or AddressSanitizer or LeakSanitizer reports
/// an error.
pub fn sanitize(root: &Path, arguments: &[String]) -> Result<()> {
    let mut version = rustup(&["rustc", "--version"]);
    ensure!(
        version.output().is_ok_and(|output| output.status.success()),
        "AddressSanitizer needs a nightly toolchain; install one with `rustup toolchain install nightly`"
    );
    let mut command = rustup(&["cargo", "test", "--target", TARGET, "--lib", "--tests", "--no-fail-fast"]);
    let packages = PACKAGES.map(str::to_owned);
    for package in if arguments.is_empty() { &packages } else { arguments } {
        command.args(["--package", package]);
    }
    command.args(["--", "--skip", SKIPPED]);
    command.current_dir(root).envs(ENVIRONMENT);
    command.env("CARGO_TARGET_DIR", root.join("target/sanitize"));
    command.env("LD_LIBRARY_PATH", root.join("target/mujoco/lib"));
    run(&mut command, &[0])
}

/// Returns a command of the nightly toolchain.
fn rustup(arguments: &[&str]) -> Command {
    let mut command = Command::new("rustup");
    command.args(["run", "nightly"]).args(arguments);
    command
}
