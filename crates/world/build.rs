//! Passes the path of MuJoCo's library to the linker, and fails with a one-line error if the
//! library is missing.
//!
//! `mujoco-rs` also searches for a `libmujoco.so`, in a build script that may run long before this
//! one, and panics without it. So `.cargo/config.toml` sets its search path to the folder `link`,
//! which contains a linker script that refers to the real library. This script checks that the real
//! library exists.

use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::{env, fs, io};

/// Set by `.cargo/config.toml` to the folder `link`, unless the user sets another folder.
const LINK_DIR: &str = "MUJOCO_DYNAMIC_LINK_DIR";
const LIBRARY: &str = "libmujoco.so.3.17.0";

fn main() -> io::Result<()> {
    // At run time: a build script that cargo compiled for another copy of the repository has the
    // path of that copy.
    let package = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed={LINK_DIR}");
    // The paths are canonicalized: a crate outside the workspace may include our
    // `.cargo/config.toml` by another path.
    let link_dir = env::var_os(LINK_DIR).map(PathBuf::from).and_then(|folder| folder.canonicalize().ok());
    if link_dir.is_none() || link_dir != package.join("link").canonicalize().ok() {
        return Ok(()); // the user's own MuJoCo, which `mujoco-rs` checks and links
    }
    let library = package.join("../../target/mujoco/lib").join(LIBRARY);
    println!("cargo::rerun-if-changed={}", library.display());
    let Ok(library) = library.canonicalize() else {
        println!(
            "cargo::error=MuJoCo's library is not in target/mujoco/lib of the repository; download it with `cargo xtask \
             mujoco`"
        );
        return Ok(());
    };
    let out = env::var_os("OUT_DIR").map(PathBuf::from).unwrap_or_default();
    // Documentation tests have no rpath. Cargo adds only the build script's output folder to their
    // library search path.
    link(&library, &out)?;
    println!("cargo::rustc-link-search=native={}", out.display());
    // The rpaths of `.cargo/config.toml` refer to `mujoco/lib` in a program's target folder. A
    // crate outside the workspace has its own target folder without the library. OUT_DIR is
    // TARGET/PROFILE/build/PACKAGE/out.
    if let Some(target) = out.ancestors().nth(4) {
        let folder = target.join("mujoco/lib");
        if !folder.join(LIBRARY).is_file() {
            fs::create_dir_all(&folder)?;
            link(&library, &folder)?;
        }
    }
    Ok(())
}

/// Creates a symbolic link to the library in `folder`.
fn link(library: &Path, folder: &Path) -> io::Result<()> {
    let path = folder.join(LIBRARY);
    if path.is_symlink() {
        fs::remove_file(&path)?;
    }
    symlink(library, path)
}
