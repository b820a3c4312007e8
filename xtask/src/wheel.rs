//! Wheels from PyPI: downloaded with pip, and unpacked.

use std::ffi::OsStr;
use std::fs;
use std::io::ErrorKind;
use std::path::Path;
use std::process::{Command, Output};

use anyhow::{Context, Result, anyhow, ensure};
use sha2::{Digest, Sha256};

/// Keeps pip quiet, and makes it fail within seconds on a machine without network.
const PIP: &[&str] = &[
    "--no-deps",
    "--only-binary=:all:",
    "--quiet",
    "--no-input",
    "--disable-pip-version-check",
    "--retries=2",
    "--timeout=20",
    "--progress-bar=off",
];

/// Unpacks files of the only wheel in a folder: with `named`, those of these names into the folder
/// itself; with `below`, all of one of its folders into another folder, except programs.
const UNPACK: &str = "
import glob, os, sys, zipfile
how, folder, *rest = sys.argv[1:]
with zipfile.ZipFile(glob.glob(os.path.join(folder, '*.whl'))[0]) as wheel:
    for member in wheel.namelist():
        if how == 'named':
            place = member.rsplit('/', 1)[-1]
            if place not in rest:
                continue
            place = os.path.join(folder, place)
        else:
            inside, out = rest
            if not member.startswith(inside) or member.endswith(('/', '.py')) or '..' in member.split('/'):
                continue
            place = os.path.join(out, member[len(inside):])
            os.makedirs(os.path.dirname(place), exist_ok=True)
        with open(place, 'wb') as file:
            file.write(wheel.read(member))
";

/// Downloads the wheel of a package into a folder; `options` are pip's that choose the wheel.
///
/// # Errors
/// If pip fails, with its reason in one line.
pub fn download(package: &str, version: &str, options: &[&str], folder: &Path) -> Result<()> {
    let requirement = format!("{package}=={version}");
    let fixed = ["-m", "pip", "download", &requirement, "--dest"].map(OsStr::new);
    let options = options.iter().chain(PIP).map(OsStr::new);
    let pip = python(fixed.into_iter().chain([folder.as_os_str()]).chain(options))?;
    let what = format!("{package} {version}");
    ensure!(pip.status.success(), "{}", why_pip_failed(&what, &String::from_utf8_lossy(&pip.stderr)));
    Ok(())
}

/// Unpacks the files with these names of the only wheel in a folder into that folder.
///
/// # Errors
/// If the wheel cannot be read.
pub fn unpack_named(folder: &Path, names: &[&str]) -> Result<()> {
    unpack("named", folder, names.iter().map(OsStr::new))
}

/// Unpacks the folder `inside` of the only wheel in a folder into `out`.
///
/// # Errors
/// If the wheel cannot be read.
pub fn unpack_below(folder: &Path, inside: &str, out: &Path) -> Result<()> {
    unpack("below", folder, [OsStr::new(inside), out.as_os_str()].into_iter())
}

fn unpack<'a>(how: &'a str, folder: &'a Path, rest: impl Iterator<Item = &'a OsStr>) -> Result<()> {
    let fixed = [OsStr::new("-c"), OsStr::new(UNPACK), OsStr::new(how), folder.as_os_str()];
    let unpacked = python(fixed.into_iter().chain(rest))?;
    let stderr = String::from_utf8_lossy(&unpacked.stderr);
    ensure!(unpacked.status.success(), "cannot unpack a wheel: {}", last_line(&stderr));
    Ok(())
}

/// Returns the SHA-256 of the only wheel in a folder.
///
/// # Errors
/// If the folder has no wheel, or it cannot be read.
pub fn sha256_of_wheel(folder: &Path) -> Result<String> {
    let entries = fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))?;
    let is_wheel = |path: &std::path::PathBuf| path.extension().is_some_and(|extension| extension == "whl");
    let wheel = entries.filter_map(|entry| Some(entry.ok()?.path())).find(is_wheel);
    let wheel = wheel.with_context(|| format!("{} has no wheel", folder.display()))?;
    Ok(sha256(&fs::read(&wheel).with_context(|| format!("cannot read {}", wheel.display()))?))
}

/// Returns the SHA-256 of bytes as hexadecimal digits.
pub fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

fn python<'a>(arguments: impl Iterator<Item = &'a OsStr>) -> Result<Output> {
    // The setting is about installations; this is only a download.
    Command::new("python3").args(arguments).env("PIP_REQUIRE_VIRTUALENV", "0").output().map_err(|error| {
        match error.kind() {
            ErrorKind::NotFound => {
                anyhow!("a download from PyPI needs `python3`; install Python 3 with pip")
            }
            _ => anyhow!(error).context("cannot run `python3`"),
        }
    })
}

/// Returns pip's error in one line.
fn why_pip_failed(what: &str, stderr: &str) -> String {
    if stderr.contains("No module named pip") {
        return "a download from PyPI needs pip, which `python3` lacks; install it (Debian: `apt install python3-pip`)"
            .into();
    }
    let unreachable =
        ["NewConnectionError", "ConnectTimeoutError", "ProxyError", "NameResolutionError", "SSLError"];
    if unreachable.iter().any(|name| stderr.contains(name)) {
        return format!(
            "cannot download {what}: pip cannot reach PyPI; check the network, or pip's mirror and proxy"
        );
    }
    format!("cannot download {what}: pip says: {}", last_line(stderr))
}

fn last_line(text: &str) -> &str {
    text.lines().map(str::trim).rfind(|line| !line.is_empty()).unwrap_or("(nothing)")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pip_errors_become_one_line() {
        for (stderr, expected) in [
            ("/usr/bin/python3: No module named pip\n", "needs pip"),
            (
                "WARNING: Retrying ... NewConnectionError('...')\nERROR: No matching distribution\n",
                "cannot reach PyPI",
            ),
            (
                "WARNING: a\nERROR: No matching distribution found\n\n",
                "pip says: ERROR: No matching distribution found",
            ),
            ("", "pip says: (nothing)"),
        ] {
            let line = why_pip_failed("mujoco 3.17.0", stderr);
            assert!(line.contains(expected) && !line.contains('\n'), "{line}");
        }
    }
}
