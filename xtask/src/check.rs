//! `cargo xtask test`: runs the steps of CI in order and stops at the first failure.

use std::path::Path;
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, Result};

use crate::process::{as_typed, cargo, run};
use crate::{clients, deny, monitor, mujoco, readme, tidy};

struct Step {
    name: &'static str,
    action: Action,
}

enum Action {
    /// Arguments of `cargo`.
    Cargo(&'static [&'static str]),
    /// Another chore.
    Chore(fn(&Path) -> Result<()>),
}

/// Fast checks first. Clippy compiles the benchmarks; they are not run, because they take minutes.
const STEPS: &[Step] = &[
    Step { name: "mujoco", action: Action::Chore(mujoco::fetch) },
    Step { name: "fmt", action: Action::Cargo(&["fmt", "--all", "--check"]) },
    Step { name: "tidy", action: Action::Chore(tidy::check) },
    Step {
        name: "clippy",
        action: Action::Cargo(&[
            "clippy",
            "--workspace",
            "--all-targets",
            "--features",
            "mishandle-results/schema",
            "--",
            "-D",
            "warnings",
        ]),
    },
    // The build of the demo, without optional parts.
    Step {
        name: "small build",
        action: Action::Cargo(&[
            "check",
            "--package",
            "mishandle-cli",
            "--no-default-features",
            "--features",
            "render",
        ]),
    },
    Step { name: "tests", action: Action::Chore(tests) },
    Step { name: "docs", action: Action::Cargo(&["doc", "--workspace", "--no-deps", "--quiet"]) },
    Step { name: "doc tests", action: Action::Cargo(&["test", "--workspace", "--doc"]) },
    Step { name: "dependencies", action: Action::Chore(deny::check_if_installed) },
    Step { name: "python", action: Action::Chore(python) },
    Step { name: "monitor", action: Action::Chore(monitor::check) },
    Step { name: "clients", action: Action::Chore(clients::test) },
    Step { name: "readme", action: Action::Chore(readme::check) },
];

/// Runs every step.
///
/// # Errors
/// If a step fails, with its name and its command.
pub fn check(root: &Path) -> Result<()> {
    let started = Instant::now();
    for (number, step) in (1..).zip(STEPS) {
        let label = format!("[{number}/{}] {}", STEPS.len(), step.name);
        let step_started = Instant::now();
        let result = match step.action {
            Action::Cargo(arguments) => {
                let mut command = cargo(root, arguments);
                eprintln!("{label}: {}", as_typed(&command));
                run(&mut command, &[0])
            }
            Action::Chore(chore) => {
                eprintln!("{label}");
                chore(root)
            }
        };
        result.with_context(|| format!("step `{}` failed", step.name))?;
        eprintln!("{label}: passed in {:.1} s\n", step_started.elapsed().as_secs_f64());
    }
    eprintln!("all {} steps passed in {:.1} s", STEPS.len(), started.elapsed().as_secs_f64());
    Ok(())
}

/// Runs the tests with nextest if it is installed, otherwise with cargo's own runner.
fn tests(root: &Path) -> Result<()> {
    let has_nextest =
        cargo(root, &["nextest", "--version"]).output().is_ok_and(|output| output.status.success());
    let arguments: &[&str] = if has_nextest {
        &["nextest", "run", "--workspace"]
    } else {
        &["test", "--workspace", "--lib", "--bins", "--tests", "--examples"]
    };
    run(&mut cargo(root, arguments), &[0])
}

/// Builds, installs and tests the Python package, in a virtual environment of its own.
fn python(root: &Path) -> Result<()> {
    run(Command::new("python/dev.sh").current_dir(root), &[0])
}
