//! `cargo xtask test`: runs the steps in order and stops at the first failure. With `--all` it runs
//! more of each step, and steps that few changes need.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, Result, bail};

use crate::process::{as_typed, cargo, linted, run};
use crate::{budget, clients, demo, deny, monitor, mujoco, readme, tidy};

/// How much is tested.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Extent {
    /// The checks that every change needs, in minutes.
    Usual,
    /// Everything, long tests and large packages included.
    All,
}

struct Step {
    name: &'static str,
    /// The smallest extent with this step.
    from: Extent,
    action: fn(&Path, Extent) -> Result<()>,
}

/// Fast checks first. The lints come with the build of the tests; benchmarks are not run, because
/// they take minutes.
const STEPS: &[Step] = &[
    Step { name: "mujoco", from: Extent::Usual, action: |root, _| mujoco::fetch(root) },
    Step {
        name: "fmt",
        from: Extent::Usual,
        action: |root, _| run_cargo(root, &["fmt", "--all", "--check"]),
    },
    Step { name: "tidy", from: Extent::Usual, action: |root, _| tidy::check(root) },
    Step { name: "build", from: Extent::Usual, action: |root, _| build(root) },
    Step { name: "tests", from: Extent::Usual, action: tests },
    Step {
        name: "doc tests",
        from: Extent::Usual,
        action: |root, _| run_cargo(root, &["test", "--workspace", "--doc"]),
    },
    Step { name: "python", from: Extent::Usual, action: python },
    Step { name: "monitor", from: Extent::Usual, action: |root, _| monitor::check(root) },
    Step { name: "clients", from: Extent::Usual, action: clients::test },
    Step { name: "pages", from: Extent::Usual, action: readme::check },
    Step {
        name: "docs",
        from: Extent::All,
        action: |root, _| run_cargo(root, &["doc", "--workspace", "--no-deps", "--quiet"]),
    },
    Step { name: "dependencies", from: Extent::All, action: |root, _| deny::check_if_installed(root) },
    Step { name: "demo", from: Extent::All, action: |root, _| demo::check(root) },
];

/// Runs the steps.
///
/// # Errors
/// If a step fails, with its name and its command; or for another argument than `--all`.
pub fn check(root: &Path, arguments: &[String]) -> Result<()> {
    let extent = match arguments {
        [] => Extent::Usual,
        [all] if all == "--all" => Extent::All,
        [other, ..] => bail!("unknown argument `{other}`; expected --all or nothing"),
    };
    let chosen: Vec<&Step> =
        STEPS.iter().filter(|step| extent == Extent::All || step.from == Extent::Usual).collect();
    let budget = fs::read_to_string(root.join(budget::FILE)).with_context(|| budget::FILE.to_string())?;
    budget::check(&budget, STEPS.iter().map(|step| step.name))?;
    let mut spent = Vec::new();
    for (number, step) in (1..).zip(&chosen) {
        let label = format!("[{number}/{}] {}", chosen.len(), step.name);
        eprintln!("{label}");
        let started = Instant::now();
        let cpu = budget::cpu_secs();
        (step.action)(root, extent).with_context(|| format!("step `{}` failed", step.name))?;
        let time = budget::Time {
            step: step.name,
            wall_secs: started.elapsed().as_secs_f64(),
            cpu_secs: budget::cpu_secs() - cpu,
        };
        eprintln!("{label}: passed in {:.1} s\n", time.wall_secs);
        spent.push(time);
    }
    eprint!("{}", budget::table(&budget, extent == Extent::All, &spent)?);
    Ok(())
}

fn run_cargo(root: &Path, arguments: &[&str]) -> Result<()> {
    let mut command = cargo(root, arguments);
    eprintln!("$ {}", as_typed(&command));
    run(linted(&mut command), &[0])
}

/// Builds everything that later steps run, and checks the lints. Only the generator of references
/// has the feature `schema`.
fn build(root: &Path) -> Result<()> {
    run_cargo(root, &["build", "--workspace", "--all-targets"])?;
    run_cargo(root, &["build", "-p", "mishandle-results", "--features", "schema", "--example", "generate"])
}

/// Runs the tests with nextest if it is installed, otherwise with cargo's own runner. Tests that
/// are ignored take long. In the full run, a program that tests lack is a failure.
fn tests(root: &Path, extent: Extent) -> Result<()> {
    let has_nextest =
        cargo(root, &["nextest", "--version"]).output().is_ok_and(|output| output.status.success());
    let mut arguments = if has_nextest {
        vec!["nextest", "run", "--workspace"]
    } else {
        vec!["test", "--workspace", "--lib", "--bins", "--tests", "--examples"]
    };
    match (extent, has_nextest) {
        (Extent::Usual, _) => {}
        (Extent::All, true) => arguments.extend(["--run-ignored", "all"]),
        (Extent::All, false) => arguments.extend(["--", "--include-ignored"]),
    }
    let mut command = cargo(root, &arguments);
    eprintln!("$ {}", as_typed(&command));
    run(linted(&mut command).env("MISHANDLE_TEST_ALL", if extent == Extent::All { "1" } else { "0" }), &[0])
}

/// Builds, installs and tests the Python package, in a virtual environment of its own.
fn python(root: &Path, extent: Extent) -> Result<()> {
    let mut script = Command::new("python/dev.sh");
    if extent == Extent::All {
        script.arg("--all");
    }
    run(linted(script.current_dir(root)), &[0])
}
