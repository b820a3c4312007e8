//! Installs wheel and archive into empty folders, with an empty environment, and finds a first
//! counterexample with each.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};

use super::Dist;
use crate::platform::Platform;
use crate::process::{as_typed, run};

/// Time in which a new user sees a counterexample.
const LIMIT: Duration = Duration::from_secs(60);

/// First search of the archive's README.md.
const SEARCH: [&str; 8] =
    ["falsify", "ball-balancing", "--controller", "ppo", "--space", "delay", "--trials", "2"];

/// The example of python/README.md, and one with MuJoCo.
const SCRIPT: &str = "
import mishandle
from mishandle import Axis

def system(scenario):
    return {'gap': [10.0, 10.0 - scenario['speed']]}

found = mishandle.falsify(system, 'always(gap >= 2)', [Axis('speed', 0, 10, 'm/s')], trials=3, budget=50)
assert found.counterexamples, found
found = mishandle.falsify('ball-balancing', policy='ppo', space='delay', trials=1, budget=50)
assert found.counterexamples, found
";

/// Checks a distribution.
///
/// # Errors
/// If something does not install, finds no counterexample, or takes longer than a minute.
pub fn check(built: &Dist, platform: &Platform) -> Result<()> {
    let folder = built.folder.join("check");
    fs::create_dir_all(folder.join("home")).context("cannot create a folder for the check")?;
    run(Command::new("tar").arg("-xzf").arg(&built.archive).arg("-C").arg(&folder), &[0])?;
    let name = built.archive.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let program = folder.join(name.trim_end_matches(".tar.gz")).join("bin/mishandle");
    // Exit code 1: a counterexample was found.
    timed(clean(&program, &folder).args(SEARCH), 1, "the archive")?;
    let venv = folder.join("venv");
    run(Command::new("python3").args(["-m", "venv"]).arg(&venv), &[0])?;
    let python = venv.join("bin/python");
    let mut pip = Command::new(&python);
    pip.args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"]).arg(&built.wheel);
    run(&mut pip, &[0])?;
    timed(clean(&python, &folder).args(["-c", SCRIPT]), 0, "the wheel")?;
    timed(clean(&venv.join("bin/mishandle"), &folder).args(SEARCH), 1, "the command of the wheel")?;
    fs::remove_dir_all(&folder).with_context(|| format!("cannot remove {}", folder.display()))?;
    eprintln!("{}: archive and wheel find a counterexample in an empty environment", platform.name);
    Ok(())
}

/// Returns a program in a folder of its own, without the variables of this environment.
fn clean(program: &Path, folder: &Path) -> Command {
    let mut command = Command::new(program);
    command.current_dir(folder).env_clear().env("PATH", "/usr/bin:/bin").env("HOME", folder.join("home"));
    command
}

/// Runs a command, which must end with this exit code within the limit.
fn timed(command: &mut Command, code: i32, what: &str) -> Result<()> {
    let start = Instant::now();
    let typed = as_typed(command);
    let found = command.output().with_context(|| format!("cannot run `{typed}`"))?;
    let took = start.elapsed();
    let text = String::from_utf8_lossy(&found.stderr);
    ensure!(
        found.status.code() == Some(code),
        "`{typed}` of {what} ended with {}: {}",
        found.status,
        text.trim()
    );
    ensure!(
        took <= LIMIT,
        "`{typed}` of {what} took {:.0} s; a first counterexample takes at most 60 s",
        took.as_secs_f64()
    );
    eprintln!("{what}: a counterexample after {:.1} s", took.as_secs_f64());
    Ok(())
}
