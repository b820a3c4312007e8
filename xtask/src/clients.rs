//! `cargo xtask clients`: tests the clients of the simulator protocol with the program.

use std::path::Path;
use std::process::Command;

use anyhow::Result;

use crate::process::run;
use crate::{readme, venv};

/// Runs the tests in `clients/tests`, in a virtual environment of their own. Prints what it skips.
///
/// # Errors
/// If the program cannot be built, the packages cannot be installed, or a test fails.
pub fn test(root: &Path) -> Result<()> {
    readme::build(root)?;
    let python = venv::installed(&root.join("target/clients-venv"), &root.join("clients/requirements.txt"))?;
    if Command::new("octave-cli").arg("--version").output().is_err() {
        eprintln!("SKIPPED: the client in Octave, because octave-cli is not installed");
        eprintln!("install it with `apt-get install --no-install-recommends octave`");
    }
    let mut tests = Command::new(python);
    tests.args(["-m", "unittest", "discover", "--start-directory"]).arg(root.join("clients/tests"));
    run(tests.env("MISHANDLE", root.join("target/debug/mishandle")).current_dir(root), &[0])
}
