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

/// Longest time in which pip installs the wheel from a folder with all wheels that it needs.
const INSTALL: Duration = Duration::from_secs(10);

/// Longest time of a first search that finds a counterexample.
const SEARCH: Duration = Duration::from_secs(2);

/// Number of installations, of which the fastest counts: other programs may load the machine.
const ATTEMPTS: usize = 3;

/// The search of the demo.
const ARGUMENTS: [&str; 8] =
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
assert isinstance(found, mishandle.results.Falsification) and found.counterexamples, found
";

/// Checks a distribution.
///
/// # Errors
/// If something does not install, finds no counterexample, or takes too long.
pub fn check(built: &Dist, platform: &Platform) -> Result<()> {
    let folder = built.folder.join("check");
    for part in ["home", "path", "wheels"] {
        fs::create_dir_all(folder.join(part)).context("cannot create a folder for the check")?;
    }
    archive(built, &folder)?;
    wheel(built, &folder)?;
    fs::remove_dir_all(&folder).with_context(|| format!("cannot remove {}", folder.display()))?;
    eprintln!("{}: archive and wheel find a counterexample in an empty environment", platform.name);
    Ok(())
}

fn archive(built: &Dist, folder: &Path) -> Result<()> {
    run(Command::new("tar").arg("-xzf").arg(&built.archive).arg("-C").arg(folder), &[0])?;
    let name = built.archive.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let program = folder.join(name.trim_end_matches(".tar.gz")).join("bin/mishandle");
    let times = (0..ATTEMPTS).map(|_| search(&program, folder)).collect::<Result<Vec<_>>>()?;
    within(&times, SEARCH, "a first counterexample with the archive")?;
    let took = timed(clean(&program, folder).arg("demo"), 0)?;
    eprintln!("the demo of the archive: {:.1} s", took.as_secs_f64());
    Ok(())
}

fn wheel(built: &Dist, folder: &Path) -> Result<()> {
    let venv = folder.join("venv");
    let python = venv.join("bin/python");
    let pip = |command: &mut Command, action| {
        let options = ["-m", "pip", action, "--quiet", "--disable-pip-version-check"];
        command.args(options).arg("--find-links").arg(folder.join("wheels")).arg(&built.wheel);
    };
    let mut installations = Vec::new();
    let mut searches = Vec::new();
    for attempt in 0..ATTEMPTS {
        run(Command::new("python3").args(["-m", "venv", "--clear"]).arg(&venv), &[0])?;
        if attempt == 0 {
            // The network is not measured.
            let mut download = Command::new(&python);
            pip(&mut download, "download");
            run(download.arg("--dest").arg(folder.join("wheels")), &[0])?;
        }
        let mut install = clean(&python, folder);
        pip(&mut install, "install");
        installations.push(timed(install.arg("--no-index"), 0)?);
        searches.push(search(&venv.join("bin/mishandle"), folder)?);
    }
    timed(clean(&python, folder).args(["-c", SCRIPT]), 0)?;
    within(&installations, INSTALL, "the installation of the wheel")?;
    within(&searches, SEARCH, "a first counterexample with the wheel")
}

/// Returns the time of the first search by a program.
fn search(program: &Path, folder: &Path) -> Result<Duration> {
    let runs = folder.join("runs");
    if runs.exists() {
        fs::remove_dir_all(&runs).with_context(|| format!("cannot remove {}", runs.display()))?;
    }
    // Exit code 1: a counterexample was found.
    timed(clean(program, folder).args(ARGUMENTS), 1)
}

/// Returns a program without the variables of this environment, which finds no other program: no
/// compiler, no cargo.
fn clean(program: &Path, folder: &Path) -> Command {
    let mut command = Command::new(program);
    command.current_dir(folder).env_clear();
    command.env("PATH", folder.join("path")).env("HOME", folder.join("home"));
    command
}

/// Runs a command, which must end with this exit code, and returns its time.
fn timed(command: &mut Command, code: i32) -> Result<Duration> {
    let start = Instant::now();
    let typed = as_typed(command);
    let found = command.output().with_context(|| format!("cannot run `{typed}`"))?;
    let took = start.elapsed();
    let text = String::from_utf8_lossy(&found.stderr);
    ensure!(found.status.code() == Some(code), "`{typed}` ended with {}: {}", found.status, text.trim());
    Ok(took)
}

/// Checks the shortest of some times.
fn within(times: &[Duration], limit: Duration, what: &str) -> Result<()> {
    let seconds: Vec<String> = times.iter().map(|time| format!("{:.1}", time.as_secs_f64())).collect();
    let seconds = seconds.join(", ");
    ensure!(
        times.iter().any(|time| *time <= limit),
        "{what} took {seconds} s; the fastest must take at most {} s",
        limit.as_secs()
    );
    eprintln!("{what}: {seconds} s");
    Ok(())
}
