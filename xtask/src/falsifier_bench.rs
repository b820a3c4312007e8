//! `cargo xtask falsifier-bench`: runs the benchmark of falsifiers in
//! `studies/experiments/falsifiers`.
//!
//! Each file of requirements there has a virtual environment under `target`, because the outside
//! searches need other versions of the same packages, and some of them gigabytes.

use std::path::Path;
use std::process::Command;

use anyhow::Result;

use crate::mujoco;
use crate::process::run;
use crate::venv::environment;

/// The file of the searches that need no large packages, and the table.
const FIRST: &str = "requirements";
/// Files of searches that need gigabytes of packages.
const LARGE: [&str; 2] = ["requirements-botorch", "requirements-stgem"];

/// Tests the statistics, runs the missing trials with these arguments, and prints the tables.
/// `--large` includes the searches with large packages; one that cannot be installed is reported
/// and left out.
///
/// # Errors
/// If the first environment cannot be made, or a run fails.
pub fn bench(root: &Path, arguments: &[String]) -> Result<()> {
    let (large, rest): (Vec<_>, Vec<_>) =
        arguments.iter().cloned().partition(|argument| argument == "--large");
    let folder = root.join("studies/experiments/falsifiers");
    let make = |name: &str| {
        environment(root, &root.join("target/falsifier-venv"), &folder.join(name).with_extension("txt"))
    };
    mujoco::fetch(root)?;
    let python = make(FIRST)?;
    let script = |python: &Path, name: &str| {
        let mut command = Command::new(python);
        command.arg(name).current_dir(&folder);
        command
    };
    run(&mut script(&python, "test_falsifiers.py"), &[0])?;
    run(script(&python, "bench.py").args(&rest), &[0])?;
    for name in LARGE.iter().filter(|_| !large.is_empty()) {
        match make(name) {
            Ok(other) => run(script(&other, "bench.py").args(["--environment", name]).args(&rest), &[0])?,
            Err(error) => eprintln!("left out the searches of {name}.txt: {error:#}"),
        }
    }
    let quick = rest.iter().filter(|argument| *argument == "--quick");
    run(script(&python, "tables.py").args(quick), &[0])
}
