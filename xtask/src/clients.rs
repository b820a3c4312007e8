//! `cargo xtask clients`: tests the clients of the simulator protocol with the program.

use std::path::Path;
use std::process::Command;

use anyhow::Result;

use crate::check::Extent;
use crate::process::run;
use crate::{readme, venv};

/// The tests that need neither a large package nor a compiler of their own.
const USUAL: [&str; 2] = ["test_c.py", "test_python.py"];

/// Runs the tests in `clients/tests`. Those of all extents run in a virtual environment of their
/// own. Prints what it skips.
///
/// # Errors
/// If the program cannot be built, the packages cannot be installed, or a test fails.
pub fn test(root: &Path, extent: Extent) -> Result<()> {
    readme::build(root)?;
    let mut tests = match extent {
        Extent::Usual => {
            let mut tests = Command::new("python3");
            tests.args(["-m", "unittest"]).args(USUAL).current_dir(root.join("clients/tests"));
            tests
        }
        Extent::All => {
            let requirements = root.join("clients/requirements.txt");
            let python = venv::installed(&root.join("target/clients-venv"), &requirements)?;
            if Command::new("octave-cli").arg("--version").output().is_err() {
                eprintln!("SKIPPED: the client in Octave, because octave-cli is not installed");
                eprintln!("install it with `apt-get install --no-install-recommends octave`");
            }
            let mut tests = Command::new(python);
            tests.args(["-m", "unittest", "discover", "--start-directory"]).arg(root.join("clients/tests"));
            tests
        }
    };
    run(tests.env("MISHANDLE", root.join("target/debug/mishandle")), &[0])
}
