//! Tells the linker where MuJoCo's library is, and stops the build with one line when it is not there.
//!
//! `mujoco-rs` looks for a `libmujoco.so` too, in a build script that may run long before this one, and panics without
//! it. So `.cargo/config.toml` shows it the folder `link`, which always has one: a linker script that names the real
//! library. What is left to check is checked here.

use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::{env, fs, io};

/// Set by `.cargo/config.toml` to the folder `link`, unless the user names a folder of their own.
const LINK_DIR: &str = "MUJOCO_DYNAMIC_LINK_DIR";
const LIBRARY: &str = "libmujoco.so.3.17.0";

fn main() -> io::Result<()> {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed={LINK_DIR}");
    // A crate outside the workspace includes our `.cargo/config.toml`, and then the path has a detour in it.
    let link_dir = env::var_os(LINK_DIR).map(PathBuf::from).and_then(|folder| folder.canonicalize().ok());
    if link_dir.is_none() || link_dir != package.join("link").canonicalize().ok() {
        return Ok(()); // a MuJoCo of the user's own, which `mujoco-rs` checks and links
    }
    let library = package.join("../../target/mujoco/lib").join(LIBRARY);
    println!("cargo::rerun-if-changed={}", library.display());
    let Ok(library) = library.canonicalize() else {
        println!(
            "cargo::error=MuJoCo's library is not in target/mujoco/lib of the repository; fetch it there with `cargo \
             xtask mujoco`"
        );
        return Ok(());
    };
    let out = env::var_os("OUT_DIR").map(PathBuf::from).unwrap_or_default();
    // What lies in the build's own output, and no folder beside it, cargo adds to the run-time search path of the tests
    // that have no rpath, which are those in the documentation.
    link(&library, &out)?;
    println!("cargo::rustc-link-search=native={}", out.display());
    // The rpaths of `.cargo/config.toml` lead from a program to `mujoco/lib` in its target folder. A crate outside the
    // workspace has a target folder of its own, without the library. OUT_DIR is TARGET/PROFILE/build/PACKAGE/out.
    if let Some(target) = out.ancestors().nth(4) {
        let folder = target.join("mujoco/lib");
        if !folder.join(LIBRARY).is_file() {
            fs::create_dir_all(&folder)?;
            link(&library, &folder)?;
        }
    }
    Ok(())
}

/// Makes the library known in `folder` by a symbolic link.
fn link(library: &Path, folder: &Path) -> io::Result<()> {
    let place = folder.join(LIBRARY);
    if place.is_symlink() {
        fs::remove_file(&place)?;
    }
    symlink(library, place)
}
