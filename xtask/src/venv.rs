//! Virtual environments of Python, one for each file of requirements.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result};

use crate::process::run;

/// Returns the Python of the virtual environment in `folder` for a file of requirements, with this
/// checkout's package in it. Creates the environment if the file changed.
///
/// # Errors
/// As [`installed`].
pub fn environment(root: &Path, folder: &Path, requirements: &Path) -> Result<PathBuf> {
    let python = installed(&folder.join(requirements.file_stem().unwrap_or_default()), requirements)?;
    eprintln!("installing this checkout's package (a release build, which takes minutes the first time)");
    run(pip(&python).args(["--no-deps", "--force-reinstall"]).arg(root), &[0])?;
    Ok(python)
}

/// Returns the Python of a virtual environment with the packages of a file of requirements. Creates
/// the environment if the file changed.
///
/// # Errors
/// If the file cannot be read, or an installation fails.
pub fn installed(venv: &Path, requirements: &Path) -> Result<PathBuf> {
    let python = venv.join("bin/python");
    let required =
        fs::read(requirements).with_context(|| format!("cannot read {}", requirements.display()))?;
    let installed = venv.join("installed.txt");
    if !fs::read(&installed).is_ok_and(|bytes| bytes == required) {
        eprintln!("installing {} into {}", requirements.display(), venv.display());
        run(Command::new("python3").args(["-m", "venv", "--clear"]).arg(venv), &[0])
            .context("cannot make a virtual environment (Debian: `apt install python3-venv`)")?;
        run(pip(&python).arg("--requirement").arg(requirements), &[0])?;
        fs::write(&installed, required).with_context(|| format!("cannot write {}", installed.display()))?;
    }
    Ok(python)
}

fn pip(python: &Path) -> Command {
    let mut command = Command::new(python);
    command.args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"]);
    command
}
