//! Fetches MuJoCo's shared library: downloads its wheel from PyPI, checks the library and puts it
//! where the build looks.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};

use crate::platform::{self, Platform};
use crate::wheel::{self, sha256};

const VERSION: &str = "3.17.0";
pub const LICENSES: [&str; 2] = ["LICENSE", "LICENSES_THIRD_PARTY.md"];
/// Environment variable with the folder that `mujoco-rs` links from; users may set it to their own
/// MuJoCo.
const LINK_DIR: &str = "MUJOCO_DYNAMIC_LINK_DIR";
/// Its value in `.cargo/config.toml`: a folder that leads the linker to `target/mujoco/lib`.
const LINK_DIR_DEFAULT: &str = "crates/world/link";

/// Folder of the copy for installed programs, in the user's data folder; crates/cli/build.rs has
/// the same path.
const KEPT: &str = "mishandle/mujoco-3.17.0";

/// Selects one wheel, whichever Python runs pip: the library inside is the same in all of them.
const WHEEL: [&str; 2] = ["--python-version=3.12", "--implementation=cp"];

/// Puts MuJoCo's library into `target/mujoco/lib`, unless it exists or the user has their own.
/// Keeps a copy in the user's data folder, where a program from `cargo install` finds it without
/// this clone.
pub fn fetch(root: &Path) -> Result<()> {
    let platform = platform::present()?;
    if !platform.was_run {
        eprintln!("note: nobody has built and tested the program on {} yet", platform.name);
    }
    let folder = root.join("target/mujoco/lib");
    if let Some(own) = users_own(root) {
        ensure!(
            own.join(platform.link).is_file(),
            "{LINK_DIR} is {}, which does not contain {}; unset it, or set it to the `lib` folder of MuJoCo {VERSION}",
            own.display(),
            platform.link
        );
        eprintln!("MuJoCo: {}, from {LINK_DIR}", own.display());
        return Ok(());
    }
    if is_in_place(&folder, platform) {
        eprintln!("MuJoCo {VERSION}: {} exists", folder.display());
        keep(&folder, platform);
        return Ok(());
    }
    let started = Instant::now();
    let scratch = folder.with_file_name(format!("fetch-{}", std::process::id()));
    fs::create_dir_all(&scratch)
        .with_context(|| format!("cannot create the folder {}", scratch.display()))?;
    let placed = download(&scratch, platform).and_then(|()| place(&scratch, &folder, platform));
    fs::remove_dir_all(&scratch).with_context(|| format!("cannot remove {}", scratch.display()))?;
    placed?;
    eprintln!("MuJoCo {VERSION}: {}, in {:.1} s", folder.display(), started.elapsed().as_secs_f64());
    keep(&folder, platform);
    Ok(())
}

/// Copies the library into the user's data folder. Only installed programs need it, so a failure is
/// a note.
fn keep(folder: &Path, platform: &Platform) {
    let Some(kept) = data_folder().map(|data| data.join(KEPT)) else {
        eprintln!("note: no copy for installed programs, because neither XDG_DATA_HOME nor HOME is set");
        return;
    };
    if is_in_place(&kept, platform) {
        return;
    }
    match copy(folder, &kept, platform) {
        Ok(()) => {
            eprintln!("MuJoCo {VERSION}: a copy for installed programs is in {}", kept.display());
        }
        Err(error) => eprintln!("note: no copy for installed programs: {error:#}"),
    }
}

/// Copies library and licenses, with renames, so that a program that starts meanwhile finds a
/// complete library.
fn copy(from: &Path, to: &Path, platform: &Platform) -> Result<()> {
    let scratch = to.with_file_name(format!("fetch-{}", std::process::id()));
    fs::create_dir_all(&scratch)
        .with_context(|| format!("cannot create the folder {}", scratch.display()))?;
    let copied = LICENSES.into_iter().chain([platform.library]).try_for_each(|name| {
        fs::copy(from.join(name), scratch.join(name)).map(drop).with_context(|| format!("cannot copy {name}"))
    });
    let placed = copied.and_then(|()| place(&scratch, to, platform));
    fs::remove_dir_all(&scratch).with_context(|| format!("cannot remove {}", scratch.display()))?;
    placed
}

/// Returns the user's data folder, as the XDG Base Directory Specification defines it.
fn data_folder() -> Option<PathBuf> {
    let absolute = |name| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    absolute("XDG_DATA_HOME").or_else(|| Some(absolute("HOME")?.join(".local/share")))
}

/// Returns the folder of the user's own MuJoCo.
fn users_own(root: &Path) -> Option<PathBuf> {
    let chosen = PathBuf::from(std::env::var_os(LINK_DIR)?);
    (chosen != root.join(LINK_DIR_DEFAULT)).then_some(chosen)
}

fn is_in_place(folder: &Path, Platform { library, link, sha256: expected, .. }: &Platform) -> bool {
    let linked = fs::read_link(folder.join(link)).is_ok_and(|target| target == Path::new(library));
    linked && fs::read(folder.join(library)).is_ok_and(|bytes| sha256(&bytes) == *expected)
}

fn download(scratch: &Path, platform: &Platform) -> Result<()> {
    eprintln!("MuJoCo {VERSION}: downloading the wheel from PyPI");
    let options: Vec<&str> = WHEEL.into_iter().chain([platform.wheel]).collect();
    wheel::download("mujoco", VERSION, &options, scratch)?;
    wheel::unpack_named(scratch, &LICENSES.into_iter().chain([platform.library]).collect::<Vec<_>>())
}

/// Moves the unpacked files into `folder`, with renames, so that another build finds a complete
/// library or no library.
fn place(scratch: &Path, folder: &Path, platform: &Platform) -> Result<()> {
    let Platform { library, link, sha256: expected, .. } = platform;
    let bytes = fs::read(scratch.join(library))
        .with_context(|| format!("the wheel of MuJoCo {VERSION} does not contain {library}"))?;
    let found = sha256(&bytes);
    if found != *expected {
        bail!("the downloaded {library} has SHA-256 {found}, expected {expected}; it was deleted");
    }
    fs::create_dir_all(folder).with_context(|| format!("cannot create the folder {}", folder.display()))?;
    symlink(library, scratch.join(link)).context("cannot create a symbolic link in target/mujoco")?;
    for name in LICENSES.into_iter().chain([*library, *link]) {
        let place = folder.join(name);
        fs::rename(scratch.join(name), &place)
            .with_context(|| format!("cannot write {}", place.display()))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_library_with_another_hash_is_refused() {
        let scratch = std::env::temp_dir().join(format!("mishandle-xtask-{}", std::process::id()));
        let folder = scratch.join("lib");
        fs::create_dir_all(&scratch).unwrap();
        let platform = platform::present().unwrap();
        fs::write(scratch.join(platform.library), "abc").unwrap();
        let error = place(&scratch, &folder, platform).unwrap_err().to_string();
        let placed = folder.exists();
        fs::remove_dir_all(&scratch).unwrap();
        // The SHA-256 of "abc" from FIPS 180-2.
        assert!(
            error.contains("ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"),
            "{error}"
        );
        assert!(!placed);
    }
}
